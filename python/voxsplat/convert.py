"""Volumes of the objects that Python programs hold."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Any

import numpy as np

from . import _native
from .packages import TO_LPS, found_in
from .warning import warn

__all__ = ["in_world", "located", "matrix_of", "native_slice", "samples_of", "volume_of"]

_IDENTITY = np.eye(4)


def volume_of(
    data: Any,
    *,
    spacing: Sequence[float] | None = None,
    origin: Sequence[float] | None = None,
    axes: str | None = None,
    affine: Any = None,
    space: str | None = None,
    units: Mapping[str, str] | str | None = None,
    modality: str | None = None,
    replace_nan: float | None = None,
    time: int | None = None,
    channel: int | None = None,
    dims: Sequence[int] | None = None,
    dtype: Any = None,
    endian: str | None = None,
    offset: int = 0,
    series: int | None = None,
    missing_slices: str = "refuse",
    complex: str | None = None,
    pyramid: int | None = None,
    fetch_limit: int | None = None,
) -> _native.Volume:
    """Return the volume of an array, an image of another package, or a file. See `voxsplat.Volume`."""
    if isinstance(data, _native.Volume):
        return data
    path = _path(data)
    if path is not None:
        given = {"origin": origin, "affine": affine, "space": space, "units": units, "modality": modality}
        _refuse(given, "for arrays, and the volume is a file")
        return _native.Volume.of_file(
            path,
            {
                "dims": None if dims is None else tuple(int(n) for n in dims),
                "dtype": None if dtype is None else (dtype if isinstance(dtype, str) else np.dtype(dtype).name),
                "endian": endian,
                "offset": offset,
                "axis_order": axes,
                # Files are described in the order x, y, z everywhere; Python in the order of the shape.
                "spacing": None if spacing is None else _numbers("spacing", spacing)[::-1],
                "replace_nan": replace_nan,
                "time": time,
                "channel": channel,
                "series": series,
                "missing_slices": missing_slices,
                "complex": complex,
                "pyramid": pyramid,
                "fetch_limit": fetch_limit,
            },
        )
    given = {"time": time, "channel": channel, "dims": dims, "dtype": dtype, "endian": endian, "series": series}
    given |= {"offset": offset or None, "complex": complex, "pyramid": pyramid, "fetch_limit": fetch_limit}
    given["missing_slices"] = None if missing_slices == "refuse" else missing_slices
    _refuse(given, "for files, and the volume is an array: index it")
    array, axes, facts = located(
        data, spacing=spacing, origin=origin, axes=axes, affine=affine, space=space, units=units, modality=modality
    )
    facts["replace_nan"] = replace_nan
    return _native.Volume.of_array(samples_of(array, axes), facts)


def located(
    data: Any,
    *,
    spacing: Sequence[float] | None = None,
    origin: Sequence[float] | None = None,
    axes: str | None = None,
    affine: Any = None,
    space: str | None = None,
    units: Mapping[str, str] | str | None = None,
    modality: str | None = None,
) -> tuple[Any, str, dict[str, Any]]:
    """Return the array of an object as it is, its axes, and the facts about it. Reads no samples."""
    found = found_in(data)
    facts: dict[str, Any] = {
        "oriented": False,
        "slope": 1.0,
        "intercept": 0.0,
        "length_unit": None,
        "value_unit": None,
        "modality": None,
        "description": None,
    }
    facts |= found.facts
    if modality is not None:
        facts["modality"] = modality
    facts |= _units(units)
    if axes is None:
        axes = found.axes
        if _has_x_first(data):
            warn(
                f"an array of shape {data.shape} is drawn with axes (z, y, x), but its first axis is the fastest in memory, "
                'as in (x, y, z) of nibabel and NRRD: give axes="xyz" or axes="zyx", or pass the image itself'
            )
    if affine is not None:
        _refuse({"spacing": spacing, "origin": origin}, "stated by the affine too, give one of them")
        space = "RAS" if space is None else space
        matrix = matrix_of(affine)
    else:
        matrix = (_IDENTITY if found.affine is None else found.affine).copy()
        if spacing is not None:
            matrix[:3, :3] = _with_spacing(matrix[:3, :3], _by_axis("spacing", spacing, axes))
        if origin is not None:
            matrix[:3, 3] = _numbers("origin", origin)
        if space is not None and found.space is not None:
            if space != found.space:
                raise ValueError(f"space: {space!r}, but places of the image are in {found.space}: leave space out")
            # They are in LPS already.
            space = "LPS"
    if space is not None:
        matrix = in_world(matrix, space)
        facts["oriented"] = space != "world"
    facts["affine"] = tuple(tuple(row) for row in matrix[:3].tolist())
    return found.array, axes, facts


def matrix_of(affine: Any) -> np.ndarray[Any, Any]:
    """Return an affine as a matrix. Raises ValueError for other shapes."""
    matrix = np.array(affine, dtype=np.float64)
    if matrix.shape != (4, 4):
        raise ValueError(f"affine: an array of shape {matrix.shape}, expected 4 x 4")
    return matrix


def in_world(matrix: np.ndarray[Any, Any], space: str) -> np.ndarray[Any, Any]:
    """Return an affine that leads to a space as one to the world of voxsplat, which is LPS for patients."""
    if space not in ("RAS", "LPS", "world"):
        raise ValueError(f"space: {space!r}, expected 'RAS', 'LPS' or 'world'")
    return TO_LPS @ matrix if space == "RAS" else matrix


def _has_x_first(data: Any) -> bool:
    """Return whether an array of three axes is likely to be (x, y, z): its first axis is the fastest in memory.

    Packages that read files in the order of their samples make such arrays: nibabel, pynrrd, memory maps in the order
    of Fortran. An array that the caller has transposed does not count, because then the caller minds the axes; nor does
    an array of another package, which may state its axes.
    """
    if not isinstance(data, np.ndarray) or data.ndim != 3:
        return False
    strides = [abs(stride) for stride, n in zip(data.strides, data.shape, strict=True) if n > 1]
    owner = data
    while isinstance(owner.base, np.ndarray):
        owner = owner.base
    is_transposed = owner.ndim > 1 and owner.flags.c_contiguous
    return len(strides) > 1 and all(a < b for a, b in pairwise(strides)) and not is_transposed


def native_slice(
    samples: Any, *, slope: float = 1.0, intercept: float = 0.0, replace_nan: float | None = None
) -> _native.Volume:
    """Return the volume of a slice of axes (z, y, x), whose place in the world a plan knows."""
    _, _, facts = located(np.empty((1, 1, 1)))
    facts |= {"slope": slope, "intercept": intercept, "replace_nan": replace_nan}
    return _native.Volume.of_array(samples_of(samples, "zyx"), facts)


def samples_of(array: Any, axes: str) -> np.ndarray[Any, Any]:
    """Return the samples of an array as an ndarray of axes (z, y, x)."""
    return _zyx(_samples(array), axes)


def _path(data: Any) -> str | None:
    if isinstance(data, (str, os.PathLike)):
        path = os.fspath(data)
        if isinstance(path, bytes):
            path = os.fsdecode(path)
        if not path.strip():
            raise TypeError(f"{path!r} is no volume, expected the path of a file, or an array: see voxsplat.Volume")
        return path
    return None


def _refuse(given: Mapping[str, Any], reason: str) -> None:
    for name, value in given.items():
        if value is not None:
            raise ValueError(f"{name}: it is {reason}")


def _numbers(name: str, values: Sequence[float], count: int = 3) -> tuple[float, ...]:
    try:
        numbers = tuple(float(value) for value in values)
    except TypeError:
        numbers = ()
    if len(numbers) != count:
        raise ValueError(f"{name}: {values!r}, expected {count} numbers")
    return numbers


def _by_axis(name: str, values: Sequence[float], axes: str) -> tuple[float, ...]:
    """Return lengths in the order of the axes of an array as lengths along x, y and z; 1 along missing axes."""
    letters = axes.lower()
    numbers = _numbers(name, values, len(letters))
    of = dict(zip(letters, numbers, strict=True))
    spread = tuple(of.get(letter, 1.0) for letter in "xyz")
    if any(not (value > 0 and np.isfinite(value)) for value in spread):
        raise ValueError(f"{name}: {values!r}, expected lengths over 0")
    return spread


def _with_spacing(matrix: np.ndarray[Any, Any], spacing: tuple[float, ...]) -> np.ndarray[Any, Any]:
    """Return an affine with the directions of a matrix and another spacing."""
    turned: np.ndarray[Any, Any] = matrix / np.linalg.norm(matrix, axis=0) * np.array(spacing)
    return turned


def _units(units: Mapping[str, str] | str | None) -> dict[str, str]:
    if units is None:
        return {}
    if isinstance(units, str):
        return {"length_unit": units}
    known = {"length": "length_unit", "value": "value_unit"}
    for key in units:
        if key not in known:
            raise ValueError(f"units: {key!r}, expected 'length' or 'value'")
    return {known[key]: str(value) for key, value in units.items()}


def _samples(data: Any) -> np.ndarray[Any, Any]:
    """Return the numbers of an array-like object, in a type and a byte order of this machine."""
    if isinstance(data, np.ndarray):
        array = data
    elif hasattr(data, "__cuda_array_interface__") or _is_on_device(data):
        raise ValueError("the array is on a device: copy it to the host first, such as by .cpu() or .get()")
    elif hasattr(data, "dask") and hasattr(data, "compute"):
        array = np.asarray(data.compute())
    elif hasattr(data, "detach") and hasattr(data, "numpy"):
        array = data.detach().numpy()
    elif hasattr(data, "__array__") or hasattr(data, "__array_interface__"):
        array = np.asarray(data)
    elif hasattr(data, "__dlpack__"):
        array = np.from_dlpack(data)
    elif hasattr(data, "shape") and hasattr(data, "__getitem__"):
        array = np.asarray(data[...])
    else:
        array = np.asarray(data)
    if isinstance(array, np.ma.MaskedArray):
        if np.ma.is_masked(array):
            raise ValueError("the array masks samples: fill them, such as by array.filled(0)")
        array = array.data
    if array.ndim == 2:
        array = array[np.newaxis]
    return _native_type(array)


def _is_on_device(data: Any) -> bool:
    device = getattr(data, "__dlpack_device__", None)
    # 1 is memory of the host, 3 memory of the host that CUDA has pinned.
    return device is not None and int(device()[0]) not in (1, 3)


def _native_type(array: np.ndarray[Any, Any]) -> np.ndarray[Any, Any]:
    kind = array.dtype.kind
    if kind == "b":
        return array.view(np.uint8)
    if kind not in "iuf":
        raise ValueError(f"an array of type {array.dtype} cannot be drawn, expected integers or real numbers")
    wanted = array.dtype.newbyteorder("=")
    if kind == "f" and array.dtype.itemsize not in (4, 8):
        wanted = np.dtype(np.float32 if array.dtype.itemsize < 4 else np.float64)
    if wanted != array.dtype or not array.flags.aligned:
        array = array.astype(wanted)
    return array


def _zyx(array: np.ndarray[Any, Any], axes: str) -> np.ndarray[Any, Any]:
    """Return a view of an array with the axes z, y, x. Axes of length 1 may be missing from the names."""
    letters = axes.lower()
    if len(letters) == 2 and array.shape[0] == 1:
        letters = next(letter for letter in "zyx" if letter not in letters) + letters
    if sorted(letters) != ["x", "y", "z"]:
        raise ValueError(f"axes: {axes!r}, expected an order of the letters z, y and x, such as 'zyx'")
    if array.ndim != 3:
        hint = "" if array.ndim < 3 else ": choose a time point or a channel by an index"
        raise ValueError(f"an array of shape {array.shape} has {array.ndim} axes, expected three (z, y, x){hint}")
    if 0 in array.shape:
        raise ValueError(f"an array of shape {array.shape} has no samples")
    return array.transpose([letters.index(letter) for letter in "zyx"])
