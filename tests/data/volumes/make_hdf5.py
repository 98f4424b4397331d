#!/usr/bin/env python3
"""Writes files of HDF5 and NetCDF, and beside them expected-hdf5.json: what h5py and netCDF4 read there.

    pip install numpy==2.4.6 h5py==3.16.0 netCDF4==1.7.5.1 vtk==9.7.2
    python make_hdf5.py

Samples and table are those of make_several.py.
"""

import json
import os
from pathlib import Path

import h5py
import netCDF4
import numpy as np
from vtkmodules.util.numpy_support import vtk_to_numpy
from vtkmodules.vtkIOHDF import vtkHDFReader

os.chdir(Path(__file__).parent)
DIMS = (3, 4, 5)
N = 60
TYPES = {"u8": np.uint8, "u16": np.uint16, "i16": np.int16, "f32": np.float32}
SPACING = (0.5, 0.75, 2.0)
ORIGIN = (10.0, -20.0, 30.5)
expected = []


def volume(name, c, t):
    n = (np.arange(N) + 7 * c + 13 * t) % N
    values = {"u8": 3 * n + 5, "u16": 1000 * n + 257, "i16": 1000 * n - 29000, "f32": n * 0.25 - 3.125}[name]
    return values.astype(TYPES[name]).reshape(DIMS[::-1])


def all_of(name, channels, times):
    return np.stack([np.stack([volume(name, c, t) for c in range(channels)]) for t in range(times)])


def add(file, name, got, affine=np.eye(4), unit=""):
    times, channels = got.shape[:2]
    assert np.array_equal(got, all_of(name, channels, times)), file
    affine = np.asarray(affine, float)[:3, :4].tolist()
    expected.append(dict(file=file, type=name, channels=channels, times=times, affine=affine, oriented=False, unit=unit,
                         labels=[]))


def diagonal(spacing, origin=(0, 0, 0)):
    return np.column_stack([np.diag(spacing), origin])


def h5(file, name, path="samples", data=None, libver="earliest", **options):
    with h5py.File(file, "w", libver=libver, **({"userblock_size": 512} if "matlab" in file else {})) as out:
        out.create_dataset(path, data=volume(name, 0, 0) if data is None else data, track_times=False, **options)
    if "matlab" in file:
        with open(file, "r+b") as out:
            out.write(b"MATLAB 7.3 MAT-file, written by a test".ljust(128))
    with h5py.File(file) as read:
        got = read[path][:]
    add(f"{file}:/{path}" if "/" in path else file, name, got.reshape((-1, 1) + DIMS[::-1]))


h5("plain-i16.h5", "i16")
h5("big-u16.h5", "u16", dtype=">u2")
h5("chunks-f32.h5", "f32", chunks=(2, 4, 2), compression="gzip", shuffle=True, fletcher32=True)
h5("latest-i16.h5", "i16", libver="latest", chunks=(2, 2, 2), compression="gzip")
h5("matlab-u8.mat", "u8")
h5("times-i16.h5", "i16", data=all_of("i16", 1, 3)[:, 0])
h5("group-u8.h5", "u8", path="a/b/samples")
with h5py.File("two.h5", "w") as out:
    for path, t in [("raw/first", 0), ("raw/second", 1), ("table", 0)]:
        data = volume("i16", 0, t) if t == 0 else volume("u8", 0, 0)
        out.create_dataset(path, data=np.arange(4) if path == "table" else data, track_times=False)
with h5py.File("two.h5") as read:
    add("two.h5:/raw/first", "i16", read["raw/first"][:][None, None])
    add("two.h5:raw/second", "u8", read["raw/second"][:][None, None])

# The size of an element, the slowest axis first; booleans, which are an enumeration.
with h5py.File("element-u8.h5", "w") as out:
    out.create_dataset("Data", data=volume("u8", 0, 0), track_times=False).attrs["element_size_um"] = SPACING[::-1]
with h5py.File("element-u8.h5") as read:
    size = read["Data"].attrs["element_size_um"]
    add("element-u8.h5", "u8", read["Data"][:][None, None], diagonal(size[::-1]), "µm")
with h5py.File("bool.h5", "w") as out:
    out.create_dataset("mask", data=np.arange(N).reshape(DIMS[::-1]) % 3 == 0, track_times=False)
# A compression that is not read, and a view of another file: refused.
with h5py.File("lzf.h5", "w") as out:
    out.create_dataset("samples", data=volume("u8", 0, 0) * 0, compression="lzf", chunks=(5, 4, 3), track_times=False)
with h5py.File("virtual.h5", "w") as out:
    layout = h5py.VirtualLayout(DIMS[::-1], "i2")
    layout[:] = h5py.VirtualSource("plain-i16.h5", "samples", DIMS[::-1])
    out.create_virtual_dataset("view", layout)

