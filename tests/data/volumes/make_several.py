#!/usr/bin/env python3
"""Writes files that hold several volumes, channels or points in time, and beside them expected-several.json: what the
reference implementations read there.

    pip install numpy==2.4.6 nibabel==5.4.2 pynrrd==1.1.3 SimpleITK==2.5.7 mrcfile==1.5.4 vtk==9.7.2 tifffile==2026.3.3 imagecodecs==2026.3.6
    python make_several.py

The volume of channel c at time t has the samples of make.py, each 7 c + 13 t places further: sample n is number
(n + 7 c + 13 t) mod 60 of them. Affines are 3 x 4, from lattice to world, as in expected.json.
"""

import json
import os
from pathlib import Path

import mrcfile
import nibabel as nib
import nrrd
import numpy as np
import SimpleITK as sitk
import tifffile
import vtk
from vtk.util import numpy_support

os.chdir(Path(__file__).parent)
DIMS = (3, 4, 5)
N = 60
TYPES = {"u8": np.uint8, "u16": np.uint16, "i16": np.int16, "f32": np.float32}
SPACING = np.array([0.5, 0.75, 2.0])
ORIGIN = np.array([10.0, -20.0, 30.5])

expected = []


def volume(name, c, t):
    """The samples, indexed [z, y, x]."""
    n = (np.arange(N) + 7 * c + 13 * t) % N
    values = {"u8": 3 * n + 5, "u16": 1000 * n + 257, "i16": 1000 * n - 29000, "f32": n * 0.25 - 3.125}[name]
    return values.astype(TYPES[name]).reshape(DIMS[::-1])


def all_of(name, channels, times):
    """The samples, indexed [t, c, z, y, x]."""
    return np.stack([np.stack([volume(name, c, t) for c in range(channels)]) for t in range(times)])


def add(file, name, got, affine, oriented=False, unit="", labels=()):
    """Records the expected contents of a file, after the reference implementation has read the intended samples."""
    times, channels = got.shape[:2]
    assert np.array_equal(got, all_of(name, channels, times)), file
    affine = np.asarray(affine, float)[:3, :4].tolist()
    expected.append(dict(file=file, type=name, channels=channels, times=times, affine=affine, oriented=oriented,
                         unit=unit, labels=list(labels)))


def diagonal(spacing, origin=(0, 0, 0)):
    return np.column_stack([np.diag(spacing), origin])


FLIP = np.diag([-1.0, -1.0, 1.0])
RGB = ["red #ff0000", "green #00ff00", "blue #0000ff"]

# --- NIfTI --------------------------------------------------------------------------------------------------------

AFFINE = np.vstack([diagonal(SPACING, ORIGIN), [0, 0, 0, 1]])


def check_nifti(file, name, unit, labels=()):
    image = nib.load(file)
    data = np.asanyarray(image.dataobj)
    if data.dtype.names:
        data = np.stack([data[field] for field in data.dtype.names], axis=-1)[:, :, :, None]
    data = data.reshape(data.shape + (1,) * (5 - data.ndim))
    add(file, name, data.transpose(3, 4, 2, 1, 0), FLIP @ image.affine[:3], oriented=True, unit=unit, labels=labels)


def nifti(file, data):
    image = nib.Nifti1Image(data, AFFINE)
    image.header.set_xyzt_units("mm", "sec")
    nib.save(image, file)


nifti("times-i16.nii", all_of("i16", 1, 3)[:, 0].transpose(3, 2, 1, 0))
check_nifti("times-i16.nii", "i16", "mm")
nifti("five-f32.nii.gz", all_of("f32", 2, 3).transpose(4, 3, 2, 0, 1))
check_nifti("five-f32.nii.gz", "f32", "mm")
rgb = np.zeros(DIMS, dtype=[("R", "u1"), ("G", "u1"), ("B", "u1")])
for c, field in enumerate("RGB"):
    rgb[field] = volume("u8", c, 0).transpose()
nifti("rgb.nii", rgb)
check_nifti("rgb.nii", "u8", "mm", RGB)

# --- NRRD ---------------------------------------------------------------------------------------------------------

DIRECTIONS = [[0.5, 0, 0], [0, 0.75, 0], [0, 0, 2]]
NONE = [np.nan] * 3


