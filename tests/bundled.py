"""What reference implementations say of the files that they are tested with.

Run by tests/suite/formats/peers.rs: bundled.py FOLDER, where FOLDER holds the unpacked source of mrcfile and gets files that
pynrrd writes, because its packages have none. Prints a line of JSON for each file that the reference decodes.
"""

import json
import sys
import warnings
from pathlib import Path

import mrcfile
import nibabel
import nrrd
import numpy as np
import pydicom
from nibabel.brikhead import AFNIImage
from nibabel.freesurfer.mghformat import MGHImage
from nibabel.minc1 import Minc1Image
from nibabel.parrec import PARRECImage
from pydicom.pixels import apply_color_lut

# Images whose header always places them.
PLACED = (AFNIImage, MGHImage, Minc1Image, PARRECImage)

warnings.simplefilter("ignore")


def line(project, root, file, volumes, axes=None, origin=None, spacing=None, lossy=False):
    """Prints the contents of a file. `volumes` has the axes time, channel, z, y, x; `axes` maps voxels to the world."""
    volumes = np.asarray(volumes)
    times, channels, *dims = volumes.shape

    def numbers(samples):
        samples = samples.astype(np.float64)
        samples[~np.isfinite(samples)] = 0
        return [float(f(samples)) for f in (np.min, np.max, np.mean)]

    vectors = None if axes is None else [None if v is None else [float(x) for x in v] for v in axes]
    said = {
        "project": project,
        "file": str(file),
        "name": str(Path(file).relative_to(root)),
        "dims": dims[::-1],
        "axes": vectors,
        "origin": None if origin is None else [float(x) for x in origin],
        "spacing": None if spacing is None else [float(x) for x in spacing],
        "numbers": [[numbers(channel) for channel in time] for time in volumes],
        "lossy": lossy,
    }
    print(json.dumps(said), flush=True)


def grey(samples):
    """One channel at one time, of two or three axes."""
    samples = np.asarray(samples)
    return samples.reshape((1, 1) + (1,) * (3 - samples.ndim) + samples.shape)


def dicom():
    roots = [Path(pydicom.__file__).parent / "data" / "test_files"]
    try:
        import data_store

        roots.append(Path(data_store.__file__).parent / "data")
    except ImportError:
        pass
    roots.append(Path(nibabel.__file__).parent / "nicom" / "tests" / "data")
    for root in roots:
        project = "nibabel" if "nibabel" in str(root) else "pydicom"
        for file in sorted(p for p in root.rglob("*") if p.is_file()):
            try:
                one_dicom(project, root, file)
            except Exception as error:
                print(f"{file}: {type(error).__name__}: {error}", file=sys.stderr)


def stated_spacing(data):
    """The distances of rows and of columns, from the elements that stand in for PixelSpacing (PS3.3)."""
    for name in ("ImagerPixelSpacing", "NominalScannedPixelSpacing"):
        if data.get(name):
            return data.get(name)
    for region in data.get("SequenceOfUltrasoundRegions") or []:
        # In cm.
        if region.get("PhysicalUnitsXDirection") == 3 and region.get("PhysicalUnitsYDirection") == 3:
            return [10 * abs(region.PhysicalDeltaY), 10 * abs(region.PhysicalDeltaX)]
    ratio = data.get("PixelAspectRatio")
    return [float(ratio[0]) / float(ratio[1]), 1] if ratio else [1, 1]


