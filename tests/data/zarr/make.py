#!/usr/bin/env python3
"""Writes the folders of Zarr and OME-Zarr beside it, and expected.json: what zarr and ome-zarr read there.

    pip install numpy==2.4.6 zarr==3.1.6 numcodecs==0.16.6 ome-zarr==0.18.0 xarray==2026.9.0
    python make.py

Every sample is a function of its place, see `sample`. Affines are 3 x 4, from lattice to world.
"""

import json
import os
import shutil
import zipfile
from pathlib import Path

import numcodecs
import numpy as np
import xarray
import zarr
from ome_zarr.format import FormatV04, FormatV05
from ome_zarr.io import parse_url
from ome_zarr.reader import Reader
from ome_zarr.writer import write_multiscale
from zarr.codecs import BloscCodec, BytesCodec, Crc32cCodec, GzipCodec, ShardingCodec, TransposeCodec, ZstdCodec

os.chdir(Path(__file__).parent)
for old in Path(".").glob("*.zarr"):
    shutil.rmtree(old)
TYPES = {"u8": "u1", "i8": "i1", "u16": "u2", "i16": "i2", "u32": "u4", "i32": "i4", "u64": "u8", "i64": "i8",
         "f16": "f2", "f32": "f4", "f64": "f8"}
expected = []


def sample(name, shape, step=1):
    """Samples indexed [t, c, z, y, x], or by the last of these axes; `step` is the distance between them."""
    full = (1,) * (5 - len(shape)) + tuple(shape)
    t, c, z, y, x = np.indices(full)
    n = (7 * x * step + 13 * y * step + 29 * z * step + 101 * c + 40 * t) % 251
    values = {"u8": n, "i8": n - 125, "u16": 257 * n, "i16": 100 * n - 12000, "u32": 70001 * n, "i32": 70001 * n - 9000000,
              "u64": 3 * 10**16 * n, "i64": 3 * 10**16 * (n - 100), "f16": n * 0.25 - 3.125, "f32": n * 0.25 - 3.125,
              "f64": n / 4 - 7.125}[name]
    return values.astype(TYPES[name]).reshape(shape)


def diagonal(scale=(1, 1, 1), translation=(0, 0, 0)):
    return np.column_stack([np.diag(scale), translation]).tolist()


def add(path, name, got, levels=None, unit="", labels=(), missing=(), fill=0):
    """Records the expected contents of a folder, after the reference has read the intended samples. `levels` are the
    affines; `missing` is the range of missing chunks along z."""
    want = sample(name, got.shape)
    if missing:
        want[tuple(missing)] = fill
    assert np.array_equal(got, want), path
    full = (1,) * (5 - got.ndim) + got.shape
    expected.append(dict(path=path, type=name.replace("f16", "f32"), dims=list(full[:1:-1]), channels=full[1], times=full[0],
                         levels=levels or [diagonal()], unit=unit, labels=list(labels),
                         missing=[missing[0].start, missing[0].stop, fill] if missing else None))


def array(path, name, shape=(5, 4, 3), chunks=(3, 4, 2), write=None, **options):
    data = sample(name, shape)
    dtype = np.dtype(TYPES[name]).newbyteorder(options.pop("order_of_bytes", "<"))
    out = zarr.create_array(path, shape=shape, chunks=chunks, dtype=dtype, **options)
    if write is None:
        out[:] = data
    else:
        out[write] = data[write]
    return zarr.open_array(path, mode="r")[:]


V2, V3 = dict(zarr_format=2), dict(zarr_format=3)
for name in TYPES:
    path = f"v2-{name}.zarr"
    add(path, name, array(path, name, compressors=None, **V2))
    path = f"v3-{name}.zarr"
    add(path, name, array(path, name, compressors=None, chunks=(5, 4, 3), **V3))
