#!/usr/bin/env python3
"""Writes the volumes of this folder and, beside them, expected.json: what the reference implementations read there.

    pip install numpy==2.4.6 nibabel==5.4.2 pynrrd==1.1.3 SimpleITK==2.5.7
    python make.py

Every volume has 3 x 4 x 5 samples, the n-th of which (x fastest) is a fixed function of n for each type; see `samples`.
Affines in expected.json are 3 x 4, from lattice to DICOM patient space (LPS) where the file is oriented.
"""

import gzip
import json
import os
import zlib
from pathlib import Path

import nibabel as nib
import nrrd
import numpy as np
import SimpleITK as sitk

os.chdir(Path(__file__).parent)
DIMS = (3, 4, 5)
N = 60
FLIP = np.diag([-1.0, -1.0, 1.0])
TYPES = {
    "u8": np.uint8, "i8": np.int8, "u16": np.uint16, "i16": np.int16, "u32": np.uint32, "i32": np.int32,
    "u64": np.uint64, "i64": np.int64, "f32": np.float32, "f64": np.float64,
}

# A rotation in thirds, so that no axis is near another; spacing and origin distinguish the axes.
ROTATION = np.array([[2, -1, 2], [2, 2, -1], [-1, 2, 2]]) / 3
SPACING = np.array([0.5, 0.75, 2.0])
ORIGIN = np.array([10.0, -20.0, 30.5])
OBLIQUE = np.column_stack([ROTATION * SPACING, ORIGIN])
# Sheared and left-handed: a general affine.
SHEARED = np.array([[-0.5, 0.25, 0.0, 4.0], [0.0, 1.5, 0.125, 5.0], [0.0, 0.5, 2.0, -6.0]])

expected = []


def samples(name):
    """The samples of a type, in an array indexed [x, y, z]."""
    n = np.arange(N)
    values = {
        "u8": 3 * n + 5, "i8": 4 * n - 120, "u16": 1000 * n + 257, "i16": 1000 * n - 29000,
        "u32": 70_000_000 * n + 1, "i32": 70_000_000 * n - 2_100_000_000,
        "u64": 300_000_000_000_000_000 * n.astype(np.uint64) + np.uint64(1),
        "i64": 300_000_000_000_000_000 * (n - 30) + 1,
        "f32": n * 0.25 - 3.125, "f64": n / 3 - 7.1,
    }[name]
    return values.astype(TYPES[name]).reshape(DIMS, order="F")


def add(file, name, affine, oriented, got, slope=1.0, intercept=0.0):
    """Records the expected contents of a file, after the reference implementation has read the intended samples."""
    assert got.shape == DIMS, (file, got.shape)
    assert np.array_equal(got, samples(name)), file
    affine = np.asarray(affine, float)[:3, :4].tolist()
    expected.append(dict(file=file, type=name, affine=affine, oriented=oriented, slope=slope, intercept=intercept))


# --- NRRD ---------------------------------------------------------------------------------------------------------

def affine_of_nrrd(header):
    """The affine of a header as pynrrd parses it, its space turned to LPS."""
    if "space directions" not in header:
        return np.column_stack([np.diag(header.get("spacings", [1, 1, 1])), [0, 0, 0]])
    directions = np.asarray(header["space directions"])
    directions = directions[~np.isnan(directions).any(axis=1)]
    flip = {
        "left-posterior-superior": [1, 1, 1], "right-anterior-superior": [-1, -1, 1], "RAS": [-1, -1, 1],
        "left-anterior-superior": [1, -1, 1],
    }.get(header.get("space"), [1, 1, 1])
    return np.diag(flip) @ np.column_stack([directions.T, header.get("space origin", [0, 0, 0])])


def check_nrrd(file, name, oriented):
    data, header = nrrd.read(file)
    add(file, name, affine_of_nrrd(header), oriented, data.reshape(DIMS, order="F"))