def one_dicom(project, root, file):
    with open(file, "rb") as content:
        head = content.read(2)
    if head == b"\x1f\x8b":
        import gzip

        data = pydicom.dcmread(gzip.open(file))
    else:
        data = pydicom.dcmread(file, force=False)
    if "PixelData" not in data:
        return
    samples = data.pixel_array
    if data.get("PhotometricInterpretation") == "PALETTE COLOR":
        if not data.original_encoding[1]:
            # pydicom assumes little-endian words in tables.
            for colour in ("Red", "Green", "Blue"):
                name = f"{colour}PaletteColorLookupTableData"
                data[name].value = np.frombuffer(data[name].value, ">u2").astype("<u2").tobytes()
        samples = apply_color_lut(samples, data)
    frames = int(data.get("NumberOfFrames", 1) or 1)
    coloured = samples.ndim == (4 if frames > 1 else 3) and (
        data.SamplesPerPixel == 3 or data.PhotometricInterpretation == "PALETTE COLOR"
    )
    samples = samples.reshape((frames, data.Rows, data.Columns, 3 if coloured else 1))

    def of_frame(frame, group, name):
        """A value of a frame, from any of its possible places."""
        for groups in (
            data.get("PerFrameFunctionalGroupsSequence", [None] * frames)[frame],
            data.get("SharedFunctionalGroupsSequence", [None])[0],
        ):
            if groups is not None and group in groups and name in groups[group].value[0]:
                return groups[group].value[0].get(name)
        return data.get(name)

    pixel_group, map_group = (0x0028, 0x9110), (0x0028, 0x9145)
    position_group, orientation_group = (0x0020, 0x9113), (0x0020, 0x9116)
    number = lambda value, other: other if value in (None, "") else float(value)
    values = np.empty(samples.shape, np.float64)
    for frame in range(frames):
        slope = number(of_frame(frame, map_group, "RescaleSlope"), 1.0)
        if data.get("DoseGridScaling") is not None:
            slope = float(data.DoseGridScaling)
        intercept = number(of_frame(frame, map_group, "RescaleIntercept"), 0.0)
        values[frame] = slope * samples[frame].astype(np.float64) + intercept

    spacing = of_frame(0, pixel_group, "PixelSpacing") or stated_spacing(data)
    if "MOSAIC" in data.get("ImageType", []):
        # Slices are the tiles of a square grid, row by row; their places are not compared. Two files of nibabel hold the
        # pixels of other pictures, and are left out.
        tiles = int(data[0x0019, 0x100A].value)
        side = int(np.ceil(np.sqrt(tiles)))
        rows, columns = data.Rows // side, data.Columns // side
        grid = values[0, :, :, 0].reshape(side, rows, side, columns).swapaxes(1, 2)
        line(project, root, file, grey(grid.reshape(-1, rows, columns)[:tiles]))
        return
    turn = of_frame(0, orientation_group, "ImageOrientationPatient")
    x, y = (np.array(turn[:3], float), np.array(turn[3:], float)) if turn else (np.array([1, 0, 0]), np.array([0, 1, 0]))
    normal = np.cross(x, y)
    places = [of_frame(frame, position_group, "ImagePositionPatient") for frame in range(frames)]
    step, origin, order = None, None, range(frames)
    if all(place for place in places):
        places = [np.array(place, float) for place in places]
        if frames > 1 and data.get("GridFrameOffsetVector") is not None:
            places = [place + normal * float(o) for place, o in zip(places, data.GridFrameOffsetVector)]
        order = np.argsort([place @ normal for place in places], kind="stable")
        origin = places[order[0]]
        if frames > 1:
            step = (places[order[-1]] - origin) / (frames - 1)
    values = np.moveaxis(values[list(order)], -1, 0)[None]
    # Decoders fill in the losses of the encoder differently, and convert colours differently.
    syntax = data.file_meta.TransferSyntaxUID
    lossy = syntax.is_compressed and syntax.name.startswith("JPEG Base") or "Extended" in syntax.name
    lossy = lossy or str(syntax) == "1.2.840.10008.1.2.4.91" or "YBR" in data.PhotometricInterpretation
    axes = [x * float(spacing[1]), y * float(spacing[0]), step]
    line(project, root, file, values, axes, origin, lossy=bool(lossy))