path = "v2-big-fortran.zarr"
add(path, "i16", array(path, "i16", order="F", order_of_bytes=">", compressors=None, **V2))
path = "v2-slash.zarr"
add(path, "u16", array(path, "u16", chunk_key_encoding={"name": "v2", "separator": "/"}, compressors=None, **V2))
path = "v2-missing.zarr"
got = array(path, "i16", write=slice(0, 3), fill_value=-7, compressors=None, **V2)
add(path, "i16", got, missing=[slice(3, 5)], fill=-7)
path = "v3-missing.zarr"
got = array(path, "f32", write=slice(3, 5), fill_value=0.5, compressors=None, **V3)
add(path, "f32", got, missing=[slice(0, 3)], fill=0.5)
# Large enough for several blocks, which Blosc splits, and for one that is left over.
large = dict(shape=(10, 12, 9), chunks=(5, 12, 9))
for compressor, name in [(numcodecs.GZip(), "gzip"), (numcodecs.Zlib(), "zlib"), (numcodecs.Zstd(checksum=True), "zstd"),
                         (numcodecs.LZ4(), "lz4")]:
    path = f"v2-{name}.zarr"
    add(path, "i32", array(path, "i32", compressors=compressor, **V2, **large))
path = "v2-shuffle.zarr"
add(path, "f32", array(path, "f32", filters=[numcodecs.Shuffle(4)], compressors=numcodecs.Zlib(), **V2, **large))
for codec in ["blosclz", "lz4", "lz4hc", "zlib", "zstd"]:
    for shuffle, name in [(0, "plain"), (1, "bytes"), (2, "bits")]:
        path = f"v2-blosc-{codec}-{name}.zarr"
        compressor = numcodecs.Blosc(codec, clevel=9, shuffle=shuffle, blocksize=768)
        data = array(path, "u16" if shuffle == 2 else "f32", compressors=compressor, **V2, **large)
        add(path, "u16" if shuffle == 2 else "f32", data)
path = "v3-big-transposed.zarr"
add(path, "f64", array(path, "f64", filters=[TransposeCodec(order=(1, 2, 0))], serializer=BytesCodec(endian="big"),
                       compressors=[GzipCodec()], **V3))
path = "v3-zstd-crc32c.zarr"
add(path, "i16", array(path, "i16", compressors=[ZstdCodec(), Crc32cCodec()], **V3))
path = "v3-blosc.zarr"
add(path, "f32", array(path, "f32", compressors=[BloscCodec(cname="lz4", shuffle="bitshuffle")], **V3, **large))
path = "v3-v2-keys.zarr"
add(path, "u8", array(path, "u8", chunk_key_encoding={"name": "v2", "separator": "."}, compressors=None, **V3))
path = "v3-shards.zarr"
add(path, "i16", array(path, "i16", shape=(5, 6, 7), chunks=(2, 3, 2), shards=(4, 6, 4), **V3))
path = "v3-shards-start.zarr"
sharding = ShardingCodec(chunk_shape=(2, 2, 2), codecs=[TransposeCodec(order=(2, 0, 1)), BytesCodec(), GzipCodec()],
                         index_codecs=[BytesCodec(endian="big"), Crc32cCodec()], index_location="start")
add(path, "f32", array(path, "f32", shape=(6, 4, 6), chunks=(6, 4, 6), write=slice(2, 6), fill_value=1.5,
                       filters=[TransposeCodec(order=(0, 2, 1))], compressors=None,
                       serializer=ShardingCodec(chunk_shape=(2, 2, 2), index_location="start", codecs=sharding.codecs,
                                                index_codecs=sharding.index_codecs), **V3),
    missing=[slice(0, 2)], fill=1.5)
# The fill value by its bits.
for path, name, kind, bits in [("v3-fill-f32.zarr", "f32", "f4", "0x40a00000"), ("v3-fill-f16.zarr", "f16", "f2", "0xc500")]:
    array(path, name, write=slice(0, 3), compressors=None, **V3)
    file = Path(path, "zarr.json")
    file.write_text(json.dumps(json.loads(file.read_text()) | {"fill_value": bits}, indent=2))
    add(path, name, zarr.open_array(path, mode="r")[:], missing=[slice(3, 5)], fill=5 if name == "f32" else -5)
