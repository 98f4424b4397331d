#!/usr/bin/env python3
"""Writes the volumes of this folder in formats of microscopy, simulation and hospitals and, beside them,
expected-more.json: what the reference implementations read there. It is to be run after make.py, whose samples these
volumes have.

    pip install numpy==2.4.6 mrcfile==1.5.4 vtk==9.7.2 tifffile==2026.3.3 imagecodecs==2026.3.6 pydicom==3.0.2 \
        pylibjpeg==2.1.0 pylibjpeg-libjpeg==2.5.0 pylibjpeg-openjpeg==2.6.0
    python make_more.py

Affines are 3 x 4, from lattice to world, as in expected.json.
"""

import gzip
import json
import os
from pathlib import Path

import imagecodecs
import mrcfile
import numpy as np
import openjpeg.utils
import pydicom
import tifffile
import vtk
from pydicom.encaps import encapsulate
from vtk.util import numpy_support

os.chdir(Path(__file__).parent)
DIMS = (3, 4, 5)
N = 60
TYPES = {
    "u8": np.uint8, "i8": np.int8, "u16": np.uint16, "i16": np.int16, "u32": np.uint32, "i32": np.int32,
    "u64": np.uint64, "i64": np.int64, "f32": np.float32, "f64": np.float64,
}
SPACING = np.array([0.5, 0.75, 2.0])
ORIGIN = np.array([10.0, -20.0, 30.5])

expected = []


def zyx(name):
    """The samples of a type as in make.py, in an array indexed [z, y, x]."""
    n = np.arange(N)
    values = {
        "u8": 3 * n + 5, "i8": 4 * n - 120, "u16": 1000 * n + 257, "i16": 1000 * n - 29000,
        "u32": 70_000_000 * n + 1, "i32": 70_000_000 * n - 2_100_000_000,
        "u64": 300_000_000_000_000_000 * n.astype(np.uint64) + np.uint64(1),
        "i64": 300_000_000_000_000_000 * (n - 30) + 1,
        "f32": n * 0.25 - 3.125, "f64": n / 3 - 7.1, "nibble": n % 16,
    }[name]
    return values.astype(TYPES.get(name, np.uint8)).reshape(DIMS[::-1])


def add(file, name, affine, got, oriented=False, slope=1.0, intercept=0.0, unit=""):
    """Records the expected contents of a file, after the reference implementation has read the intended samples."""
    assert got.shape == DIMS[::-1], (file, got.shape)
    assert np.array_equal(got, zyx(name)), file
    affine = np.asarray(affine, float)[:3, :4].tolist()
    expected.append(dict(file=file, type=name, affine=affine, oriented=oriented, slope=slope, intercept=intercept,
                         unit=unit))


def diagonal(spacing, origin=(0, 0, 0)):
    return np.column_stack([np.diag(spacing), origin])


# --- MRC ----------------------------------------------------------------------------------------------------------

def check_mrc(file, name, directions=np.eye(3), unit="Å"):
    """`directions` are the directions of columns, rows and sections: mrcfile leaves them to its user."""
    with mrcfile.open(file, permissive=True) as mrc:
        header = mrc.header
        axes = [int(header[axis]) - 1 for axis in ("mapc", "mapr", "maps")]
        steps = np.array([float(mrc.voxel_size[axis]) for axis in "xyz"])[axes]
        matrix = np.asarray(directions, float) * steps
        origin = np.array([float(header.origin[axis]) for axis in "xyz"])
        if not origin.any():
            origin = matrix @ [int(header[start]) for start in ("nxstart", "nystart", "nzstart")]
        add(file, name, np.column_stack([matrix, origin]), np.asarray(mrc.data).astype(TYPES.get(name, np.uint8)),
            unit=unit)


def mrc(file, data, change=lambda mrc: None, **options):
    with mrcfile.new(file, overwrite=True, **options) as out:
        out.set_data(data)
        out.voxel_size = tuple(SPACING)
        out.header.origin = tuple(ORIGIN)
        change(out)
        # The time of writing is in the labels.
        out.header.label[:] = b""
        out.header.nlabl = 0