# Images of VTK: the active one of two arrays of points, and an array of cells of a turned image.
TURN = [[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]


def vtkhdf(file, name, cells, turn):
    extent = [v for n, first in zip(DIMS, (2, 0, -1)) for v in (first, first + n - (not cells))]
    with h5py.File(file, "w") as out:
        group = out.create_group("VTKHDF")
        group.attrs["Version"] = (1, 0)
        group.attrs.create("Type", np.bytes_("ImageData"))
        group.attrs["WholeExtent"] = extent
        group.attrs["Origin"], group.attrs["Spacing"], group.attrs["Direction"] = ORIGIN, SPACING, np.ravel(turn)
        arrays = group.create_group("CellData" if cells else "PointData")
        if not cells:
            arrays.attrs["Scalars"] = np.bytes_("samples")
            arrays.create_dataset("other", data=volume(name, 0, 0) * 0, track_times=False)
        arrays.create_dataset("samples", data=volume(name, 0, 0), track_times=False)
    reader = vtkHDFReader()
    reader.SetFileName(file)
    reader.Update()
    image = reader.GetOutput()
    data = image.GetCellData() if cells else image.GetPointData()
    got = vtk_to_numpy(data.GetArray("samples")).reshape(DIMS[::-1])
    assert image.GetExtent() == tuple(extent), image.GetExtent()
    # The matrix leads from indices, which begin at the extent, to the world; samples of cells lie in their middles.
    matrix = image.GetIndexToPhysicalMatrix()
    affine = np.array([[matrix.GetElement(r, c) for c in range(4)] for r in range(3)])
    affine[:, 3] += affine[:, :3] @ (np.array(extent[::2]) + 0.5 * cells)
    add(file, name, got[None, None], affine)


vtkhdf("points-f32.vtkhdf", "f32", False, np.eye(3))
vtkhdf("cells-i16.vtkhdf", "i16", True, TURN)

# A group within itself: refused.
with h5py.File("loop.h5", "w") as out:
    out["samples"] = volume("u8", 0, 0)
    out["loop"] = h5py.SoftLink("/")


def nc(file, name, kind, times=1, unit="mm", packed=None, **options):
    with netCDF4.Dataset(file, "w", format=kind) as out:
        axes = ("z", "y", "x")
        if times > 1:
            out.createDimension("time", None)
            variable = out.createVariable("time", "f8", ("time",))
            variable.units = "seconds since 2000-01-01"
            variable[:] = np.arange(times) * 2.0
            axes = ("time",) + axes
        for axis, size, step, first in zip("xyz", DIMS, SPACING, ORIGIN):
            out.createDimension(axis, size)
            if unit:
                variable = out.createVariable(axis, "f4", (axis,))
                variable.units = unit
                variable[:] = first + step * np.arange(size)
        variable = out.createVariable("samples", np.dtype(TYPES[name]), axes, **options)
        variable.units = "K"
        variable.set_auto_maskandscale(False)
        variable[:] = all_of(name, 1, times)[:, 0] if times > 1 else volume(name, 0, 0)
        if packed:
            variable.scale_factor, variable.add_offset = packed
    with netCDF4.Dataset(file) as read:
        read.set_auto_maskandscale(False)
        got = read["samples"][:].reshape((times, 1) + DIMS[::-1])
        if unit:
            steps = [float(read[axis][1] - read[axis][0]) for axis in "xyz"]
            affine = diagonal(steps, [float(read[axis][0]) for axis in "xyz"])
    return got, (affine if unit else np.eye(4))


for file, name, kind, times in [("classic-i16.nc", "i16", "NETCDF3_CLASSIC", 1), ("record-f32.nc", "f32", "NETCDF3_64BIT_OFFSET", 3),
                                ("cdf5-u16.nc", "u16", "NETCDF3_64BIT_DATA", 1), ("four-i16.nc", "i16", "NETCDF4", 3)]:
    options = {"compression": "zlib", "chunksizes": (1, 2, 4, 3)} if kind == "NETCDF4" else {}
    got, affine = nc(file, name, kind, times, **options)
    add(file, name, got, affine, "mm")


def placed(file, name, dims, coordinates, affine, kind="NETCDF4"):
    """An array whose dimensions have these names and coordinates with attributes, in any order; x is the fastest of
    the volume."""
    with netCDF4.Dataset(file, "w", format=kind) as out:
        for axis in dims:
            values, attributes = coordinates[axis]
            out.createDimension(axis, len(values))
            variable = out.createVariable(axis, "f8", (axis,))
            variable[:] = values
            variable.setncatts(attributes)
        order = [list(coordinates)[::-1].index(axis) for axis in dims]
        out.createVariable("samples", np.dtype(TYPES[name]), dims)[:] = volume(name, 0, 0).transpose(order)
    with netCDF4.Dataset(file) as read:
        got = read["samples"]
        order = [got.dimensions.index(axis) for axis in list(coordinates)[::-1]]
        add(file, name, got[:].filled().transpose(order)[None, None], affine, "m")


metres = {"units": "m"}
lines = [(first + step * np.arange(n), metres) for first, step, n in zip(ORIGIN, SPACING, DIMS)]
placed("axes-xyz.nc", "i16", ("x", "y", "z"), dict(zip("xyz", lines)), diagonal(SPACING, ORIGIN))
placed("axes-zxy.nc", "f32", ("z", "x", "y"), dict(zip("xyz", lines)), diagonal(SPACING, ORIGIN), "NETCDF3_CLASSIC")
# By axis, by standard name, and by what is left.
named = {"i": (lines[0][0], {"axis": "X", **metres}), "j": lines[1],
         "k": (lines[2][0], {"standard_name": "altitude", **metres})}
placed("axes-told.nc", "u16", ("i", "k", "j"), named, diagonal(SPACING, ORIGIN))
# Depths from the surface down, along descending y.
ocean = {"x": lines[0], "y": (lines[1][0][::-1], metres), "depth": (lines[2][0], {"positive": "down", **metres})}
(x, y, z), last = ORIGIN, lines[1][0][-1]
down = np.column_stack([np.diag((0.5, -0.75, -2.0)), (x, last, -z)])
placed("down-i16.nc", "i16", ("depth", "y", "x"), ocean, down)

got, _ = nc("no-coordinates.nc", "i16", "NETCDF3_CLASSIC", unit="")
add("no-coordinates.nc", "i16", got)
# Packed, and with a no-data value: separate tests read them.
nc("packed-i16.nc", "i16", "NETCDF4", packed=(0.5, 273.0), fill_value=-29000)

lines = ",\n".join(json.dumps(e, ensure_ascii=False) for e in expected)
Path("expected-hdf5.json").write_text(f"[\n{lines}\n]\n")
