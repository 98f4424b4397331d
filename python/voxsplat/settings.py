"""The view and the settings of a picture, and their values for the native module."""

from __future__ import annotations

import functools
import inspect
import json
import os
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any, TypeVar

from . import _native

__all__ = [
    "SIZE",
    "Settings",
    "View",
    "as_texts",
    "check",
    "checked",
    "documented",
    "field_names",
    "parameter_texts",
    "pixels",
    "refuse_unknown",
    "single",
    "split",
    "whole_numbers",
]

SIZE = (1024, 1024)
_Kind = TypeVar("_Kind")
_Function = TypeVar("_Function", bound=Callable[..., Any])


def refuse_unknown(given: Iterable[str], known: Iterable[str], of: str) -> None:
    """Raise TypeError for a name that is not known, with the name that may have been meant."""
    names = sorted(known)
    for name in given:
        if name not in names:
            raise TypeError(f"{name!r} is no option of {of}{_native.hint(name, names)}")


def field_names(*kinds: type[Any]) -> set[str]:
    """Return the names of the fields of dataclasses."""
    return {field.name for kind in kinds for field in fields(kind)}


def _hinting(kind: type[_Kind]) -> type[_Kind]:
    """Return a dataclass whose error for a wrong field has a hint."""
    made = kind.__init__

    @functools.wraps(made)
    def init(self: _Kind, *values: Any, **named: Any) -> None:
        refuse_unknown(named, field_names(kind), kind.__name__)
        made(self, *values, **named)

    kind.__init__ = init  # type: ignore[assignment]
    return kind


def parameter_texts(of: Any) -> dict[str, str]:
    """Return the parameters that a docstring describes, each with its description, indented as there."""
    doc = inspect.cleandoc(of.__doc__ or "")
    _, _, section = doc.partition("Parameters\n----------\n")
    section = section.partition("\n\n")[0]
    found: dict[str, str] = {}
    names = ""
    for line in section.splitlines():
        if line.startswith(" "):
            found[names] += line + "\n"
        else:
            names = line
            found[names] = ""
    return found


def documented(*kinds: type[Any]) -> Callable[[_Function], _Function]:
    """Return a decorator that adds the parameters of classes to a docstring, for options that a function passes on."""

    def add(function: _Function) -> _Function:
        doc = inspect.cleandoc(function.__doc__ or "")
        head, options, tail = doc.partition("**options\n")
        own = {name for names in parameter_texts(function) for name in names.split(", ")}
        rows = {names: text for kind in kinds for names, text in parameter_texts(kind).items()
                if names not in own | {"data"}}
        if options:
            function.__doc__ = head + "".join(f"{names}\n{text}" for names, text in rows.items()) + options + tail
        return function

    return add


@_hinting
@dataclass(frozen=True, kw_only=True)
class View:
    """The place of the eye.

    A view without `azimuth`, `elevation`, `roll`, `up` and `direction` shows the side that suits the volume: the front
    of an oriented volume, otherwise azimuth 30 and elevation 20.

    Parameters
    ----------
    azimuth
        Degrees by which the eye turns about `up`, from the front towards world +x.
    elevation
        Degrees by which the eye rises towards `up`.
    roll
        Degrees by which the camera turns about its axis, counter-clockwise.
    up
        World direction (x, y, z) that is up in the picture; (0, 0, 1) by default.
    direction
        World direction from the eye to the target, in place of azimuth and elevation.
    target
        World point (x, y, z) in the middle of the picture.
    projection
        ``"orthographic"`` or ``"perspective"``.
    fov
        Vertical field of view of a perspective in degrees, over 0 and under 180; 30 by default.
    zoom
        Magnification, over 0.
    frame
        What is fitted: visible voxels at one size for every azimuth (``"visible"``, the default of a series), as
        large as the view permits (``"view"``, the default of `render`), or the box (``"volume"``, the default with
        `target`, `view_height` or `distance`).
    margin
        Free fraction of the picture at each side, 0 to under 0.5; 0.02 by default.
    view_height
        World height that the picture spans at the target, in the unit of the volume.
    distance
        World distance from the eye to the target, in the unit of the volume; in perspective.
    """

    azimuth: float | None = None
    elevation: float | None = None
    roll: float = 0.0
    up: Sequence[float] | None = None
    direction: Sequence[float] | None = None
    target: Sequence[float] | None = None
    projection: str = "orthographic"
    fov: float | None = None
    zoom: float = 1.0
    frame: str | None = None
    margin: float | None = None
    view_height: float | None = None
    distance: float | None = None