def turned(out):
    out.header.mapc, out.header.mapr, out.header.maps = 3, 1, 2
    # MX and the cell belong to x, y and z; the data's axes are z, x and y.
    out.header.mx, out.header.my, out.header.mz = 4, 5, 3
    out.header.cella = (0.5 * 4, 0.75 * 5, 2.0 * 3)
    out.header.origin = (0, 0, 0)
    out.header.nxstart, out.header.nystart, out.header.nzstart = -7, 2, 30


def in_a_cell(out):
    out.header.cellb = (80, 95, 110)


for name in ["i8", "i16", "u16", "f32"]:
    mrc(f"raw-{name}.mrc", zyx(name))
    check_mrc(f"raw-{name}.mrc", name)
mrc("half.mrc", zyx("f32").astype(np.float16))
check_mrc("half.mrc", "f32")
for name in ["i16", "f32"]:
    big = zyx(name).astype(np.dtype(TYPES[name]).newbyteorder(">"))
    mrc(f"big-{name}.map", big)
    check_mrc(f"big-{name}.map", name)
mrc("turned.ccp4", zyx("i16"), turned)
check_mrc("turned.ccp4", "i16", [[0, 1, 0], [0, 0, 1], [1, 0, 0]])
alpha, beta, gamma = np.radians([80, 95, 110])
edge = [np.cos(beta), (np.cos(alpha) - np.cos(beta) * np.cos(gamma)) / np.sin(gamma)]
edges = np.column_stack([[1, 0, 0], [np.cos(gamma), np.sin(gamma), 0], [*edge, np.sqrt(1 - np.dot(edge, edge))]])
mrc("oblique-cell.map", zyx("i16"), in_a_cell)
check_mrc("oblique-cell.map", "i16", edges)


def extended(out):
    out.set_extended_header(np.frombuffer(b"an extended header of 48 bytes".ljust(48), dtype="V48"))


mrc("extended.mrc", zyx("i16"), extended)
check_mrc("extended.mrc", "i16")
with gzip.GzipFile("gzip-i16.mrc.gz", "wb", mtime=0) as out:
    out.write(Path("raw-i16.mrc").read_bytes())
check_mrc("gzip-i16.mrc.gz", "i16")


def by_hand(file, source, name, changes, data=None, **options):
    """A file with words that mrcfile does not write: `changes` are offsets and bytes."""
    content = bytearray(Path(source).read_bytes())
    for at, value in changes:
        content[at:at + len(value)] = value
    Path(file).write_bytes(bytes(content[:1024]) + (bytes(content[1024:]) if data is None else data))
    add(file, name, options.pop("affine", diagonal(SPACING, ORIGIN)), zyx(name), **{"unit": "Å", **options})


# 3 samples of 4 bits in 2 bytes, the first in the low half. mrcfile reads mode 101 as bytes.
nibbles = b"".join(bytes([row[0] | row[1] << 4, row[2]]) for row in zyx("nibble").reshape(-1, 3).tolist())
by_hand("nibbles.mrc", "raw-i8.mrc", "nibble", [(12, bytes([101, 0, 0, 0]))], nibbles)
# IMOD's stamp without the flag of signed bytes; no cell; a machine stamp of zeros.
by_hand("imod.mrc", "raw-i8.mrc", "u8", [(152, b"IMOD"), (156, bytes(4))], zyx("u8").tobytes())
by_hand("no-cell.mrc", "raw-i16.mrc", "i16", [(40, bytes(12)), (64, bytes(12)), (196, bytes(12)), (212, bytes(4))],
        affine=np.eye(4), unit="")


# --- VTK ----------------------------------------------------------------------------------------------------------

# A rotation in thirds, as in make.py.
ROTATION = np.array([[2, -1, 2], [2, 2, -1], [-1, 2, 2]]) / 3