def nrrds(file, name, order, header, channels, times):
    """`order` are the axes of the file among t, c, z, y, x, the fastest first."""
    data = all_of(name, channels, times)
    if channels == 1:
        data = data[:, 0]
    elif times == 1:
        data = data[0]
    letters = "tczyx" if data.ndim == 5 else ("tzyx" if channels == 1 else "czyx")
    nrrd.write(file, data.transpose([letters.index(axis) for axis in order]), header, index_order="F")
    got, _ = nrrd.read(file, index_order="F")
    got = got.transpose([order.index(axis) for axis in letters]).reshape(times, channels, *DIMS[::-1])
    placed = "space directions" in header
    add(file, name, got, diagonal(SPACING, ORIGIN) if placed else np.eye(4), oriented=placed)


SPACE = {"space": "left-posterior-superior", "space origin": ORIGIN}
nrrds("vector-first.nrrd", "f32", "cxyz", {"encoding": "gzip", "kinds": ["vector"] + ["domain"] * 3,
                                           "space directions": [NONE] + DIRECTIONS, **SPACE}, 3, 1)
nrrds("time-first.nrrd", "u16", "txyz", {"encoding": "ascii", "kinds": ["time"] + ["domain"] * 3}, 1, 3)
nrrds("five.nrrd", "i16", "cxyzt", {"encoding": "raw", "kinds": ["list"] + ["domain"] * 3 + ["time"],
                                    "space directions": [NONE] + DIRECTIONS + [NONE], **SPACE}, 2, 2)
# Its samples in two files; neither begins at the beginning of a volume.
header = {"encoding": "raw", "kinds": ["domain"] * 3 + ["time"], "space directions": DIRECTIONS + [NONE], **SPACE}
nrrds("parts.nhdr", "i16", "xyzt", {**header, "data file": "parts.raw"}, 1, 3)
whole = Path("parts.raw").read_bytes()
Path("parts-1.raw").write_bytes(whole[:180])
Path("parts-2.raw").write_bytes(whole[180:])
Path("parts.raw").unlink()
text = Path("parts.nhdr").read_text().replace("data file: parts.raw\n", "").rstrip("\n")
Path("parts.nhdr").write_text(text + "\ndata file: LIST\nparts-1.raw\nparts-2.raw\n")

# --- MetaImage ----------------------------------------------------------------------------------------------------


def meta(file, data, vector, compress, unit=""):
    image = sitk.GetImageFromArray(data, isVector=vector)
    space = image.GetDimension()
    image.SetSpacing([*SPACING, 1.0][:space])
    image.SetOrigin([*ORIGIN, 0.0][:space])
    sitk.WriteImage(image, file, useCompression=compress)
    got = sitk.GetArrayFromImage(sitk.ReadImage(file))
    got = np.moveaxis(got, -1, 0)[None] if vector else got[:, None]
    name = {np.dtype(t): n for n, t in TYPES.items()}[got.dtype]
    add(file, name, got, diagonal(SPACING, ORIGIN), oriented=True, unit=unit)


meta("channels-u16.mha", np.moveaxis(all_of("u16", 3, 1)[0], 0, -1), True, False)
meta("times-f32.mha", all_of("f32", 1, 3)[:, 0], False, True)

# --- MRC, NumPy ---------------------------------------------------------------------------------------------------

with mrcfile.new("stack-i16.mrc", overwrite=True) as out:
    out.set_data(all_of("i16", 1, 3)[:, 0])
    out.voxel_size = tuple(SPACING)
    out.header.label[:] = b""
    out.header.nlabl = 0
with mrcfile.open("stack-i16.mrc") as mrc:
    assert mrc.is_volume_stack()
    add("stack-i16.mrc", "i16", np.array(mrc.data)[:, None], diagonal(SPACING), unit="Å")
np.save("times-i16.npy", all_of("i16", 1, 3)[:, 0])
add("times-i16.npy", "i16", np.load("times-i16.npy")[:, None], np.eye(4))
np.save("five-u8.npy", np.asfortranarray(all_of("u8", 2, 3)))
add("five-u8.npy", "u8", np.load("five-u8.npy"), np.eye(4))

# --- VTK ----------------------------------------------------------------------------------------------------------


