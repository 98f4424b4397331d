"""Arrays of the objects of other packages, with the facts that they state.

Objects are told apart by their attributes, so that no package is imported that the caller does not use. Each package
has its own custom for the order of axes, spacing, origin and orientation:

=====================  ======================  ==================================================================
object                 axes of its array       place in the world
=====================  ======================  ==================================================================
ndarray and the like   z, y, x                 ``spacing`` in the order of the shape; no orientation
xarray.DataArray       by the names of dims    coordinates, if equally spaced; units of coordinates and values
nibabel image          x, y, z                 ``affine``, from RAS to LPS; oriented if the header has a form
SimpleITK.Image        z, y, x                 spacing, origin and direction, LPS; oriented
pyvista.ImageData      x, y, z                 spacing, origin and direction; no orientation
=====================  ======================  ==================================================================
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

__all__ = ["TO_LPS", "Found", "found_in"]

# From right, anterior, superior to left, posterior, superior.
TO_LPS = np.diag([-1.0, -1.0, 1.0, 1.0])
# Names of dimensions: of arrays in general, of patients and of the earth.
_NAMES = {
    "x": ("x", "i", "col", "column", "lon", "longitude", "width", "right", "left"),
    "y": ("y", "j", "row", "lat", "latitude", "height", "anterior", "posterior"),
    "z": ("z", "k", "slice", "plane", "depth", "lev", "level", "altitude", "superior", "inferior"),
}


class Found:
    """An array with the facts that its object states."""

    def __init__(self, array: Any, **facts: Any) -> None:
        self.array = array
        self.axes: str = facts.pop("axes", "zyx")
        self.affine: np.ndarray[Any, Any] | None = facts.pop("affine", None)
        # The space that affines of the package lead to, if it is one of patients; `affine` leads to LPS then.
        self.space: str | None = facts.pop("space", None)
        self.facts: dict[str, Any] = facts


def found_in(data: Any) -> Found:
    """Return the array of an object, with the facts that the object states."""
    if isinstance(data, np.ndarray):
        return Found(data)
    if data is None or isinstance(data, Mapping):
        raise _no_volume(data)
    if hasattr(data, "dataobj") and hasattr(data, "affine") and hasattr(data, "header"):
        return _of_nibabel(data)
    if all(hasattr(data, name) for name in ("GetSpacing", "GetOrigin", "GetDirection", "GetPixelIDValue")):
        return _of_simpleitk(data)
    if all(hasattr(data, name) for name in ("dimensions", "spacing", "origin", "active_scalars")):
        return _of_pyvista(data)
    if all(hasattr(data, name) for name in ("dims", "coords", "attrs", "values")):
        return _of_xarray(data)
    are_arrays = ("__array__", "__array_interface__", "__dlpack__", "__cuda_array_interface__", "shape")
    if not isinstance(data, (list, tuple)) and not any(hasattr(data, name) for name in are_arrays):
        raise _no_volume(data)
    return Found(data)


def _no_volume(data: Any) -> TypeError:
    """Return the error of an object that is no volume."""
    choice = "one of its arrays, such as volume[NAME], or " if hasattr(data, "keys") else ""
    return TypeError(
        f"{type(data).__name__} is no volume, expected {choice}an array of axes (z, y, x) such as of NumPy, xarray, Zarr or "
        "Dask, an image of nibabel, SimpleITK or pyvista, a voxsplat.Volume, or the path of a file"
    )


def _of_nibabel(image: Any) -> Found:
    header, proxy = image.header, image.dataobj
    # Headers of AFNI, Philips and MINC have no fields by name.
    fields = header if hasattr(header, "__getitem__") else {}
    slope, intercept = 1.0, 0.0
    # Volumes of AFNI and Philips have several factors, which nibabel applies.
    has_one_map = hasattr(proxy, "slope") and getattr(proxy, "scaling", None) is None
    if has_one_map:
        array = proxy.get_unscaled()
        slope, intercept = float(proxy.slope), float(proxy.inter)
    else:
        array = np.asanyarray(proxy)
    array = np.asarray(array)
    while array.ndim > 3 and array.shape[-1] == 1:
        array = array[..., 0]
    forms = [int(fields[form]) for form in ("sform_code", "qform_code") if form in fields]
    facts: dict[str, Any] = {"slope": slope, "intercept": intercept, "oriented": any(forms) if forms else True}
    description = _text(fields, "descrip")
    facts["description"] = description or None
    if hasattr(header, "get_xyzt_units"):
        facts["length_unit"] = {"meter": "m", "mm": "mm", "micron": "µm"}.get(header.get_xyzt_units()[0])
    if "intent_code" in fields:
        # Statistics, by the numbers of NIfTI; SPM states none.
        units = {2: "r", 3: "t", 4: "F", 5: "z", 22: "p"}
        facts["value_unit"] = units.get(int(fields["intent_code"]), "t" if description.startswith("SPM{T") else None)
    if "dim_info" in fields:
        # Axes of frequency or phase, or an echo time as dcm2niix writes it.
        has_echo = any(field.strip().startswith("TE=") for field in description.split(";"))
        facts["modality"] = "MR" if int(fields["dim_info"]) & 15 or has_echo else None
    return Found(array, axes="xyz", affine=TO_LPS @ np.asarray(image.affine, dtype=np.float64), space="RAS", **facts)


def _text(header: Any, field: str) -> str:
    return bytes(header[field]).split(b"\0")[0].decode("latin-1").strip() if field in header else ""


def _of_simpleitk(image: Any) -> Found:
    if image.GetNumberOfComponentsPerPixel() != 1:
        raise ValueError("an image of vectors: choose a component, such as by SimpleITK.VectorIndexSelectionCast")
    if image.GetDimension() != 3:
        raise ValueError(f"an image of {image.GetDimension()} dimensions, expected 3: extract a volume")
    # The view of the samples that SimpleITK offers without importing it here: its own module has the function.
    module = __import__(type(image).__module__.split(".")[0])
    array = module.GetArrayViewFromImage(image)
    matrix = np.eye(4)
    matrix[:3, :3] = np.array(image.GetDirection()).reshape(3, 3) * np.array(image.GetSpacing())
    matrix[:3, 3] = image.GetOrigin()
    return Found(array, affine=matrix, space="LPS", oriented=True)


def _of_pyvista(grid: Any) -> Found:
    scalars = grid.active_scalars
    if scalars is None:
        raise ValueError("the grid has no active scalars: set_active_scalars chooses an array")
    shape = tuple(int(n) for n in grid.dimensions)
    on_points = len(scalars) == np.prod(shape)
    if not on_points:
        shape = tuple(max(n - 1, 1) for n in shape)
    if np.ndim(scalars) != 1 or len(scalars) != np.prod(shape):
        raise ValueError(f"scalars of shape {np.shape(scalars)}, expected one number for each point or cell")
    matrix = np.eye(4)
    direction = np.asarray(getattr(grid, "direction_matrix", np.eye(3)), dtype=np.float64)
    matrix[:3, :3] = direction * np.array(grid.spacing)
    matrix[:3, 3] = np.array(grid.origin) + (0.0 if on_points else matrix[:3, :3] @ np.full(3, 0.5))
    # Points lie with x fastest.
    return Found(np.asarray(scalars).reshape(shape[::-1]), affine=matrix)


def _of_xarray(data: Any) -> Found:
    names = [str(name) for name in data.dims]
    letters = _letters(names)
    for name, size in zip(names, data.shape, strict=True):
        if letters[name] is None and size != 1:
            raise ValueError(f"dimension {name!r} has {size} values: choose one, such as by .isel({name}=0)")
    spatial = [name for name in names if letters[name] is not None]
    data = data.isel({name: 0 for name in names if letters[name] is None})
    axes = "".join(str(letters[name]) for name in spatial)
    matrix, units = np.eye(4), set()
    for name in spatial:
        axis = "xyz".index(str(letters[name]))
        if name in data.coords and data.coords[name].ndim == 1 and data.coords[name].dtype.kind in "iuf":
            coordinate = data.coords[name]
            first, step = _equally_spaced(name, np.asarray(coordinate.values, dtype=np.float64))
            matrix[axis, axis], matrix[axis, 3] = step, first
            units.add(coordinate.attrs.get("units"))
    facts: dict[str, Any] = {"value_unit": data.attrs.get("units")}
    if len(units) == 1:
        facts["length_unit"] = units.pop()
    if "long_name" in data.attrs:
        facts["description"] = str(data.attrs["long_name"])
    return Found(data.data, axes=axes, affine=matrix, **facts)


def _letters(names: Sequence[str]) -> dict[str, str | None]:
    """Return the letter of each dimension: by its name, otherwise z, y and x of the last three."""
    letters: dict[str, str | None] = {
        name: next((letter for letter, known in _NAMES.items() if name.lower() in known), None) for name in names
    }
    given = [letter for letter in letters.values() if letter is not None]
    if len(set(given)) == len(given) and len(given) in (2, 3):
        return letters
    last = names[-3:]
    return dict.fromkeys(names) | dict(zip(last, "zyx"[-len(last) :], strict=True))


def _equally_spaced(name: str, values: np.ndarray[Any, Any]) -> tuple[float, float]:
    """Return the first of equally spaced coordinates and their step."""
    if len(values) < 2:
        return float(values[0]), 1.0
    step = (values[-1] - values[0]) / (len(values) - 1)
    steps = np.diff(values)
    if not np.isfinite(step) or step == 0 or np.abs(steps - step).max() > 1e-3 * abs(step):
        raise ValueError(
            f"coordinate {name!r} is not equally spaced (steps {steps.min():g} to {steps.max():g}): "
            "interpolate it, or drop the coordinate and give spacing="
        )
    return float(values[0]), float(step)