def vtk_image(name, direction=np.eye(3), cells=False, first=(0, 0, 0), decoys=()):
    """An image with the samples as its active scalars, after other arrays."""
    image = vtk.vtkImageData()
    last = [a + n - (0 if cells else 1) for a, n in zip(first, DIMS)]
    image.SetExtent(first[0], last[0], first[1], last[1], first[2], last[2])
    image.SetSpacing(*SPACING)
    image.SetOrigin(*ORIGIN)
    image.SetDirectionMatrix(*np.asarray(direction, float).flatten())
    attributes = image.GetCellData() if cells else image.GetPointData()
    for decoy, data in decoys:
        array = numpy_support.numpy_to_vtk(data, deep=True)
        array.SetName(decoy)
        attributes.AddArray(array)
    array = numpy_support.numpy_to_vtk(zyx(name).flatten(), deep=True)
    array.SetName("samples of a test")
    attributes.AddArray(array)
    attributes.SetActiveScalars(array.GetName())
    return image


def check_vtk(file, name, reader):
    reader.SetFileName(file)
    reader.Update()
    image = reader.GetOutput()
    first = image.GetExtent()[::2]
    cells = image.GetPointData().GetScalars() is None
    data = image.GetCellData() if cells else image.GetPointData()
    direction = image.GetDirectionMatrix()
    matrix = np.array([[direction.GetElement(r, c) for c in range(3)] for r in range(3)]) * image.GetSpacing()
    shift = np.array(first) + (0.5 if cells else 0)
    origin = np.array(image.GetOrigin()) + matrix @ shift
    scalars = data.GetScalars() or data.GetArray(data.GetNumberOfArrays() - 1)
    got = numpy_support.vtk_to_numpy(scalars).reshape(DIMS[::-1])
    add(file, name, np.column_stack([matrix, origin]), got)


def vti(file, name, mode, compressor=None, wide=True, big=False, base64=False, **options):
    writer = vtk.vtkXMLImageDataWriter()
    writer.SetFileName(file)
    writer.SetInputData(vtk_image(name, **options))
    {"ascii": writer.SetDataModeToAscii, "binary": writer.SetDataModeToBinary,
     "appended": writer.SetDataModeToAppended}[mode]()
    {None: writer.SetCompressorTypeToNone, "zlib": writer.SetCompressorTypeToZLib,
     "lz4": writer.SetCompressorTypeToLZ4}[compressor]()
    # The smallest block size of VTK: the samples are in several blocks.
    writer.SetBlockSize(64)
    writer.SetEncodeAppendedData(base64)
    writer.SetHeaderTypeToUInt64() if wide else writer.SetHeaderTypeToUInt32()
    writer.SetByteOrderToBigEndian() if big else writer.SetByteOrderToLittleEndian()
    writer.Write()
    check_vtk(file, name, vtk.vtkXMLImageDataReader())


vectors = ("vectors", np.arange(3.0 * N).reshape(N, 3))
before = ("before", np.arange(N, dtype=np.int32))
for t in TYPES:
    vti(f"raw-{t}.vti", t, "appended")
vti("ascii-i16.vti", "i16", "ascii", direction=ROTATION)
vti("ascii-f32.vti", "f32", "ascii", decoys=[before])
vti("base64-i16.vti", "i16", "binary", wide=False, decoys=[vectors, before])
vti("base64-zlib-f64.vti", "f64", "binary", "zlib", first=(2, -3, 4), direction=ROTATION)
vti("zlib-i16.vti", "i16", "appended", "zlib", decoys=[before])
vti("lz4-f32.vti", "f32", "appended", "lz4", big=True)
vti("lz4-base64-u16.vti", "u16", "appended", "lz4", wide=False, base64=True, decoys=[before])
vti("cells-u8.vti", "u8", "appended", cells=True, first=(1, 0, 0), direction=ROTATION)


