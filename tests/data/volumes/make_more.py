#!/usr/bin/env python3
"""Writes the volumes of this folder in formats of microscopy, simulation and hospitals and, beside them,
expected-more.json: what the reference implementations read there. It is to be run after make.py, whose samples these
volumes have.

    pip install numpy==2.4.6 mrcfile==1.5.4
    python make_more.py

Affines are 3 x 4, from lattice to world, as in expected.json.
"""

import gzip
import json
import os
from pathlib import Path

import mrcfile
import numpy as np

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
    """Notes what is expected of a file, once the reference implementation has read what was meant to be written."""
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


expected.sort(key=lambda e: e["file"])
lines = ",\n".join(json.dumps(e, ensure_ascii=False) for e in expected)
Path("expected-more.json").write_text(f"[\n{lines}\n]\n")