def vtk_file(file, name, channels, writer, reader, vectors=False):
    image = vtk.vtkImageData()
    image.SetDimensions(*DIMS)
    image.SetSpacing(*SPACING)
    image.SetOrigin(*ORIGIN)
    data = np.moveaxis(all_of(name, channels, 1)[0], 0, -1).reshape(N, channels)
    array = numpy_support.numpy_to_vtk(np.ascontiguousarray(data), deep=True)
    array.SetName("several")
    if vectors:
        image.GetPointData().SetVectors(array)
    else:
        image.GetPointData().SetScalars(array)
    writer.SetFileName(file)
    writer.SetInputData(image)
    writer.Write()
    reader.SetFileName(file)
    reader.Update()
    points = reader.GetOutput().GetPointData()
    got = numpy_support.vtk_to_numpy(points.GetVectors() if vectors else points.GetScalars())
    add(file, name, np.moveaxis(got.reshape(*DIMS[::-1], channels), -1, 0)[None], diagonal(SPACING, ORIGIN))


writer = vtk.vtkXMLImageDataWriter()
vtk_file("scalars-f32.vti", "f32", 2, writer, vtk.vtkXMLImageDataReader())
writer.SetDataModeToAscii()
vtk_file("vectors-f32.vti", "f32", 3, writer, vtk.vtkXMLImageDataReader(), vectors=True)
writer = vtk.vtkStructuredPointsWriter()
writer.SetFileTypeToBinary()
vtk_file("scalars-u16.vtk", "u16", 3, writer, vtk.vtkStructuredPointsReader())
writer.SetFileTypeToASCII()
vtk_file("vectors-f32.vtk", "f32", 3, writer, vtk.vtkStructuredPointsReader(), vectors=True)

# --- TIFF ---------------------------------------------------------------------------------------------------------


def tif(file, name, data, order, channels, times, spacing=(1, 1, 1), unit="", labels=(), **options):
    """`order` are the axes of the data, the slowest first, as tifffile has them."""
    tifffile.imwrite(file, data, software=False, **options)
    got = tifffile.imread(file, is_ome=False if "ome" not in options else None)
    got = got.reshape(data.shape).transpose([order.index(axis) for axis in "TCZYX" if axis in order])
    add(file, name, got.reshape(times, channels, *DIMS[::-1]), diagonal(spacing), unit=unit, labels=labels)


u8 = all_of("u8", 3, 1)[0]
chunky, planar = np.moveaxis(u8, 0, -1), np.moveaxis(u8, 0, 1)
tif("rgb-u8.tif", "u8", chunky, "ZYXC", 3, 1, photometric="rgb", metadata=None, labels=RGB)
tif("rgb-lzw-u8.tif", "u8", chunky, "ZYXC", 3, 1, photometric="rgb", metadata=None, compression="lzw", labels=RGB)
tif("planar-u8.tif", "u8", planar, "ZCYX", 3, 1, photometric="rgb", planarconfig="separate", metadata=None,
    labels=RGB)
tif("planar-deflate-u8.tif", "u8", planar, "ZCYX", 3, 1, photometric="rgb", planarconfig="separate", metadata=None,
    compression="zlib", labels=RGB)
two = np.moveaxis(all_of("u16", 2, 1)[0], 0, -1)
tif("two-u16.tif", "u16", two, "ZYXC", 2, 1, photometric="minisblack", planarconfig="contig", metadata=None,
    extrasamples=["unspecified"])
sizes = {"PhysicalSizeX": 0.5, "PhysicalSizeY": 0.75, "PhysicalSizeZ": 2.0}
uuid = {"UUID": "00000000-0000-0000-0000-000000000000"}
channels = {"Channel": {"Name": ["DAPI", "GFP"], "Color": [65535, 16711935]}}
tif("several.ome.tif", "i16", all_of("i16", 2, 3), "TCZYX", 2, 3, spacing=(0.5, 0.75, 2), unit="µm", ome=True,
    metadata={"axes": "TCZYX", **sizes, **channels, **uuid}, photometric="minisblack",
    labels=["DAPI #0000ff", "GFP #00ff00"])
tif("several-deflate.ome.tif", "i16", all_of("i16", 2, 3).transpose(2, 0, 1, 3, 4), "ZTCYX", 2, 3,
    spacing=(0.5, 0.75, 2), unit="µm", ome=True, metadata={"axes": "ZTCYX", **sizes, **uuid},
    photometric="minisblack", compression="zlib")
tif("hyperstack.tif", "u16", all_of("u16", 2, 3).transpose(0, 2, 1, 3, 4), "TZCYX", 2, 3, spacing=(0.5, 0.25, 2),
    unit="µm", imagej=True, resolution=(2, 4), metadata={"axes": "TZCYX", "spacing": 2.0, "unit": "um"})

lines = ",\n".join(json.dumps(e, ensure_ascii=False) for e in expected)
Path("expected-several.json").write_text(f"[\n{lines}\n]\n")
