#!/usr/bin/env python3
"""Writes NRRD and DICOM files of points in time and of colours, and HDF5 and NetCDF that cannot be placed, and beside
them expected-time.json: what the reference implementations read there, as in make_several.py.

    pip install numpy==2.4.6 pynrrd==1.1.3 pydicom==3.0.2 h5py==3.16.0 netCDF4==1.7.5.1.post1 pillow==13.0.0
    python make_time.py

The volume of channel c at time t has the samples of make.py, each 7 c + 13 t places further: sample n is number
(n + 7 c + 13 t) mod 60 of them.
"""

import io
import json
import os
from pathlib import Path

import h5py
import netCDF4
import nrrd
import numpy as np
import pydicom
from PIL import Image

os.chdir(Path(__file__).parent)
DIMS = (3, 4, 5)
N = 60
TYPES = {"u8": np.uint8, "u16": np.uint16, "i16": np.int16, "f32": np.float32}
SPACING = [0.5, 0.75, 2.0]
ORIGIN = [10.0, -20.0, 30.5]
RGB = ["red #ff0000", "green #00ff00", "blue #0000ff"]

expected = []


def volume(name, c, t):
    """The samples, indexed [z, y, x]."""
    n = (np.arange(N) + 7 * c + 13 * t) % N
    values = {"u8": 3 * n + 5, "u16": 1000 * n + 257, "i16": 1000 * n - 29000, "f32": n * 0.25 - 3.125}[name]
    return values.astype(TYPES[name]).reshape(DIMS[::-1])


def all_of(name, channels, times):
    """The samples, indexed [t, c, z, y, x]."""
    return np.stack([np.stack([volume(name, c, t) for c in range(channels)]) for t in range(times)])


def diagonal(spacing, origin=(0, 0, 0)):
    return np.column_stack([np.diag(spacing), origin])


def add(file, name, got, affine, oriented=False, unit="", labels=()):
    """Records the expected contents of a file, after the reference implementation has read the intended samples."""
    times, channels = got.shape[:2]
    assert np.array_equal(got, all_of(name, channels, times)), file
    affine = np.asarray(affine, float)[:3, :4].tolist()
    expected.append(dict(file=file, type=name, channels=channels, times=times, affine=affine, oriented=oriented,
                         unit=unit, labels=list(labels)))


# --- NRRD ---------------------------------------------------------------------------------------------------------

PLACE = np.array([[0.5, 0, 0], [0, 0.75, 0], [0, 0, 2.0]])
NONE = [np.nan] * 3
LPS = {"space": "left-posterior-superior", "space origin": ORIGIN}


def nrrds(file, name, order, header, channels, times):
    """`order` are the axes of the file among t, c, z, y, x, the fastest first."""
    data = all_of(name, channels, times)
    letters = "tzyx" if channels == 1 else "czyx"
    data = data[:, 0] if channels == 1 else data[0]
    nrrd.write(file, data.transpose([letters.index(axis) for axis in order]), header, index_order="F")
    got, _ = nrrd.read(file, index_order="F")
    got = got.transpose([order.index(axis) for axis in letters]).reshape(times, channels, *DIMS[::-1])
    add(file, name, got, diagonal(SPACING, ORIGIN), oriented=True)


# A list of numbers of each voxel that are no time points, such as directions of diffusion.
nrrds("list-last.nrrd", "i16", "xyzc", {"encoding": "raw", "kinds": ["domain"] * 3 + ["list"],
                                        "space directions": [*PLACE, NONE], **LPS}, 3, 1)
# 3D Slicer's sequences are lists too, but each frame has an index.
nrrds("sequence.nrrd", "i16", "txyz", {"encoding": "gzip", "kinds": ["list"] + ["domain"] * 3,
                                       "space directions": [NONE, *PLACE], **LPS,
                                       "axis 0 index type": "numeric", "axis 0 index values": "0 0.5 1"}, 1, 3)
nrrds("labelled.nrrd", "u8", "xyzt", {"encoding": "raw", "kinds": ["domain"] * 3 + ["list"],
                                      "labels": ["", "", "", "frame"],
                                      "space directions": [*PLACE, NONE], **LPS}, 1, 3)


def in_space_time(file, name, space, origin, vectors, order):
    """By hand: pynrrd does not write directions of four numbers, but reads them."""
    letters = "tzyx"
    data = all_of(name, 1, 3)[:, 0].transpose([letters.index(axis) for axis in order])
    sizes = " ".join(str(n) for n in data.shape)
    of = lambda vector: "(" + ",".join(str(n) for n in vector) + ")"
    head = ["NRRD0005", f"type: {'int16' if name == 'i16' else 'uint8'}", "dimension: 4", f"sizes: {sizes}",
            f"space: {space}", "space directions: " + " ".join(of(v) for v in vectors), f"space origin: {of(origin)}",
            "kinds: " + " ".join("domain" for _ in order), "endian: little", "encoding: raw"]
    Path(file).write_bytes(("\n".join(head) + "\n\n").encode() + data.tobytes(order="F"))
    got, header = nrrd.read(file, index_order="F")
    assert np.array_equal(header["space directions"], np.array(vectors, float)), header
    got = got.transpose([order.index(axis) for axis in letters]).reshape(3, 1, *DIMS[::-1])
    add(file, name, got, diagonal(SPACING, ORIGIN), oriented=True)