def oriented(space, affine):
    return {"space": space, "space directions": affine[:, :3].T, "space origin": affine[:, 3]}


def write_nrrd(file, data, header, **options):
    """nrrd.write without the time of writing, so that a file changes only with its contents."""
    nrrd.write(file, data, header, **options)
    lines = Path(file).read_bytes().split(b"\n")
    Path(file).write_bytes(b"\n".join(line for line in lines if not line.startswith(b"# on 20")))


for t in TYPES:
    write_nrrd(f"raw-{t}.nrrd", samples(t), {"encoding": "raw", "spacings": [0.5, 0.75, 2.0]})
    check_nrrd(f"raw-{t}.nrrd", t, False)
for t in ["i16", "u32", "f64"]:
    big = samples(t).astype(np.dtype(TYPES[t]).newbyteorder(">"))
    write_nrrd(f"big-{t}.nrrd", big, {"encoding": "raw", "endian": "big", **oriented("left-posterior-superior", OBLIQUE)})
    check_nrrd(f"big-{t}.nrrd", t, True)
for t in ["i8", "u16", "f32"]:
    write_nrrd(f"gzip-{t}.nrrd", samples(t), {"encoding": "gzip", **oriented("right-anterior-superior", OBLIQUE)})
    check_nrrd(f"gzip-{t}.nrrd", t, True)
for t in ["u8", "i32", "f64"]:
    write_nrrd(f"text-{t}.nrrd", samples(t), {"encoding": "ascii", **oriented("left-anterior-superior", SHEARED)})
    check_nrrd(f"text-{t}.nrrd", t, True)
write_nrrd("scanner.nrrd", samples("i16"), {"encoding": "raw", **oriented("scanner-xyz", OBLIQUE)})
check_nrrd("scanner.nrrd", "i16", False)
write_nrrd("detached-raw.nhdr", samples("i16"), {"encoding": "raw", **oriented("RAS", SHEARED)}, detached_header=True)
check_nrrd("detached-raw.nhdr", "i16", True)
write_nrrd("detached-gzip.nhdr", samples("f32"), {"encoding": "gzip"}, detached_header=True)
check_nrrd("detached-gzip.nhdr", "f32", False)


def by_hand(file, lines, data=b"", newline="\n", version=5):
    text = newline.join([f"NRRD000{version}", "# written by hand", *lines, "", ""])
    Path(file).write_bytes(text.encode() + data)


def flat(name, order="<"):
    return samples(name).flatten(order="F").astype(np.dtype(TYPES[name]).newbyteorder(order)).tobytes()


COMMON = ["dimension: 3", "sizes: 3 4 5"]
by_hand("crlf.nrrd", ["type: signed  short int", *COMMON, "Endian: little", "encoding: raw",
                      "spacings:  1   2  3 ", "comment:=CRLF at the ends of lines"], flat("i16"), newline="\r\n", version=1)
add("crlf.nrrd", "i16", np.column_stack([np.diag([1, 2, 3]), [0, 0, 0]]), False, samples("i16"))
by_hand("hex-u16.nrrd", ["type: ushort", *COMMON, "endian: big", "encoding: hex"],
        "\n".join(flat("u16", ">").hex()[i:i + 64] for i in range(0, 240, 64)).encode())
add("hex-u16.nrrd", "u16", np.eye(4), False, samples("u16"))
# Two lines, then seven bytes, before the samples; and all bytes skipped except the last ones.
Path("skipped.raw").write_bytes(b"one\ntwo\n1234567" + flat("i16"))
by_hand("skip.nhdr", ["type: short", *COMMON, "endian: little", "encoding: raw", "line skip: 2", "byte skip: 7",
                      "data file: skipped.raw"])
by_hand("skip-to-end.nhdr", ["type: short", *COMMON, "endian: little", "encoding: raw", "byteskip: -1",
                             "datafile: skipped.raw"])
for file in ["skip.nhdr", "skip-to-end.nhdr"]:
    check_nrrd(file, "i16", False)