def legacy(file, name, binary, **options):
    writer = vtk.vtkStructuredPointsWriter()
    writer.SetFileName(file)
    writer.SetInputData(vtk_image(name, **options))
    writer.SetFileTypeToBinary() if binary else writer.SetFileTypeToASCII()
    writer.Write()
    check_vtk(file, name, vtk.vtkStructuredPointsReader())


for t in TYPES:
    legacy(f"raw-{t}.vtk", t, binary=True)
legacy("ascii-i16.vtk", "i16", binary=False, decoys=[vectors, before])
legacy("ascii-f32.vtk", "f32", binary=False, cells=True)
legacy("decoys-i16.vtk", "i16", binary=True, decoys=[vectors])


# --- TIFF ---------------------------------------------------------------------------------------------------------

def tif(file, name, check=None, spacing=(1, 1, 1), unit="", dtype=None, **options):
    data = zyx(name) if dtype is None else zyx(name).astype(dtype)
    tifffile.imwrite(file, data, metadata=options.pop("metadata", None), software=False, **options)
    check_tif(file, name, spacing, unit)


def check_tif(file, name, spacing, unit):
    got = tifffile.imread(file)
    add(file, name, diagonal(spacing), got.reshape(DIMS[::-1]).astype(TYPES[name]), unit=unit)


GREY = dict(photometric="minisblack")
for t in TYPES:
    tif(f"raw-{t}.tif", t, **GREY)
for t in ["i16", "f32"]:
    tif(f"big-{t}.tif", t, byteorder=">", bigtiff=True, **GREY)
tif("half.tif", "f32", dtype=np.float16, **GREY)
tif("lzw-u8.tif", "u8", compression="lzw", **GREY)
tif("packbits-u8.tif", "u8", compression="packbits", **GREY)
tif("deflate-i16.tif", "i16", compression="zlib", predictor=True, rowsperstrip=2, **GREY)
tif("deflate-f32.tif", "f32", compression="zlib", **GREY)
tif("tiles-u16.tif", "u16", tile=(16, 16), **GREY)
# ImageJ: pixels per micron in the resolution; one directory if the stack is contiguous.
tif("imagej-u16.tif", "u16", spacing=(0.5, 0.25, 2), unit="µm", imagej=True, resolution=(2, 4),
    metadata={"axes": "ZYX", "spacing": 2.0, "unit": "um"})
tif("ome-i16.ome.tif", "i16", spacing=(0.5, 0.75, 2), unit="µm", ome=True,
    metadata={"axes": "ZYX", "PhysicalSizeX": 0.5, "PhysicalSizeY": 0.75, "PhysicalSizeZ": 2.0,
              "UUID": "00000000-0000-0000-0000-000000000000"}, **GREY)
# A preview between the pages, as slide scanners write it.
with tifffile.TiffWriter("preview-i16.tif") as out:
    for z in range(5):
        out.write(zyx("i16")[z], metadata=None, software=False, compression="zlib", **GREY)
        if z == 1:
            out.write(zyx("i16")[z, ::2, ::2], metadata=None, software=False, subfiletype=1, **GREY)
got = np.stack([page.asarray() for page in tifffile.TiffFile("preview-i16.tif").pages if page.subfiletype == 0])
add("preview-i16.tif", "i16", np.eye(4), got)
# ImageJ's stack of over 4 GB: one directory, and the sections behind one another.
one = Path("one-directory.tif")
tifffile.imwrite(one, zyx("i16").astype(">i2")[0], byteorder=">", software=False, metadata=None,
                 description="ImageJ=1.54f\nimages=5\nslices=5\nspacing=3.0\nunit=mm\n", **GREY)
one.write_bytes(one.read_bytes() + zyx("i16").astype(">i2")[1:].tobytes())
add("one-directory.tif", "i16", diagonal((1, 1, 3)), tifffile.imread(one), unit="mm")
# The sections of a folder, whose natural order is not alphabetical.
for z in range(5):
    tifffile.imwrite(f"section-{z + 8}.tiff", zyx("i16")[z], metadata=None, software=False, compression="zlib", **GREY)


# --- DICOM --------------------------------------------------------------------------------------------------------