def nifti():
    root = Path(nibabel.__file__).parent
    for file in sorted(p for p in root.rglob("*") if p.is_file()):
        if file.suffix in (".py", ".dcm", ".pyc") or "nicom" in str(file):
            continue
        try:
            image = nibabel.load(file)
            values = np.asanyarray(image.dataobj)
            if values.ndim < 3 or values.dtype.names or np.iscomplexobj(values):
                continue
            values = values.astype(np.float64)
        except Exception as error:
            print(f"{file}: {type(error).__name__}: {error}", file=sys.stderr)
            continue
        matrix = image.affine
        if isinstance(image, Minc1Image):
            # Axes are in the order of the file: time, z, y, x.
            values, matrix = values.T, matrix[:, [2, 1, 0, 3]]
        dims = values.shape[:3]
        volumes = values.reshape(dims + (-1,), order="F").transpose(3, 2, 1, 0)[:, None]
        affine, origin, spacing = None, None, image.header.get_zooms()[:3]
        header = image.header
        is_placed = isinstance(image, PLACED)
        if isinstance(image, nibabel.Nifti1Image | nibabel.Nifti1Pair):
            is_placed = header["qform_code"] or header["sform_code"]
        if is_placed:
            # From +x to the right and +y to the front to DICOM's axes.
            flipped = np.diag([-1, -1, 1]) @ matrix[:3]
            affine, origin, spacing = flipped[:, :3].T, flipped[:, 3], None
        line("nibabel", root, file, volumes, affine, origin, spacing)


def mrc(folder):
    root = next(Path(folder).glob("mrcfile-*/tests/test_data"))
    for file in sorted(root.iterdir()):
        try:
            with mrcfile.open(file, permissive=True) as opened:
                samples, cell = np.array(opened.data), opened.voxel_size
                # Columns, rows and sections may lie along any edge of the cell.
                edges = [opened.header[name] for name in ("mapc", "mapr", "maps")]
                if samples is None or samples.ndim < 2 or np.iscomplexobj(samples):
                    continue
        except Exception as error:
            print(f"{file}: {type(error).__name__}: {error}", file=sys.stderr)
            continue
        line("mrcfile", root, file, grey(samples.astype(np.float64)), spacing=[cell["xyz"[edge - 1]] for edge in edges])


def nrrds(folder):
    root = Path(folder) / "pynrrd"
    root.mkdir(exist_ok=True)
    # Every index of a volume, in an order that any mistake of axes changes.
    base = (np.arange(6 * 5 * 4) * 37 % 113).reshape(6, 5, 4)
    header = {
        "space": "left-posterior-superior",
        "space directions": [[1.5, 0, 0], [0, 2, 0.5], [0, 0, 3]],
        "space origin": [-3, 4, 5.5],
    }
    for encoding in ["raw", "gzip", "bzip2", "ascii"]:
        for kind in ["u1", "i2", "u2", "i4", "f4", "f8"]:
            samples = base.astype(kind) - (0 if kind[0] == "u" else 20)
            for suffix in [".nrrd", ".nhdr"]:
                name = f"{encoding}-{kind}{suffix}"
                nrrd.write(str(root / name), samples, {**header, "encoding": encoding})
    # Headers that pynrrd reads but does not write, each before data with other lines or bytes in front.
    samples = base.astype("<i2")
    raw = samples.tobytes(order="F")
    import bz2
    import gzip

    packed = {"raw": lambda b: b, "gzip": gzip.compress, "bzip2": bz2.compress}
    for encoding, pack in packed.items():
        for skip, junk in [("byte skip: -1", b"xyz" * 7), ("byteskip: -1", b""), ("line skip: 2", None)]:
            if junk is None:
                content = b"first line\nsecond line\n" + pack(raw)
            else:
                content = pack(junk + raw)
            text = (
                "NRRD0004\ntype: short\ndimension: 3\nsizes: 6 5 4\nendian: little\n"
                f"encoding: {encoding}\nspacings: 1 2 3\n{skip}\n"
            )
            name = f"{encoding}-{skip.replace(':', '').replace(' ', '')}-{len(junk or b'') }"
            (root / f"{name}.data").write_bytes(content)
            (root / f"{name}.nhdr").write_text(text + f"data file: {name}.data\n")
            (root / f"{name}.nrrd").write_bytes(text.encode() + b"\n" + content)
    for file in sorted(root.iterdir()):
        if file.suffix not in (".nrrd", ".nhdr"):
            continue
        try:
            samples, found = nrrd.read(str(file))
        except Exception as error:
            print(f"{file}: {type(error).__name__}: {error}", file=sys.stderr)
            continue
        directions, spacing = found.get("space directions"), found.get("spacings")
        line("pynrrd", root, file, grey(samples.transpose(2, 1, 0)), directions, found.get("space origin"), spacing)


if __name__ == "__main__":
    dicom()
    nifti()
    mrc(sys.argv[1])
    nrrds(sys.argv[1])
