#!/usr/bin/env python3
"""Writes segmentations of DICOM and slices in JPEG-LS, and beside them expected-seg.json: the labels, the names and the
places that highdicom reads from the segmentations.

    pip install numpy==2.4.6 pydicom==3.0.2 highdicom==0.28.2 pyjpegls==1.5.1
    python make_seg.py

The segmentations are of an oblique scan of 12 x 10 x 8 voxels. Frames without a marked voxel are left out. The slices
in JPEG-LS, which CharLS encodes and decodes, have 8, 12 and 16 bits; "near" is an error of up to 3.
"""

import json
import os
from pathlib import Path

import highdicom as hd
import numpy as np
from highdicom.seg import SegmentAlgorithmTypeValues, SegmentDescription, Segmentation
from pydicom.dataset import Dataset, FileMetaDataset
from pydicom.sr.codedict import codes
from pydicom.uid import CTImageStorage, ExplicitVRLittleEndian, JPEGLSLossless, JPEGLSNearLossless, RLELossless

os.chdir(Path(__file__).parent)
SPACING = (0.75, 0.5, 2.0)  # between rows, columns and slices
ROW, COLUMN = np.array([0.8, 0.6, 0.0]), np.array([0.0, 0.0, -1.0])
NORMAL = np.cross(ROW, COLUMN)
SIZE = (8, 10, 12)  # slices, rows, columns
ROOT = "1.2.826.0.1.3680043.8.498.77."

expected = []


def slices():
    """The scan that the segmentations are of."""
    for n in range(SIZE[0]):
        ds = Dataset()
        ds.file_meta = FileMetaDataset()
        ds.file_meta.TransferSyntaxUID = ExplicitVRLittleEndian
        ds.SOPClassUID, ds.SOPInstanceUID = CTImageStorage, f"{ROOT}1.{n + 1}"
        ds.StudyInstanceUID, ds.SeriesInstanceUID, ds.FrameOfReferenceUID = ROOT + "2", ROOT + "3", ROOT + "4"
        ds.PatientID = ds.PatientName = ds.StudyID = ds.AccessionNumber = ds.ReferringPhysicianName = ""
        ds.PatientBirthDate = ds.PatientSex = ds.StudyDate = ds.StudyTime = ds.PositionReferenceIndicator = ""
        ds.Modality, ds.SeriesNumber, ds.InstanceNumber = "CT", 1, n + 1
        ds.Rows, ds.Columns = SIZE[1:]
        ds.PixelSpacing, ds.SliceThickness = list(SPACING[:2]), SPACING[2]
        ds.ImageOrientationPatient = [*ROW, *COLUMN]
        ds.ImagePositionPatient = [float(v) for v in np.array([10, -20, 30.5]) + NORMAL * SPACING[2] * n]
        yield ds


def described(number, name, color):
    return SegmentDescription(number, name, codes.SCT.Organ, codes.SCT.Kidney, SegmentAlgorithmTypeValues.MANUAL,
                              display_color=hd.color.CIELabColor.from_rgb(*color))


SEGMENTS = [described(1, "Left kidney", (255, 64, 0)), described(2, "tumour", (0, 0, 255)),
            described(3, "Rippe \u00e4u\u00dfen", (128, 174, 128))]
COLORS = ["#ff4000", "#0000ff", "#80ae80"]


def masks():
    """Three segments, indexed [z, y, x, segment]: a block, a block that overlaps it, and one in the last slice."""
    masks = np.zeros((*SIZE, 3), np.uint8)
    masks[1:4, 2:7, 3:9, 0] = 1
    masks[2:4, 4:9, 7:11, 1] = 1
    masks[7, 1, 2:4, 2] = 1
    return masks


def apart():
    """As masks, but without overlap."""
    apart = masks()
    apart[..., 1] &= 1 - apart[..., 0]
    return apart


