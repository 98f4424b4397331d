#!/usr/bin/env python3
"""Writes archives of NumPy and the volumes of neuroimaging packages: FreeSurfer, AFNI, Philips and MINC. Beside them it
writes expected-neuro.json, expected-neuro-times.json and expected-minc.json: what NumPy and nibabel read there.

    pip install numpy==2.4.6 nibabel==5.4.2 h5py==3.16.0 scipy==1.17.1
    python make_neuro.py

Samples are the samples of make.py, at several points in time the samples of make_several.py. Affines are 3 x 4, from
lattice to world, as in expected.json.
"""

import gzip
import json
import os
import time
from pathlib import Path

import h5py
import nibabel as nib
import numpy as np
from nibabel.freesurfer.mghformat import MGHImage
from scipy.io import netcdf_file

os.chdir(Path(__file__).parent)
DIMS = (3, 4, 5)
N = 60
FLIP = np.diag([-1.0, -1.0, 1.0])
ROTATION = np.array([[2, -1, 2], [2, 2, -1], [-1, 2, 2]]) / 3
# Sums and halves of these numbers have no rounding in f32.
SPACING = np.array([0.75, 1.5, 3.0])
ORIGIN = np.array([10.0, -20.0, 30.5])
AFFINE = np.vstack([np.column_stack([ROTATION * SPACING, ORIGIN]), [0, 0, 0, 1]])

expected, times, minc = [], [], []


def samples(name, t=0):
    """The samples of a type at a point in time, in an array indexed [x, y, z]."""
    n = (np.arange(N) + 13 * t) % N
    values = {"u8": 3 * n + 5, "u16": 1000 * n + 257, "i16": 1000 * n - 29000, "f32": n * 0.25 - 3.125}[name]
    types = {"u8": np.uint8, "u16": np.uint16, "i16": np.int16, "f32": np.float32}
    return values.astype(types[name]).reshape(DIMS, order="F")


def add(file, name, affine, oriented, got, slope=1.0, intercept=0.0, unit="mm"):
    """Records the expected contents of a file, after the reference implementation has read the intended samples."""
    affine = np.asarray(affine, float)[:3, :4].tolist()
    common = dict(file=file, type=name, affine=affine, oriented=oriented, unit=unit)
    if got.ndim == 3:
        assert np.array_equal(got, samples(name)), file
        expected.append({**common, "slope": slope, "intercept": intercept})
        return
    assert np.array_equal(got, np.stack([samples(name, t) for t in range(got.shape[3])], axis=-1)), file
    times.append({**common, "channels": 1, "times": got.shape[3], "labels": []})


def series(name):
    return np.stack([samples(name, t) for t in range(3)], axis=-1)


# --- NumPy --------------------------------------------------------------------------------------------------------

# Members have the time of writing.
time.localtime = lambda *_: time.gmtime(315532800)
np.savez("stored-i16.npz", spacing=SPACING, ct=samples("i16").T)
np.savez_compressed("deflated-f32.npz", samples("f32").T)
np.savez_compressed("fortran-u8.npz", a=np.asfortranarray(samples("u8").T))
for file, name, key in [("stored-i16.npz", "i16", "ct"), ("deflated-f32.npz", "f32", "arr_0"), ("fortran-u8.npz", "u8", "a")]:
    add(file, name, np.eye(4), False, np.load(file)[key].T, unit="")
np.savez("times-i16.npz", series("i16").T)
add("times-i16.npz", "i16", np.eye(4), False, np.load("times-i16.npz")["arr_0"].T, unit="")

# --- FreeSurfer ---------------------------------------------------------------------------------------------------


def mgh(file, name, data):
    MGHImage(data, AFFINE).to_filename("whole.mgh")
    content = Path("whole.mgh").read_bytes()
    Path(file).write_bytes(gzip.compress(content, mtime=0) if file.endswith(".mgz") else content)
    Path("whole.mgh").unlink()
    image = nib.load(file)
    # The matrix of nibabel is f32.
    header, sizes = image.header, np.array(DIMS)
    matrix = header["Mdc"].T.astype(float) * header["delta"].astype(float)
    origin = header["Pxyz_c"].astype(float) - matrix @ sizes / 2
    affine = np.column_stack([matrix, origin])
    assert np.allclose(affine, image.affine[:3], atol=1e-5), file
    add(file, name, FLIP @ affine, True, np.asanyarray(image.dataobj))