ALONG = [[*row, 0] for row in PLACE.tolist()]
in_space_time("space-time.nrrd", "i16", "left-posterior-superior-time", [*ORIGIN, 0], [*ALONG, [0, 0, 0, 40]], "xyzt")
flipped = [[-x, -y, z, t] for x, y, z, t in ALONG]
in_space_time("time-space.nrrd", "u8", "RAST", [-10, 20, 30.5, 0], [[0, 0, 0, 40], *flipped], "txyz")

# --- DICOM --------------------------------------------------------------------------------------------------------


def dataset(data, syntax=pydicom.uid.ExplicitVRLittleEndian, number=1, frames=None, capture=False):
    """A dataset with pixels, [frame,] row, column[, colour]."""
    meta = pydicom.dataset.FileMetaDataset()
    meta.TransferSyntaxUID = syntax
    meta.MediaStorageSOPClassUID = "1.2.840.10008.5.1.4.1.1." + ("7" if capture else "4")
    meta.MediaStorageSOPInstanceUID = f"1.2.826.0.1.3680043.8.498.9.{number}"
    out = pydicom.Dataset()
    out.file_meta = meta
    out.SOPClassUID, out.SOPInstanceUID = meta.MediaStorageSOPClassUID, meta.MediaStorageSOPInstanceUID
    out.Modality, out.SeriesNumber, out.InstanceNumber = "OT" if capture else "MR", 1, number
    out.SeriesInstanceUID = "1.2.826.0.1.3680043.8.498.1"
    out.Rows, out.Columns = DIMS[1], DIMS[0]
    out.SamplesPerPixel, out.PhotometricInterpretation = 1, "MONOCHROME2"
    out.BitsAllocated = out.BitsStored = 8 * data.dtype.itemsize
    out.HighBit = out.BitsStored - 1
    out.PixelRepresentation = int(data.dtype.kind == "i")
    if frames:
        out.NumberOfFrames = frames
    pixels = data.tobytes()
    out.PixelData = pixels + b"\0" * (len(pixels) % 2)
    out["PixelData"].VR = "OB" if data.dtype.itemsize == 1 else "OW"
    return out


def save(file, out):
    pydicom.dcmwrite(file, out, enforce_file_format=True)


def item(**elements):
    out = pydicom.Dataset()
    for name, value in elements.items():
        setattr(out, name, value)
    return out


# Slices of three time points, all at the same positions, which only a tag distinguishes: files time-N.dcm, whose
# tests change the tag. The times of acquisition pass midnight.
for t in range(3):
    for z in range(5):
        out = dataset(volume("i16", 0, t)[z], number=5 * t + z + 1)
        out.ImageOrientationPatient, out.PixelSpacing = [1, 0, 0, 0, 1, 0], [0.75, 0.5]
        out.ImagePositionPatient = [10, -20, 30.5 + 2 * z]
        out.AcquisitionDate, out.AcquisitionTime = [("20260101", "235958.5"), ("20260101", "235959.25"),
                                                    ("20260102", "000000")][t]
        save(f"time-{5 * t + z}.dcm", out)

# The same in one file, whose frames are in no order. Implicit types hide which elements are sequences.
for file, syntax, by_trigger in [("enhanced-times.dcm", pydicom.uid.ExplicitVRLittleEndian, False),
                                 ("enhanced-triggers.dcm", pydicom.uid.ImplicitVRLittleEndian, True)]:
    order = [(t, z) for z in (3, 0, 4, 1, 2) for t in (2, 0, 1)]
    out = dataset(np.stack([volume("i16", 0, t)[z] for t, z in order]), syntax, frames=15)
    out.SharedFunctionalGroupsSequence = [item(
        PixelMeasuresSequence=[item(PixelSpacing=[0.75, 0.5], SliceThickness=2)],
        PlaneOrientationSequence=[item(ImageOrientationPatient=[1, 0, 0, 0, 1, 0])],
    )]
    groups = []
    for t, z in order:
        group = item(PlanePositionSequence=[item(ImagePositionPatient=[10, -20, 30.5 + 2 * z])])
        if by_trigger:
            group.CardiacSynchronizationSequence = [item(NominalCardiacTriggerDelayTime=120.5 * t)]
        else:
            group.FrameContentSequence = [item(TemporalPositionIndex=t + 1)]
        groups.append(group)
    out.PerFrameFunctionalGroupsSequence = groups
    save(file, out)
    got = pydicom.dcmread(file).pixel_array
    got = np.stack([np.stack([got[order.index((t, z))] for z in range(5)]) for t in range(3)])[:, None]
    add(file, "i16", got, diagonal(SPACING, ORIGIN), oriented=True)