def write(name, kind, pixels, **more):
    segmentation = Segmentation(
        list(slices()), pixels, kind, SEGMENTS, ROOT + "5", 7, ROOT + f"6.{len(expected) + 1}", 1, "voxsplat",
        "make_seg.py", "1", "1", series_description="organs", content_label="ORGANS", **more)
    # Dates and random numbers would make each run another file.
    for ds in segmentation.iterall():
        if ds.tag.group == 0x0008 and ds.VR in ("DA", "TM") or ds.VR == "DT":
            ds.value = {"DA": "20261126", "TM": "000000", "DT": "20261126000000"}[ds.VR]
        if ds.keyword == "DimensionOrganizationUID":
            ds.value = ROOT + "8"
    segmentation.save_as(name)
    volume = hd.seg.segread(name).get_volume(combine_segments=False, rescale_fractional=False, rtol=0.01)
    array, affine = volume.array, volume.affine
    if np.dot(affine[:3, 0], NORMAL) < 0:
        affine = affine @ np.array([[-1, 0, 0, array.shape[0] - 1], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]])
        array = array[::-1]
    marked = array >= 128 if kind == "FRACTIONAL" else array > 0
    layers = []
    channels = []
    for segment in range(3):
        mask = marked[..., segment]
        at = next((n for n, layer in enumerate(layers) if not layer[mask].any()), len(layers))
        if at == len(layers):
            layers.append(np.zeros(mask.shape, int))
        layers[at][mask] = segment + 1
        channels.append(at)
    names = [f"{channel} {n + 1} {SEGMENTS[n].SegmentLabel} {COLORS[n]}" for n, channel in enumerate(channels)]
    # highdicom counts slices, rows, columns.
    affine = affine[:3, [2, 1, 0, 3]]
    expected.append(dict(file=name, dims=array.shape[2::-1], affine=affine.tolist(), segments=names,
                         labels=["".join(map(str, layer.ravel())) for layer in layers]))


write("seg-binary.dcm", "BINARY", masks())
write("seg-apart.dcm", "BINARY", apart(), omit_empty_frames=False)
fractions = masks() * np.linspace(0.25, 1, SIZE[2])[:, None]
write("seg-fractional.dcm", "FRACTIONAL", fractions, fractional_type="OCCUPANCY")
write("seg-fractional-jpeg-ls.dcm", "FRACTIONAL", fractions, transfer_syntax_uid=JPEGLSLossless)
write("seg-labels.dcm", "LABELMAP", (apart() * np.array([1, 2, 3])).sum(-1).astype(np.uint8))
write("seg-labels-rle.dcm", "LABELMAP", (apart() * np.array([1, 2, 3])).sum(-1).astype(np.uint16),
      transfer_syntax_uid=RLELossless)


# --- JPEG-LS ------------------------------------------------------------------------------------------------------

def picture(name, array, near, stored, signed=False):
    ds = next(slices())
    ds.file_meta.MediaStorageSOPClassUID, ds.file_meta.MediaStorageSOPInstanceUID = ds.SOPClassUID, ds.SOPInstanceUID
    ds.Rows, ds.Columns = array.shape
    ds.SamplesPerPixel, ds.PhotometricInterpretation = 1, "MONOCHROME2"
    ds.BitsAllocated, ds.BitsStored, ds.HighBit = 8 * array.itemsize, stored, stored - 1
    ds.PixelRepresentation = int(signed)
    ds.PixelData = array.tobytes()
    ds.compress(JPEGLSNearLossless if near else JPEGLSLossless, **(dict(jls_error=near) if near else {}),
                generate_instance_uid=False)
    ds.save_as(name, enforce_file_format=True)
    expected.append(dict(file=name, dims=(*array.shape[::-1], 1), values=ds.pixel_array.ravel().tolist()))


y, x = np.mgrid[0:10, 0:12]
wave = (np.sin(x / 3) + np.cos(y / 2) + 2) / 4
picture("jpeg-ls-u8.dcm", (255 * wave).astype(np.uint8), 0, 8)
picture("jpeg-ls-u12.dcm", (4095 * wave).astype(np.uint16), 0, 12)
picture("jpeg-ls-u16.dcm", (65535 * wave).astype(np.uint16), 0, 16)
picture("jpeg-ls-i16.dcm", (4000 * wave - 2000).astype(np.int16), 0, 16, True)
picture("jpeg-ls-near-u8.dcm", (255 * wave).astype(np.uint8), 3, 8)
picture("jpeg-ls-near-u16.dcm", (65535 * wave).astype(np.uint16), 3, 16)

Path("expected-seg.json").write_text("[\n" + ",\n".join(json.dumps(e) for e in expected) + "\n]\n")