for z in range(5):
    Path(f"slice{z + 7:02}.raw").write_bytes(flat("i16")[24 * z:24 * z + 24])
    Path(f"slice{z + 7:02}.z").write_bytes(zlib.compress(flat("i16")[24 * z:24 * z + 24]))
by_hand("list.nhdr", ["type: short", *COMMON, "endian: little", "encoding: raw", "data file: LIST",
                      *[f"slice{z + 7:02}.raw" for z in range(5)]])
# Teem counts a blank line after the list as a file.
Path("list.nhdr").write_bytes(Path("list.nhdr").read_bytes().rstrip() + b"\n")
by_hand("pattern.nhdr", ["type: short", *COMMON, "endian: little", "encoding: raw",
                         "data file: slice%02d.raw 7 11 1 2"])
# Four axes; the first or the last has a single sample.
by_hand("vector-axis.nrrd", ["type: short", "dimension: 4", "sizes: 1 3 4 5", "endian: little", "encoding: raw",
                             "kinds: vector domain domain domain", "space: left-posterior-superior",
                             "space directions: none (-0.5,0,0) (0.25, 1.5, 0.5) (0,0.125,2)",
                             "space origin: (4,5,-6)"], flat("i16"))
by_hand("time-axis.nrrd", ["type: short", "dimension: 4", "sizes: 3 4 5 1", "endian: little", "encoding: raw",
                           "spacings: 0.5 0.75 2 NaN", "kinds: space space space time"], flat("i16"))
add("vector-axis.nrrd", "i16", SHEARED, True, samples("i16"))
add("time-axis.nrrd", "i16", np.column_stack([np.diag(SPACING), [0, 0, 0]]), False, samples("i16"))


# --- SimpleITK: MetaImage, and NRRD as ITK writes and reads it --------------------------------------------------------

def itk_image(name):
    image = sitk.GetImageFromArray(samples(name).transpose())
    image.SetDirection(ROTATION.flatten())
    image.SetSpacing(SPACING)
    image.SetOrigin(ORIGIN)
    return image


def check_itk(file, name, oriented=True, slope=1.0, intercept=0.0):
    image = sitk.ReadImage(file)
    got = sitk.GetArrayFromImage(image).transpose()
    if got.ndim == 4:
        got = got[..., 0]
    d = image.GetDimension()
    matrix = (np.array(image.GetDirection()).reshape(d, d) * image.GetSpacing())[:3, :3]
    add(file, name, np.column_stack([matrix, image.GetOrigin()[:3]]), oriented, got, slope, intercept)


for file in ["list.nhdr", "pattern.nhdr"]:
    check_itk(file, "i16", oriented=False)
sitk.WriteImage(itk_image("i16"), "itk.nrrd", True)
check_itk("itk.nrrd", "i16")
for t in TYPES:
    sitk.WriteImage(itk_image(t), f"raw-{t}.mha")
    check_itk(f"raw-{t}.mha", t)
for t in ["u8", "i32", "f64"]:
    sitk.WriteImage(itk_image(t), f"zlib-{t}.mha", True)
    check_itk(f"zlib-{t}.mha", t)
sitk.WriteImage(itk_image("i16"), "raw.mhd")
check_itk("raw.mhd", "i16")
sitk.WriteImage(itk_image("f32"), "zlib.mhd", True)
text = Path("zlib.mhd").read_text()
Path("zlib.mhd").write_text("".join(line for line in text.splitlines(True) if "CompressedDataSize" not in line))
check_itk("zlib.mhd", "f32")


def metaimage(file, lines, data_file, data=b"", dims="3 4 5"):
    header = "\n".join([f"NDims = {len(dims.split())}", f"DimSize = {dims}", *lines, f"ElementDataFile = {data_file}", ""])
    Path(file).write_bytes(header.encode() + data)