def dataset(data, syntax=pydicom.uid.ExplicitVRLittleEndian, series=1, frames=None, kind="PRIMARY"):
    """A dataset with pixels; its UIDs are fixed, so that a file changes only with its contents."""
    meta = pydicom.dataset.FileMetaDataset()
    meta.TransferSyntaxUID = syntax
    meta.MediaStorageSOPClassUID = "1.2.840.10008.5.1.4.1.1.2"
    meta.MediaStorageSOPInstanceUID = "1.2.826.0.1.3680043.8.498.9"
    out = pydicom.Dataset()
    out.file_meta = meta
    out.SOPClassUID, out.SOPInstanceUID = meta.MediaStorageSOPClassUID, meta.MediaStorageSOPInstanceUID
    out.Modality, out.SeriesDescription, out.SeriesNumber = "CT", f"series {series}", series
    out.SeriesInstanceUID = f"1.2.826.0.1.3680043.8.498.{series}"
    out.ImageType = ["ORIGINAL", kind, "AXIAL"]
    out.Rows, out.Columns = data.shape[-2:]
    out.SamplesPerPixel, out.PhotometricInterpretation = 1, "MONOCHROME2"
    out.BitsAllocated = out.BitsStored = 8 * data.dtype.itemsize
    out.HighBit = out.BitsStored - 1
    out.PixelRepresentation = int(data.dtype.kind == "i")
    if frames:
        out.NumberOfFrames = frames
    # A sequence with the tags of the image, as icons have them.
    icon = pydicom.Dataset()
    icon.Rows, icon.Columns, icon.BitsAllocated, icon.PixelRepresentation = 1, 1, 8, 0
    icon.PixelData = b"\0\0"
    out.IconImageSequence = [icon]
    big = syntax == pydicom.uid.ExplicitVRBigEndian
    pixels = data.astype(data.dtype.newbyteorder(">" if big else "<")).tobytes()
    out.PixelData = pixels + b"\0" * (len(pixels) % 2)
    out["PixelData"].VR = "OB" if data.dtype.itemsize == 1 and not big else "OW"
    return out


def save(file, out):
    pydicom.dcmwrite(file, out, enforce_file_format=True)


def check_dicom(file, name, affine, **options):
    got = pydicom.dcmread(file).pixel_array
    add(file, name, affine, got, **options)


# A tilted gantry: slices are oblique to the direction in which they follow one another.
PLANE = [1, 0, 0, 0, 0.8, 0.6]
for z, letter in enumerate("cebad"):
    out = dataset(zyx("i16")[z])
    out.ImageOrientationPatient, out.PixelSpacing = PLANE, [0.75, 0.5]
    out.ImagePositionPatient = [10, -20, 30.5 + 2 * z]
    out.RescaleSlope, out.RescaleIntercept = 0.5, -1000
    save(f"ct-{letter}.dcm", out)
out = dataset(zyx("i16")[0][:2], kind="LOCALIZER")
out.ImageOrientationPatient, out.ImagePositionPatient = [1, 0, 0, 0, 0, -1], [0, 0, 0]
save("scout.dcm", out)
out = dataset(zyx("u8")[0], series=2)
out.ImageOrientationPatient, out.ImagePositionPatient = PLANE, [0, 0, 0]
save("other.dcm", out)


def item(**elements):
    out = pydicom.Dataset()
    for name, value in elements.items():
        setattr(out, name, value)
    return out


def enhanced(file, name, syntax):
    out = dataset(zyx(name), syntax, frames=5)
    out.SharedFunctionalGroupsSequence = [item(
        PixelMeasuresSequence=[item(PixelSpacing=[0.75, 0.5], SliceThickness=5)],
        PlaneOrientationSequence=[item(ImageOrientationPatient=PLANE)],
        PixelValueTransformationSequence=[item(RescaleSlope=2, RescaleIntercept=-7)],
    )]
    out.PerFrameFunctionalGroupsSequence = [item(
        PlanePositionSequence=[item(ImagePositionPatient=[10, -20, 30.5 + 2 * z])],
    ) for z in range(5)]
    save(file, out)
    sheared = [[0.5, 0, 0, 10], [0, 0.75 * 0.8, 0, -20], [0, 0.75 * 0.6, 2, 30.5]]
    check_dicom(file, name, sheared, oriented=True, slope=2.0, intercept=-7.0)


