#!/usr/bin/env python3
"""Writes files as users reported them and, beside them, expected-reported.json and expected-reported-several.json: what
the reference implementations read there.

    pip install numpy==2.4.6 tifffile==2026.3.3 imagecodecs==2026.3.6 vtk==9.7.2
    python make_reported.py

Samples are those of make.py and make_several.py. Affines are 3 x 4, from lattice to world, as in expected.json.
"""

import json
import os
import struct
from pathlib import Path

import numpy as np
import tifffile
import vtk
from vtk.util import numpy_support

os.chdir(Path(__file__).parent)
DIMS = (3, 4, 5)
N = 60
SPACING = (0.5, 0.75, 2.0)
GREY = {"photometric": "minisblack", "software": False}
expected, several = [], []


def volume(name, c=0, t=0):
    """The samples of a channel at a point in time, indexed [z, y, x]."""
    n = (np.arange(N) + 7 * c + 13 * t) % N
    values = {"u8": 3 * n + 5, "i16": 1000 * n - 29000, "u16": 1000 * n + 257}[name]
    return values.astype({"u8": np.uint8, "i16": np.int16, "u16": np.uint16}[name]).reshape(DIMS[::-1])


def add(file, name, got, spacing=(1, 1, 1), unit=""):
    """Records the expected contents of a file, after the reference implementation has read the intended samples."""
    assert np.array_equal(got, volume(name)), file
    affine = np.column_stack([np.diag(spacing), (0, 0, 0)]).tolist()
    expected.append(dict(file=file, type=name, affine=affine, oriented=False, slope=1.0, intercept=0.0, unit=unit))


def add_several(file, name, got):
    """As add, of samples indexed [t, c, z, y, x]."""
    times, channels = got.shape[:2]
    assert np.array_equal(got, [[volume(name, c, t) for c in range(channels)] for t in range(times)]), file
    affine = np.column_stack([np.eye(3), (0, 0, 0)]).tolist()
    several.append(dict(file=file, type=name, channels=channels, times=times, affine=affine, oriented=False, unit="",
                        labels=[]))


# --- TIFF ---------------------------------------------------------------------------------------------------------

# A tile with several sections (ImageDepth and TileDepth of SGI), and more tiles than one along each axis.
tifffile.imwrite("tile-3d.tif", volume("u8"), tile=(16, 16, 16), compression="zlib", metadata={"axes": "ZYX"}, **GREY)
add("tile-3d.tif", "u8", tifffile.imread("tile-3d.tif"))
z, y, x = np.mgrid[:33, :18, :20]
ramp = (x + 20 * y + 360 * z).astype(np.uint16)
for order, name in (("<", "tiles-3d.tif"), (">", "tiles-3d-big.tif")):
    tifffile.imwrite(name, ramp, tile=(16, 16, 16), compression="zlib", predictor=True, byteorder=order,
                     bigtiff=order == ">", metadata=None, **GREY)
    assert np.array_equal(tifffile.imread(name).squeeze(), ramp), name

# Strips of a page with sections: tifffile writes a page of 20 rows, and its tags are changed.
tifffile.imwrite("strips-3d.tif", volume("i16").reshape(20, 3), rowsperstrip=2, compression="zlib", metadata=None,
                 extratags=[(65000, 3, 1, 5, True)], **GREY)
with tifffile.TiffFile("strips-3d.tif", mode="r+") as file:
    file.pages[0].tags["ImageLength"].overwrite(4)
data = Path("strips-3d.tif").read_bytes()
entry = struct.pack("<HHI", 65000, 3, 1)
assert data.count(entry) == 1
Path("strips-3d.tif").write_bytes(data.replace(entry, struct.pack("<HHI", 32997, 3, 1)))
add("strips-3d.tif", "i16", tifffile.imread("strips-3d.tif").squeeze())

# The axes that tifffile states.
for axes, shape in (("CZYX", (2, 5)), ("ZCYX", (5, 2)), ("TZYX", (3, 5)), ("TZCYX", (3, 5, 2))):
    file = f"shaped-{axes.lower()}.tif"
    times, channels = (3 if "T" in axes else 1), (2 if "C" in axes else 1)
    data = np.array([[volume("u8", c, t) for c in range(channels)] for t in range(times)])
    present = axes.lower()
    absent = "".join(axis for axis in "tc" if axis not in present)
    moved = np.einsum(f"tczyx->{present}{absent}", data).reshape(shape + (4, 3))
    tifffile.imwrite(file, moved, metadata={"axes": axes}, **GREY)
    with tifffile.TiffFile(file) as read:
        series = read.series[0]
        assert series.axes == axes, (file, series.axes)
        got = series.asarray().transpose([axes.index(axis) for axis in "TCZYX" if axis in axes])
    add_several(file, "u8", got.reshape(data.shape))