for t, met in [("i16", "MET_SHORT"), ("u32", "MET_ULONG"), ("f64", "MET_DOUBLE")]:
    metaimage(f"big-{t}.mha", ["ElementByteOrderMSB = True", "ElementSize = 0.5 0.75 2", "Position = 1 2 3",
                               f"ElementType = {met}"], "LOCAL", flat(t, ">"))
    check_itk(f"big-{t}.mha", t, oriented=False)
metaimage("rotation.mhd", ["BinaryDataByteOrderMSB = False", "Rotation = 0 1 0 0 0 1 1 0 0", "Origin = 1 2 3",
                           "ElementSpacing = 0.5 0.75 2", "HeaderSize = -1", "ElementType = MET_SHORT"], "skipped.raw")
metaimage("header-size.mhd", ["HeaderSize = 15", "ElementType = MET_SHORT"], "skipped.raw")
metaimage("list.mhd", ["ElementType = MET_SHORT"], "LIST\n" + "\n".join(f"slice{z + 7:02}.raw" for z in range(5)))
metaimage("pattern.mhd", ["ElementType = MET_SHORT"], "slice%02d.raw 7 11 1")
metaimage("four-axes.mha", ["ElementType = MET_SHORT", "TransformMatrix = 0 1 0 0 0 0 1 0 1 0 0 0 0 0 0 1"], "LOCAL",
          flat("i16"), dims="3 4 5 1")
for file in ["rotation.mhd", "header-size.mhd", "list.mhd", "pattern.mhd", "four-axes.mha"]:
    check_itk(file, "i16", oriented=file in ["rotation.mhd", "four-axes.mha"])
metaimage("text-f32.mha", ["BinaryData = False", "ElementType = MET_FLOAT"], "LOCAL",
          " ".join(map(str, samples("f32").flatten(order="F"))).encode() + b"\n")
check_itk("text-f32.mha", "f32", oriented=False)
metaimage("zlib-slices.mhd", ["CompressedData = True", "ElementType = MET_SHORT"], "slice%02d.z 7 11 1")
check_itk("zlib-slices.mhd", "i16", oriented=False)
# ITK reads the numbers and leaves the map to its user.
metaimage("hounsfield.mha", ["ElementToIntensityFunctionSlope = 0.5", "ElementToIntensityFunctionOffset = -1000",
                             "ElementType = MET_SHORT"], "LOCAL", flat("i16"))
check_itk("hounsfield.mha", "i16", oriented=False, slope=0.5, intercept=-1000.0)


# --- NIfTI --------------------------------------------------------------------------------------------------------

RAS_SHEARED = np.vstack([FLIP @ SHEARED, [0, 0, 0, 1]])
# A rotation whose third axis is mirrored, which only qfac can express.
RAS_MIRRORED = np.vstack([FLIP @ OBLIQUE * [1, 1, -1, 1], [0, 0, 0, 1]])


def check_nifti(file, name, oriented=True):
    image = nib.load(file)
    got = np.asanyarray(image.dataobj.get_unscaled())
    if got.ndim == 4:
        got = got[..., 0]
    slope, intercept = image.dataobj.slope, image.dataobj.inter
    add(file, name, FLIP @ image.affine[:3], oriented, got, float(slope), float(intercept))


def nifti(file, name, cls=nib.Nifti1Image, endian="<", sform=RAS_SHEARED, qform=None, shape=DIMS, slope=1.0, inter=0.0):
    header = cls.header_class(endianness=endian)
    header.set_data_dtype(TYPES[name])
    image = cls(samples(name).reshape(shape, order="F"), None, header)
    image.header.set_sform(sform, code=0 if sform is None else 2)
    image.header.set_qform(qform, code=0 if qform is None else 1)
    image.header.set_slope_inter(slope, inter)
    if sform is None and qform is None:
        image.header.set_zooms(SPACING)
    nib.save(image, file)


for t in TYPES:
    nifti(f"raw-{t}.nii", t)
    check_nifti(f"raw-{t}.nii", t)