# Axes with names; and a series whose axes are guessed.
path = "v3-named.zarr"
add(path, "u8", array(path, "u8", shape=(2, 3, 5, 4, 3), chunks=(1, 1, 5, 4, 3), compressors=None,
                      dimension_names=["t", "c", "z", "y", "x"], **V3))
path = "v2-times.zarr"
out = zarr.create_array(path, shape=(3, 5, 4, 3), chunks=(2, 3, 4, 3), dtype="<i2", compressors=None, **V2)
out[:] = sample("i16", (3, 1, 5, 4, 3))[:, 0]
add(path, "i16", zarr.open_array(path, mode="r")[:][:, None])


def image(path, name, shape, axes, fmt, chunks, labels=(), omero=None):
    levels = [sample(name, shape)]
    halves = shape[:-3] + tuple(n // 2 for n in shape[-3:])
    levels.append(sample(name, halves, 2))
    steps = [[0.5 * 2**n, 0.75 * 2**n, 2.0 * 2**n] for n in range(2)]
    shifts = [[0, 0, 0], [0.25, 0.375, 1.0]]
    front = len(shape) - 3
    transforms = [[{"type": "scale", "scale": [1.0] * front + step[::-1]},
                   {"type": "translation", "translation": [0.0] * front + shift[::-1]}]
                  for step, shift in zip(steps, shifts)]
    root = zarr.open_group(path, mode="w", zarr_format=fmt.zarr_format)
    kinds = {"t": ("time", "second"), "c": ("channel", None)}
    axes = [{"name": a, "type": kinds.get(a, ("space", "micrometer"))[0],
             **({"unit": kinds.get(a, ("space", "micrometer"))[1]} if a != "c" else {})} for a in axes]
    write_multiscale(levels, root, fmt=fmt, axes=axes, coordinate_transformations=transforms,
                     storage_options={"chunks": chunks}, **({"metadata": {"omero": omero}} if omero else {}))
    if omero:
        root = zarr.open_group(path, mode="a")
        attributes = dict(root.attrs)
        (attributes["ome"] if "ome" in attributes else attributes)["omero"] = omero
        root.attrs.put(attributes)
    node = list(Reader(parse_url(path))())[0]
    transforms = node.metadata["coordinateTransformations"]
    affines = [diagonal(t[0]["scale"][:-4:-1], t[1]["translation"][:-4:-1]) for t in transforms]
    assert np.array_equal(np.asarray(node.data[1]), levels[1])
    add(path, name, np.asarray(node.data[0]), affines, "µm", labels)


omero = {"channels": [
    {"label": "DAPI", "color": "0000FF", "window": {"start": 0, "end": 200, "min": 0, "max": 255}, "active": True},
    {"label": "GFP", "color": "00FF00", "window": {"start": 10, "end": 100, "min": 0, "max": 255}, "active": True}]}
image("image-0.4.zarr", "u8", (2, 2, 4, 6, 8), "tczyx", FormatV04(), (1, 1, 4, 6, 8), omero=omero,
      labels=["DAPI #0000ff 0 200", "GFP #00ff00 10 100"])
image("image-0.5.zarr", "i16", (4, 6, 8), "zyx", FormatV05(), (4, 3, 8))



def bare_image(path, metadata, scales):
    """An image without scales, or with them in a coordinate system."""
    root = zarr.open_group(path, mode="w", zarr_format=3 if "ome" in metadata else 2)
    first = (1, 1) if "axes" not in str(metadata) else ()
    for level, step in enumerate(scales):
        shape = first + tuple(n // step for n in (4, 6, 8))
        data = root.create_array(str(level), shape=shape, chunks=shape, dtype="<i2", compressors=None)
        data[:] = sample("i16", shape, step)
    root.attrs.put(metadata)
    return zarr.open_array(f"{path}/0", mode="r")[:]


# Versions before 0.4 have no scales: the sizes tell the levels.
datasets = [{"path": "0"}, {"path": "1"}]
got = bare_image("image-0.1.zarr", {"multiscales": [{"version": "0.1", "datasets": datasets}]}, (1, 2))
add("image-0.1.zarr", "i16", got, [diagonal(), diagonal((2, 2, 2))])
# Version 0.6 has coordinate systems.
space = [{"name": axis, "type": "space", "unit": "micrometer"} for axis in "zyx"]
scale = {"type": "scale", "scale": [2.0, 0.75, 0.5]}
shift = {"type": "translation", "translation": [1.0, 2.0, 3.0]}
system = {"name": "physical", "axes": space}
sequence = {"type": "sequence", "transformations": [scale, shift], "input": "0", "output": "physical"}
multiscale = {"coordinateSystems": [{"name": "turned", "axes": space[::-1]}, system],
              "datasets": [{"path": "0", "coordinateTransformations": [sequence]}],
              "coordinateTransformations": [{"type": "rotation", "input": "physical", "output": "turned"}]}
got = bare_image("image-0.6.zarr", {"ome": {"version": "0.6.dev2", "multiscales": [multiscale]}}, (1,))
add("image-0.6.zarr", "i16", got, [diagonal((0.5, 0.75, 2.0), (3.0, 2.0, 1.0))], "µm")

# Labels with colours and a name.
image("labels-0.4.zarr", "u8", (4, 6, 8), "zyx", FormatV04(), (4, 6, 8))
colors = [{"label-value": 7, "rgba": [255, 0, 0, 255]}, {"label-value": 13, "rgba": [0, 255, 0, 255]}]
properties = [{"label-value": 13, "name": "nucleus"}]
root = zarr.open_group("labels-0.4.zarr", mode="a")
root.attrs["image-label"] = {"version": "0.4", "colors": colors, "properties": properties}


def of_xarray(path, name, dims, coordinates, affine, fmt):
    """A data set of xarray, whose dimensions have coordinates, in any order."""
    data = xarray.DataArray(sample(name, (5, 4, 3)), dims=list(coordinates)[::-1], coords=coordinates, name="samples")
    data.transpose(*dims).to_dataset().to_zarr(path, zarr_format=fmt, consolidated=False)
    with xarray.open_zarr(path, consolidated=False) as read:
        add(path, name, read["samples"].transpose(*list(coordinates)[::-1]).values, [affine], "mm")


def line(axis, first, step, n, **attributes):
    return axis, first + step * np.arange(n), {"units": "mm", **attributes}


xyz = {"x": line("x", 10.0, 0.5, 3), "y": line("y", -20.0, 0.75, 4), "z": line("z", 30.0, 2.0, 5)}
of_xarray("xarray-v2.zarr", "u8", "zyx", xyz, diagonal((0.5, 0.75, 2), (10, -20, 30)), 2)
of_xarray("xarray-v3.zarr", "i16", "xyz", xyz, diagonal((0.5, 0.75, 2), (10, -20, 30)), 3)
deep = {"x": xyz["x"], "y": xyz["y"], "depth": line("depth", 30.0, 2.0, 5, positive="down")}
of_xarray("xarray-down.zarr", "i16", ("y", "depth", "x"), deep, diagonal((0.5, 0.75, -2), (10, -20, -30)), 3)

# Archives: of a folder's content, stored; and of a folder, deflated. The fuzzer takes its seeds from files of volumes.
for archive, of, top, method in [("../volumes/image-0.5.ozx", "image-0.5.zarr", "", zipfile.ZIP_STORED),
                                 ("../volumes/v3-shards.zarr.zip", "v3-shards.zarr", "shards.zarr/", zipfile.ZIP_DEFLATED)]:
    with zipfile.ZipFile(archive, "w", method) as out:
        for file in sorted(file for file in Path(of).rglob("*") if file.is_file()):
            out.writestr(zipfile.ZipInfo(top + file.relative_to(of).as_posix()), file.read_bytes(), method)
    expected.append(next(e for e in expected if e["path"] == of) | {"path": archive})

lines = ",\n".join(json.dumps(e, ensure_ascii=False) for e in expected)
Path("expected.json").write_text(f"[\n{lines}\n]\n")