mgh("raw-u8.mgh", "u8", samples("u8"))
mgh("raw-i16.mgz", "i16", samples("i16"))
mgh("times-f32.mgz", "f32", series("f32"))

# --- AFNI ---------------------------------------------------------------------------------------------------------


def afni(file, name, data, code, order, factors, packed=False):
    count = data.shape[3] if data.ndim == 4 else 1
    attributes = [
        ("string", "TYPESTRING", "3DIM_HEAD_FUNC"), ("integer", "DATASET_RANK", [3, count, 0, 0, 0, 0, 0, 0]),
        ("integer", "DATASET_DIMENSIONS", [*DIMS, 0, 0]), ("integer", "BRICK_TYPES", [code] * count),
        ("float", "BRICK_FLOAT_FACS", factors), ("float", "DELTA", [0.75, -1.5, 3]),
        ("float", "ORIGIN", ORIGIN.tolist()), ("integer", "ORIENT_SPECIFIC", [0, 2, 4]),
        ("float", "IJK_TO_DICOM_REAL", [0.75, 0, 0, ORIGIN[0], 0, -1.5, 0, ORIGIN[1], 0, 0, 3, ORIGIN[2]]),
        ("string", "BYTEORDER_STRING", {"<": "LSB_FIRST", ">": "MSB_FIRST"}[order]),
    ]
    text = ""
    for kind, title, value in attributes:
        is_text = isinstance(value, str)
        content = f"'{value}~" if is_text else " " + " ".join(map(str, value))
        text += f"\ntype = {kind}-attribute\nname = {title}\ncount = {len(value) + is_text}\n{content}\n"
    Path(file).write_text(text)
    content = data.flatten(order="F").astype(data.dtype.newbyteorder(order)).tobytes()
    image = file.replace(".HEAD", ".BRIK")
    Path(image + ".gz" if packed else image).write_bytes(gzip.compress(content, mtime=0) if packed else content)
    image = nib.load(file)
    got = image.dataobj.get_unscaled()
    scaling = image.header.get_data_scaling()
    add(file, name, FLIP @ image.affine[:3], True, got[..., 0] if count == 1 else got,
        slope=1.0 if scaling is None else float(scaling[0]))


afni("scaled-i16+orig.HEAD", "i16", samples("i16"), 1, "<", [0.5])
afni("times-f32+tlrc.HEAD", "f32", series("f32"), 3, ">", [0, 0, 0], packed=True)

# --- Philips ------------------------------------------------------------------------------------------------------


def philips(file, name, data, version, places):
    """`places` are the places in the file of the sections of all volumes, in turn."""
    count = data.shape[3]
    fields = {
        "Examination name": "test", "Protocol name": "T1 test", "Max. number of slices/locations": DIMS[2],
        "Max. number of echoes": 1, "Max. number of dynamics": count, "Diffusion         <0=no 1=yes> ?": 0,
        "Dynamic scan      <0=no 1=yes> ?": 0, "Repetition time [ms]": 2000.0,
        "Angulation midslice(ap,fh,rl)[degr]": "-13.265  7.5  0.125",
        "Off Centre midslice(ap,fh,rl) [mm]": "2.508  30.339  -16.032",
    }
    text = "# === DATA DESCRIPTION FILE ======================================================\n#\n"
    text += f"# CLINICAL TRYOUT             Research image export tool     {version}\n#\n"
    text += "".join(f".    {title:<35}:   {value}\n" for title, value in fields.items())
    text += "#\n# === IMAGE INFORMATION ==========================================================\n\n"
    lines, content = [None] * len(places), [None] * len(places)
    for n, place in enumerate(places):
        t, z = divmod(n, DIMS[2])
        lines[place] = (f"{z + 1} 1 {t + 1} 1 0 2 {place} 16 62 3 4 -1.5 0.75 4.28e-003 1070 1860 0 0 0 0 0 0 2.0 1.0 0 1 0"
                        " 2 0.75 1.5 30 0 0 0 0 90 0 0 0 39 0.0" + {"V4": "", "V4.2": " 1 1 8 0 0 0 0 1"}[version])
        content[place] = data[:, :, z, t].flatten(order="F").astype("<u2").tobytes()
    Path(file).write_text(text + "\n".join(lines) + "\n\n# === END OF DATA DESCRIPTION FILE\n")
    Path(file.replace(".PAR", ".REC")).write_bytes(b"".join(content))
    image = nib.load(file)
    slope, intercept = image.header.get_data_scaling()
    add(file, name, FLIP @ image.affine[:3], True, image.dataobj.get_unscaled(), slope=float(slope.flat[0]),
        intercept=float(intercept.flat[0]))