COLOURS = np.moveaxis(all_of("u8", 3, 1)[0], 0, -1)


def coloured(file, data, planar, photometric="RGB", syntax=pydicom.uid.ExplicitVRLittleEndian, compress=None):
    out = dataset(np.moveaxis(data, -1, 1).copy() if planar else data, syntax, frames=5, capture=True)
    out.SamplesPerPixel, out.PhotometricInterpretation, out.PlanarConfiguration = 3, photometric, int(planar)
    if compress:
        out.compress(compress, generate_instance_uid=False)
    save(file, out)
    return np.moveaxis(pydicom.dcmread(file).pixel_array, -1, 0)[None]


for file, planar, options in [("rgb-u8.dcm", False, {}), ("planar-u8.dcm", True, {}),
                              ("rgb-rle-u8.dcm", False, {"compress": pydicom.uid.RLELossless})]:
    add(file, "u8", coloured(file, COLOURS, planar, **options), np.eye(4), labels=RGB)
add("rgb-u16.dcm", "u16", coloured("rgb-u16.dcm", np.moveaxis(all_of("u16", 3, 1)[0], 0, -1), False), np.eye(4),
    labels=RGB)
# Luma and chroma: a separate test compares with the result of pydicom, in ybr.json.
coloured("ybr-u8.dcm", COLOURS, False, "YBR_FULL")
rgb = pydicom.pixels.pixel_array("ybr-u8.dcm", raw=False)
Path("ybr.json").write_text(json.dumps(np.moveaxis(rgb, -1, 0).reshape(3, -1).tolist()) + "\n")


def encapsulated(file, frames, syntax, photometric):
    out = dataset(COLOURS, frames=5, capture=True)
    out.SamplesPerPixel, out.PhotometricInterpretation, out.PlanarConfiguration = 3, photometric, 0
    out.file_meta.TransferSyntaxUID = syntax
    out.PixelData = pydicom.encaps.encapsulate(frames)
    out["PixelData"].VR = "OB"
    out["PixelData"].is_undefined_length = True
    save(file, out)


def packed(frame, kind, **options):
    out = io.BytesIO()
    Image.fromarray(frame).save(out, kind, **options)
    return out.getvalue()


frames = [packed(frame, "JPEG2000", no_jp2=True, irreversible=False, mct=1, num_resolutions=1) for frame in COLOURS]
encapsulated("jpeg2000-rgb-u8.dcm", frames, pydicom.uid.JPEG2000Lossless, "YBR_RCT")
got = np.stack([np.asarray(Image.open(io.BytesIO(frame))) for frame in frames])
add("jpeg2000-rgb-u8.dcm", "u8", np.moveaxis(got, -1, 0)[None], np.eye(4), labels=RGB)
# One colour in each frame, which even this codec nearly keeps: a separate test reads it. In the second file the
# three components are red, green and blue without conversion.
flat = [np.full((4, 3, 3), (50 * z + 3, 200 - 40 * z, 90), np.uint8) for z in range(5)]
frames = [packed(frame, "JPEG", quality=100, subsampling=0) for frame in flat]
encapsulated("baseline-ybr-u8.dcm", frames, pydicom.uid.JPEGBaseline8Bit, "YBR_FULL_422")
frames = [packed(frame, "JPEG", quality=100, keep_rgb=True) for frame in flat]
encapsulated("baseline-rgb-u8.dcm", frames, pydicom.uid.JPEGBaseline8Bit, "RGB")
# Captures without positions follow one another by their numbers, not by their names.
for z in range(5):
    out = dataset(COLOURS[z], number=z + 7, capture=True)
    out.SamplesPerPixel, out.PhotometricInterpretation, out.PlanarConfiguration = 3, "RGB", 0
    save(f"capture-{(z * 2) % 5}.dcm", out)

# --- HDF5 and NetCDF ----------------------------------------------------------------------------------------------

with h5py.File("half.h5", "w") as file:
    file.create_group("raw").create_dataset("scan", data=volume("f32", 0, 0).astype(np.float16))
# Like levels of an atmosphere: unequal lengths, in other units than the other axes.
for name, heights, unit in [("uneven.nc", [0, 1, 3, 6, 10], "m"), ("unlike.nc", [0, 2, 4, 6, 8], "hPa")]:
    with netCDF4.Dataset(name, "w", format="NETCDF3_CLASSIC") as file:
        for axis, size, values, of in [("z", 5, heights, unit), ("y", 4, [0, 0.75, 1.5, 2.25], "m"),
                                       ("x", 3, [0, 0.5, 1], "m")]:
            file.createDimension(axis, size)
            coordinate = file.createVariable(axis, "f8", (axis,))
            coordinate[:], coordinate.units = values, of
        file.createVariable("scan", "i2", ("z", "y", "x"))[:] = volume("i16", 0, 0)

lines = ",\n".join(json.dumps(e, ensure_ascii=False) for e in expected)
Path("expected-time.json").write_text(f"[\n{lines}\n]\n")