@_hinting
@dataclass(frozen=True, kw_only=True)
class Settings:
    """The appearance of a picture. Fields that are None are chosen for the volume.

    Texts are spelled as options of the command ``voxsplat render``; its guide describes their effects.

    Parameters
    ----------
    transfer
        A preset (see `presets`), a file of a transfer function, ``"map:NAME"``, ``"labels"``, a dictionary such as
        ``{"points": [{"value": 0, "color": "#ffffff", "opacity": 0}, ..]}``, or a sequence of (value, colour,
        opacity); opacities belong to slabs as thick as the smallest spacing.
    window
        (level, width): the values that the transfer function spans.
    transfer_values
        Whether a preset uses ``"absolute"`` values or is ``"fitted"``; ``"auto"``.
    gradient_opacity
        Pairs (magnitude, factor of the opacity), magnitudes in values per world unit, or ``"off"``.
    iso
        Isosurfaces: a value, or a list of values, (value, colour) and (value, colour, opacity). They are post-shaded,
        but the processor draws them among voxels of labels and overlays; without `transfer` nothing else is shown.
    classification
        How pre-shading classifies values: ``"point"``, at each voxel; ``"band-limited"``, as the mean over the
        values around it, without rings on smooth surfaces; ``"auto"``: point for a transfer function with steps.
        None: what the transfer function says, or auto.
    model
        ``"composite"``, ``"xray"``, ``"mip"``, ``"minip"`` or ``"average"``.
    response
        Of an X-ray: ``"absorption"``, ``"depth"``, ``"window[:LOW,HIGH]"`` or ``"film[:EXPOSURE,GAMMA]"``.
    depth_coded
        Whether colours of mip and minip encode depth.
    attenuation
        Of mip: dims distant values by up to exp(-attenuation), 0 to 20.
    shading
        ``"pre"`` (fast) or ``"post"`` (sharp).
    light
        ``"studio"``, ``"studio:eye"``, ``"headlight"``, ``"AZ,EL"``, ``"@X,Y,Z"``, (azimuth, elevation), False
        (off), or a list of up to 4.
    material
        (ambient, diffuse, specular, shininess): three of 0 to 1, and 1 to 1000.
    shadows
        True, False, a strength of 0 to 1, or ``"exact"``.
    light_size
        Angular size of lights at (azimuth, elevation), 0 to 90 degrees.
    occlusion
        Radius of ambient occlusion in voxels, or False.
    normals
        Normals of voxels in pre-shaded light: ``"gradient"``, or ``"tensor"`` (the default), the dominant axis of
        gradients around a voxel, which has no specks on thin layers in noise.
    shadow_bias
        Occluders closer than this many voxels are ignored, 0 to 16.
    clip
        Parts to keep: ``"R"`` (a side of the patient), ``"voxels:10:20,:,40:"`` (x, y, z),
        ``"box:X0,X1,Y0,Y1,Z0,Z1"``, ``"NX,NY,NZ[,D]"``, or a list of them; up to 8 planes.
    kernel
        ``"gaussian[:SIGMA,RADIUS]"`` or ``"kaiser-bessel[:RADIUS,ALPHA]"``, lengths in voxels.
    sharpness
        The share of the kernel's blur that is undone, 0 to 1.
    level
        Cells of 2^level voxels replace voxels, 0 to 12; ``"auto"`` may choose cells between two levels.
    painter
        ``"auto"``, ``"tiles"``, ``"quads"``, or ``"cpu"``: rays on the processor, without a graphics driver.
    sheet_thickness
        Of quads: thickness of a sheet in voxels, 0.05 to 64; 1 by default.
    termination
        Light below which rays end, 0 to under 1. No channel of the picture changes by more.
    antialiasing
        Whether kernels grow if voxels are closer together than pixels.
    label
        Looks of labels: ``{3: "red", "liver": 0.2, "1,4,7-9": "off"}`` or texts such as ``"all:0.2"``. A look is an
        opacity of 0 to 1, ``"x0.5"`` (a factor of it), ``"on"``, ``"off"`` or a colour; later looks change earlier
        ones.
    label_table
        A file with names, colours and opacities of labels.
    """

    transfer: Any = None
    window: Sequence[float] | None = None
    transfer_values: str = "auto"
    gradient_opacity: str | Sequence[tuple[float, float]] | None = None
    iso: float | str | Sequence[Any] | None = None
    classification: str | None = None
    model: str = "composite"
    response: str = "absorption"
    depth_coded: bool = False
    attenuation: float = 0.0
    shading: str = "pre"
    light: str | bool | Sequence[Any] | None = None
    material: Sequence[float] | None = None
    shadows: str | bool | float | None = None
    light_size: float | None = None
    occlusion: str | float | bool | None = None
    normals: str | None = None
    shadow_bias: float | None = None
    clip: str | Sequence[Any] | None = None
    kernel: str | None = None
    sharpness: float | None = None
    level: str | int = "auto"
    painter: str = "auto"
    sheet_thickness: float | None = None
    termination: float = 1e-3
    antialiasing: bool = True
    label: Mapping[Any, Any] | str | Sequence[str] | None = None
    label_table: str | os.PathLike[str] | None = None