philips("raw-u16.PAR", "u16", samples("u16")[..., None], "V4", range(5))
# Sections in the order of the scanner: two points in time of each, the last one first.
philips("times-u16.PAR", "u16", series("u16")[..., :2], "V4.2", [2 * (4 - z) + t for t in range(2) for z in range(5)])


# --- MINC ---------------------------------------------------------------------------------------------------------

# Axes that are oblique, one of which runs backwards.
STEPS, STARTS = SPACING * [1, -1, 1], ROTATION.T @ ORIGIN


def axes_of_minc(add):
    for a, name in enumerate(["xspace", "yspace", "zspace"]):
        add(name, dict(start=STARTS[a], step=STEPS[a], direction_cosines=ROTATION[:, a], units=b"mm", spacing=b"regular__"))


def minc1(file, name, low, high, scaled, **attributes):
    """`low` and `high` are values of the ends of the valid range, along the axes `scaled`."""
    with netcdf_file(file, "w") as out:
        for axis, size in zip(["xspace", "yspace", "zspace"], DIMS):
            out.createDimension(axis, size)

        def variable(title, kind, along, values, stated):
            found = out.createVariable(title, kind, along)
            found[...] = values
            for key, value in stated.items():
                setattr(found, key, value)

        axes_of_minc(lambda title, stated: variable(title, "i", (), 0, stated))
        kind = {"u8": "b", "i16": "h"}[name]
        values = samples(name).T
        variable("image", kind, ("zspace", "yspace", "xspace"), values.astype(np.int8 if name == "u8" else np.int16), attributes)
        variable("image-min", "d", scaled, low, {})
        variable("image-max", "d", scaled, high, {})
    return nib.load(file)


def minc2(file, name, low, high, valid):
    with h5py.File(file, "w", track_order=False) as out:
        def dimension(title, stated):
            found = out.create_dataset(f"minc-2.0/dimensions/{title}", data=0)
            for key, value in stated.items():
                found.attrs[key] = np.bytes_(value) if isinstance(value, bytes) else value

        axes_of_minc(dimension)
        image = out.create_dataset("minc-2.0/image/0/image", data=samples(name).T, compression="gzip")
        image.attrs["dimorder"] = np.bytes_("zspace,yspace,xspace")
        image.attrs["valid_range"] = np.array(valid, float)
        for title, value in [("image-min", low), ("image-max", high)]:
            out.create_dataset(f"minc-2.0/image/0/{title}", data=float(value))
    return nib.load(file)


def check_minc(file, name, image, low, high, valid):
    slope = (high - low) / (valid[1] - valid[0])
    intercept = low - valid[0] * slope
    assert np.allclose(np.asanyarray(image.dataobj), samples(name).T * slope + intercept), file
    # Axes of nibabel are in the order of the file: z, y, x.
    affine = (FLIP @ image.affine[:3])[:, [2, 1, 0, 3]]
    minc.append(dict(file=file, type=name, affine=affine.tolist(), oriented=True, slope=slope, intercept=intercept, unit="mm"))


check_minc("minc1-i16.mnc", "i16", minc1("minc1-i16.mnc", "i16", -3.0, 5.5, (), signtype=b"signed__"), -3.0, 5.5,
           [-32768, 32767])
check_minc("minc2-u8.mnc", "u8", minc2("minc2-u8.mnc", "u8", 0.25, 4.0, [1, 250]), 0.25, 4.0, [1, 250])
# Sections with ranges of their own, and integers beyond the valid range, which a separate test reads.
low, high = -np.arange(5.0), np.arange(5.0) + 1
image = minc1("sections-u8.mnc", "u8", low, high, ("zspace",), valid_range=np.array([20.0, 150.0]), signtype=b"unsigned")
slopes = (high - low) / 130
values = np.clip(samples("u8").T, 20, 150) * slopes[:, None, None] + (low - 20 * slopes)[:, None, None]
assert np.allclose(np.asanyarray(image.dataobj), values)


def table(file, entries):
    lines = ",\n".join(json.dumps(e, ensure_ascii=False) for e in sorted(entries, key=lambda e: e["file"]))
    Path(file).write_text(f"[\n{lines}\n]\n")


table("expected-neuro.json", expected)
table("expected-neuro-times.json", times)
table("expected-minc.json", minc)