for t in ["i16", "u32", "f64"]:
    nifti(f"big-{t}.nii", t, endian=">")
    check_nifti(f"big-{t}.nii", t)
nifti("gzip-i16.nii.gz", "i16")
nifti("sform-over-qform.nii", "u8", qform=RAS_MIRRORED)
nifti("qform.nii", "u8", sform=None, qform=RAS_MIRRORED)
nifti("qform-big-2.nii", "u8", cls=nib.Nifti2Image, endian=">", sform=None, qform=RAS_MIRRORED)
nifti("four-axes.nii", "i16", shape=(3, 4, 5, 1))
nifti("nifti2-i16.nii", "i16", cls=nib.Nifti2Image)
nifti("nifti2-big-f32.nii.gz", "f32", cls=nib.Nifti2Image, endian=">")
nifti("pair-i16.hdr", "i16", cls=nib.Nifti1Pair)
nifti("pair-gzip-f32.hdr.gz", "f32", cls=nib.Nifti1Pair)
nifti("pair2-big-i16.hdr", "i16", cls=nib.Nifti2Pair, endian=">")
nifti("scaled.nii", "i16", slope=0.5, inter=-100.0)
for file, t in [("gzip-i16.nii.gz", "i16"), ("sform-over-qform.nii", "u8"), ("qform.nii", "u8"),
                ("qform-big-2.nii", "u8"), ("four-axes.nii", "i16"), ("nifti2-i16.nii", "i16"),
                ("nifti2-big-f32.nii.gz", "f32"), ("pair-i16.hdr", "i16"), ("pair-gzip-f32.hdr.gz", "f32"),
                ("pair2-big-i16.hdr", "i16"), ("scaled.nii", "i16")]:
    check_nifti(file, t)
nifti("no-form.nii", "u8", sform=None)
check_nifti("no-form.nii", "u8", oriented=False)
image = nib.load("raw-u8.nii")
image.header.extensions.append(nib.nifti1.Nifti1Extension("comment", b"an extension before the samples"))
nib.save(nib.Nifti1Image(np.asanyarray(image.dataobj), None, image.header), "extension.nii")
check_nifti("extension.nii", "u8")


# --- NumPy --------------------------------------------------------------------------------------------------------

def npy(file, name, array, version=None):
    with open(file, "wb") as f:
        np.lib.format.write_array(f, array, version=version)
    got = np.load(file)
    add(file, name, np.eye(4), False, got.reshape(DIMS[::-1]).transpose().astype(TYPES[name]))


def zyx(name):
    return np.ascontiguousarray(samples(name).transpose())


for t in TYPES:
    npy(f"raw-{t}.npy", t, zyx(t))
for t in ["i16", "u32", "f64"]:
    npy(f"big-{t}.npy", t, zyx(t).astype(np.dtype(TYPES[t]).newbyteorder(">")))
for t in ["u8", "i16", "f64"]:
    npy(f"fortran-{t}.npy", t, np.asfortranarray(zyx(t)))
npy("half.npy", "f32", zyx("f32").astype(np.float16))
npy("half-big.npy", "f32", zyx("f32").astype(">f2"))
npy("version2.npy", "i16", zyx("i16"), version=(2, 0))
npy("version3.npy", "i16", zyx("i16"), version=(3, 0))
npy("four-axes.npy", "i16", zyx("i16")[:, None])
with open("bool.npy", "wb") as f:
    np.save(f, zyx("u8") % 2 == 1)
with gzip.GzipFile("gzip-i16.npy.gz", "wb", mtime=0) as f:
    np.save(f, zyx("i16"))
add("gzip-i16.npy.gz", "i16", np.eye(4), False, samples("i16"))

expected.sort(key=lambda e: e["file"])
lines = ",\n".join(json.dumps(e) for e in expected)
Path("expected.json").write_text(f"[\n{lines}\n]\n")