def split(options: dict[str, Any], *kinds: type) -> list[dict[str, Any]]:
    """Take the fields of dataclasses out of keyword arguments."""
    names = [field_names(kind) for kind in kinds]
    return [{name: options.pop(name) for name in list(options) if name in known} for known in names]


def whole_numbers(name: str, values: Sequence[int], count: int) -> tuple[int, ...]:
    """Return whole numbers of 0 to 2^32 - 1. Raises ValueError for others."""
    try:
        numbers = tuple(int(value) for value in values)
        is_whole = all(number == value for number, value in zip(numbers, values, strict=True))
    except (TypeError, ValueError):
        numbers, is_whole = (), False
    if len(numbers) != count or not is_whole or not all(0 <= number < 1 << 32 for number in numbers):
        raise ValueError(f"{name}: {values!r}, expected {count} whole numbers of pixels")
    return numbers


def pixels(size: Any) -> tuple[int, int]:
    """Return a size in pixels; one number is a square."""
    width, height = whole_numbers("size", (size, size) if isinstance(size, int) else size, 2)
    return width, height


def single(options: dict[str, Any], frame: str = "view") -> dict[str, Any]:
    """Return the options of one picture: it is as large as its view permits, unless an option frames or places it."""
    is_placed = any(options.get(name) is not None for name in ("frame", "target", "view_height", "distance"))
    return options if is_placed else options | {"frame": frame}


def checked(view: View) -> View:
    """Return a view whose vectors are tuples of numbers."""
    numbers: dict[str, Any] = {name: _vector(name, getattr(view, name)) for name in ("up", "direction", "target")}
    return replace(view, **numbers)


def _vector(name: str, values: Sequence[float] | None, count: int = 3) -> tuple[float, ...] | None:
    if values is None:
        return None
    try:
        vector = tuple(float(value) for value in values)
    except (TypeError, ValueError):
        vector = ()
    if len(vector) != count:
        raise ValueError(f"{name}: {values!r}, expected {count} numbers")
    return vector