enhanced("enhanced-i16.dcm", "i16", pydicom.uid.ExplicitVRLittleEndian)
enhanced("enhanced-big-u16.dcm", "u16", pydicom.uid.ExplicitVRBigEndian)
enhanced("enhanced-implicit-i8.dcm", "i8", pydicom.uid.ImplicitVRLittleEndian)
out = dataset(zyx("u8"), pydicom.uid.ImplicitVRLittleEndian, frames=5)
out.PixelSpacing = [0.75, 0.5]
save("frames-u8.dcm", out)
check_dicom("frames-u8.dcm", "u8", diagonal((0.5, 0.75, 1)))
# 12 bits in 16, with others above them; the reference masks them too.
out = dataset(zyx("u8").astype(np.uint16) | 0xF000, frames=5)
out.BitsStored, out.HighBit = 12, 11
save("bits-u8.dcm", out)


# Compressed, each frame in a fragment of its own or in two.
def compressed(file, name, syntax):
    out = dataset(zyx(name), frames=5)
    out.compress(syntax, generate_instance_uid=False)
    save(file, out)
    check_dicom(file, name, np.eye(4))


def encapsulated(file, name, syntax, frames, **options):
    out = dataset(zyx(name), frames=5)
    out.file_meta.TransferSyntaxUID = syntax
    out.PixelData = encapsulate(frames, **options)
    out["PixelData"].VR = "OB"
    out["PixelData"].is_undefined_length = True
    save(file, out)
    return pydicom.dcmread(file).pixel_array


for name in ["u8", "i8", "u16", "i16"]:
    compressed(f"rle-{name}.dcm", name, pydicom.uid.RLELossless)
for name in ["u8", "u16", "i16"]:
    frames = [imagecodecs.jpeg2k_encode(frame, level=0, codecformat="j2k", resolutions=1) for frame in zyx(name)]
    encapsulated(f"jpeg2000-{name}.dcm", name, pydicom.uid.JPEG2000Lossless, frames)
    check_dicom(f"jpeg2000-{name}.dcm", name, np.eye(4))
for name, predictor in [("u8", 1), ("u16", 1), ("i16", 6)]:
    frames = [imagecodecs.ljpeg_encode(frame.view(f"u{frame.itemsize}")) for frame in zyx(name)]
    encapsulated(f"lossless-{name}.dcm", name, pydicom.uid.JPEGLosslessSV1, frames, fragments_per_frame=2)
    check_dicom(f"lossless-{name}.dcm", name, np.eye(4))
# One value in each frame, which even this codec keeps: a separate test reads it.
frames = [imagecodecs.jpeg8_encode(np.full((4, 3), 50 * z + 3, np.uint8), level=100) for z in range(5)]
got = encapsulated("baseline-u8.dcm", "u8", pydicom.uid.JPEGBaseline8Bit, frames)
assert all((frame == 50 * z + 3).all() for z, frame in enumerate(got))


expected.sort(key=lambda e: e["file"])
lines = ",\n".join(json.dumps(e, ensure_ascii=False) for e in expected)
Path("expected-more.json").write_text(f"[\n{lines}\n]\n")

# A frame of JPEG 2000 whose wavelets go beyond black and white: squares of 16 pixels, at most 23 off when decoded.
y, x = np.mgrid[:64, :64]
squares = ((x // 16 + y // 16) % 2 * 255).astype(np.uint8)
frame = openjpeg.utils.encode_array(squares, photometric_interpretation=2, use_mct=False, compression_ratios=[8])
open("lossy-u8.j2k", "wb").write(bytes(frame))