# Bits, 0 is white; and a palette, as ImageJ saves grey values with a look-up table.
tifffile.imwrite("bits.tif", volume("u8") > 90, metadata={"axes": "ZYX"}, software=False)
assert np.array_equal(tifffile.imread("bits.tif"), volume("u8") > 90)
tifffile.imwrite("white.tif", volume("u8"), photometric="miniswhite", compression="zlib", metadata=None, software=False)
add("white.tif", "u8", tifffile.imread("white.tif"))
colors = np.zeros((3, 256), np.uint16)
colors[1] = np.arange(256) * 257
text = "ImageJ=1.53t\nimages=5\nslices=5\nunit=micron\nspacing=2.0\nloop=false\n"
with tifffile.TiffWriter("look-up-table.tif") as out:
    for n, page in enumerate(volume("u8")):
        out.write(page, photometric="palette", colormap=colors, metadata=None, software=False, compression="packbits",
                  description=text if n == 0 else None, resolution=(2, 1 / 0.75), contiguous=False)
add("look-up-table.tif", "u8", tifffile.imread("look-up-table.tif", key=range(5)), spacing=SPACING, unit="µm")

# Lengths in several units, and several images in a file.
tifffile.imwrite("nanometres.ome.tif", volume("i16"), **GREY,
                 metadata={"axes": "ZYX", "PhysicalSizeX": 500, "PhysicalSizeXUnit": "nm", "PhysicalSizeY": 750,
                           "PhysicalSizeYUnit": "nm", "PhysicalSizeZ": 2, "PhysicalSizeZUnit": "µm"})
add("nanometres.ome.tif", "i16", tifffile.imread("nanometres.ome.tif"), spacing=SPACING, unit="µm")
with tifffile.TiffWriter("images.ome.tif", ome=True) as out:
    sizes = {"PhysicalSizeX": 0.5, "PhysicalSizeY": 0.75, "PhysicalSizeZ": 2.0}
    out.write(volume("i16"), metadata={"axes": "ZYX", "Name": "first", **sizes}, **GREY)
    out.write(volume("u8")[:3, :, :2], metadata={"axes": "ZYX", "Name": "second"}, **GREY)

# Complex numbers 3 - 4i, 6 - 8i and so on.
number = np.arange(1, N + 1).reshape(DIMS[::-1])
tifffile.imwrite("complex.tif", (number * (3 - 4j)).astype(np.complex64), metadata=None, **GREY)
assert np.array_equal(np.abs(tifffile.imread("complex.tif")), 5 * number)

# Zeiss LSM: a private tag, and a thumbnail behind each page.
info = struct.pack("<Ii5iiii6dH", 0x0400494C, 500, 3, 4, 5, 1, 1, 1, 3, 4, 5e-7, 7.5e-7, 2e-6, 0, 0, 0, 0)
info += bytes(500 - len(info))
with tifffile.TiffWriter("stack.lsm") as out:
    for n, page in enumerate(volume("u8")):
        tags = [(34412, 1, len(info), info, True)] if n == 0 else []
        out.write(page, metadata=None, extratags=tags, contiguous=False, **GREY)
        out.write(np.zeros((2, 2, 3), np.uint8), photometric="rgb", subfiletype=1, metadata=None, contiguous=False,
                  software=False)
with tifffile.TiffFile("stack.lsm") as file:
    sizes = [1e6 * file.lsm_metadata[f"VoxelSize{axis}"] for axis in "XYZ"]
    assert file.is_lsm and np.allclose(sizes, SPACING)
    add("stack.lsm", "u8", file.series[0].asarray(), spacing=SPACING, unit="µm")

# --- SLC ----------------------------------------------------------------------------------------------------------


def runs(plane):
    """A plane, compressed: runs of one value and runs of several, as VolVis writes them."""
    out, n = b"", 0
    while n < len(plane):
        length = 1
        while n + length < len(plane) and plane[n + length] == plane[n] and length < 127:
            length += 1
        out += bytes([length, plane[n]]) if length > 1 else bytes([0x80 | 1, plane[n]])
        n += length
    return out + b"\0"


def slc(file, compressed):
    data = volume("u8")
    head = f"11111\n3 4 5\n8\n0.5 0.75 2\n1 2 0 {int(compressed)}\n2 1 X"
    out = head.encode() + bytes(6)
    for plane in data:
        packed = runs(plane.tobytes())
        out += f"{len(packed)} X".encode() + packed if compressed else plane.tobytes()
    Path(file).write_bytes(out)
    reader = vtk.vtkSLCReader()
    reader.SetFileName(file)
    reader.Update()
    image = reader.GetOutput()
    assert image.GetSpacing() == SPACING and image.GetDimensions() == DIMS
    got = numpy_support.vtk_to_numpy(image.GetPointData().GetScalars()).reshape(DIMS[::-1])
    add(file, "u8", got, spacing=SPACING, unit="mm")


slc("raw-u8.slc", False)
slc("runs-u8.slc", True)

for name, table in (("expected-reported.json", expected), ("expected-reported-several.json", several)):
    Path(name).write_text(json.dumps(table, indent=1, ensure_ascii=False) + "\n")