def as_texts(settings: Settings) -> Settings:
    """Return settings as the texts and numbers of the native module."""
    gradient, occlusion, shadows = settings.gradient_opacity, settings.occlusion, settings.shadows
    if gradient is not None and not isinstance(gradient, str):
        gradient = ",".join(f"{float(magnitude)!r}:{float(opacity)!r}" for magnitude, opacity in gradient) or "off"
    if isinstance(shadows, bool):
        shadows = "on" if shadows else "off"
    if occlusion is True:
        raise ValueError("occlusion: True, expected a radius in voxels or False")
    return replace(
        settings,
        transfer=_transfer(settings.transfer),
        window=_vector("window", settings.window, 2),
        gradient_opacity=gradient,
        iso=_isosurfaces(settings.iso),
        light=_lights(settings.light),
        material=_vector("material", settings.material, 4),
        shadows=None if shadows is None else str(shadows),
        occlusion=None if occlusion is None else "off" if occlusion is False else str(occlusion),
        clip=_clips(settings.clip),
        level=str(settings.level),
        label=_labels(settings.label),
    )


def check(view: View, settings: Settings, size: tuple[int, int]) -> None:
    """Raise ValueError or TypeError for a view and settings that no volume can be drawn with."""
    try:
        _native.check(checked(view), as_texts(settings), size)
    except TypeError as fault:
        # The native module names the field alone.
        found = re.search(r"field \w+\.(\w+)", str(fault))
        if found is None:
            raise
        (name,) = found.groups()
        owner = view if name in field_names(View) else settings
        expected = type(owner).__annotations__[name]
        raise TypeError(f"{name}: {getattr(owner, name)!r}, expected {expected}") from fault


def _isosurfaces(iso: float | str | Sequence[Any] | None) -> list[str]:
    if iso is None:
        return []
    surfaces = iso if isinstance(iso, Iterable) and not isinstance(iso, str) else [iso]
    parts = ([surface] if isinstance(surface, str) or not isinstance(surface, Iterable) else surface
             for surface in surfaces)
    return [":".join(str(part) for part in surface) for surface in parts]


def _clips(clip: str | Sequence[Any] | None) -> list[Any]:
    if clip is None or isinstance(clip, str):
        return [] if clip is None else [clip]
    if not isinstance(clip, Iterable):
        raise ValueError(f"clip: {clip!r}, expected a text or a list of texts")
    return list(clip)


def _labels(label: Mapping[Any, Any] | str | Sequence[str] | None) -> list[str]:
    """Return looks of labels as texts."""
    if label is None or isinstance(label, str):
        return [] if label is None else [label]
    if isinstance(label, Mapping):
        return [f"{which}:{_look(look)}" for which, look in label.items()]
    return [str(one) for one in label]


def _look(look: Any) -> Any:
    if isinstance(look, bool):
        return "on" if look else "off"
    return look if isinstance(look, (str, int, float)) else "#" + "".join(f"{round(255 * c):02x}" for c in look)


def _transfer(transfer: Any) -> Any:
    """Return a transfer function as a name or as the text of a file."""
    if transfer is None or isinstance(transfer, (str, os.PathLike)):
        return transfer
    if isinstance(transfer, Mapping):
        return json.dumps(transfer)
    try:
        points = [{"value": float(value), "color": _colour(color), "opacity": float(opacity)}
                  for value, color, opacity in transfer]
    except (TypeError, ValueError) as fault:
        expected = "a name, a path, a dictionary or (value, colour, opacity) points"
        raise ValueError(f"transfer: {type(transfer).__name__}, expected {expected}") from fault
    return json.dumps({"points": points})


def _colour(color: Any) -> Any:
    return color if isinstance(color, str) else [float(channel) for channel in color]


def _lights(light: Any) -> list[str]:
    if light is None:
        return []
    if isinstance(light, bool):
        return ["studio" if light else "off"]
    if isinstance(light, str):
        return [light]
    if not isinstance(light, Iterable):
        raise ValueError(f"light: {light!r}, expected a text, (azimuth, elevation), False, or a list of them")
    # A pair of angles, or several lights.
    light = list(light)
    if len(light) == 2 and all(isinstance(number, (int, float)) for number in light):
        return [f"{light[0]},{light[1]}"]
    return [text for one in light for text in _lights(one)]
