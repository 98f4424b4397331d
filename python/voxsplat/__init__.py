"""Pictures of voxel volumes.

    import voxsplat

    image = voxsplat.render(volume, azimuth=30, size=(800, 600))
    image.save("volume.png")

`volume` is an array of NumPy, xarray, Zarr, Dask or another package with DLPack, an image of nibabel, SimpleITK or
pyvista, or the path of a file. `render` makes the choices that the command ``voxsplat render`` makes, so both make the
same picture of a file. `Renderer` keeps a device and its scenes for many pictures.

A picture is premultiplied RGBA, f32, composited linearly: its values are the ones of the transfer function's colours
(display values), neither clamped nor encoded again.

Errors are `ValueError` (shapes, types, settings, volumes that cannot be drawn), `MemoryError`, `OSError` (files) and
`DeviceError` (no graphics adapter, or it failed).
"""

from __future__ import annotations

import json
import os
import threading
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from types import TracebackType
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from . import _native
from ._native import DeviceError, __version__
from .bricks import Brick, Partial, Plan, brick, chunk_sizes, merge
from .convert import volume_of

__all__ = [
    "Brick",
    "DeviceError",
    "Image",
    "Partial",
    "Plan",
    "Renderer",
    "Scene",
    "Settings",
    "View",
    "Volume",
    "__version__",
    "adapters",
    "brick",
    "colour_maps",
    "from_napari",
    "info",
    "merge",
    "plan",
    "presets",
    "render",
]

# The documentation of pyclasses lives in the package.
DeviceError.__module__ = "voxsplat"

Progress: TypeAlias = Callable[[str, float], object] | bool | None
"""Called with the stage and the fraction done, 0 to 1; ``True`` shows a bar of tqdm, or lines without tqdm."""

_SIZE = (1024, 1024)


@dataclass(frozen=True, kw_only=True)
class View:
    """Where the eye is. Angles are in degrees, lengths in the unit of the volume's world.

    A view without `azimuth`, `elevation`, `roll`, `up` and `direction` shows the side that suits the volume: the front
    of an oriented volume, otherwise azimuth 30 and elevation 20.
    """

    azimuth: float | None = None
    """Turns the eye about `up`, from the front towards world +x."""
    elevation: float | None = None
    """Raises the eye towards `up`."""
    roll: float = 0.0
    """Turns the camera about its axis, counter-clockwise."""
    up: Sequence[float] | None = None
    """World direction (x, y, z) that is up in the picture; (0, 0, 1) by default."""
    direction: Sequence[float] | None = None
    """World direction from the eye to the target, in place of azimuth and elevation."""
    target: Sequence[float] | None = None
    """World point (x, y, z) in the middle of the picture."""
    projection: str = "orthographic"
    """``"orthographic"`` or ``"perspective"``."""
    fov: float | None = None
    """Vertical field of view of a perspective, over 0 and under 180; 30 by default."""
    zoom: float = 1.0
    """Magnification, over 0."""
    frame: str | None = None
    """What is fitted: ``"visible"`` voxels, as large for every azimuth, ``"view"`` or ``"volume"``, its box."""
    margin: float | None = None
    """Free fraction of the picture at each side, 0 to under 0.5; 0.02 by default."""
    view_height: float | None = None
    """World height that the picture spans at the target."""
    distance: float | None = None
    """World distance from the eye to the target, in perspective."""


@dataclass(frozen=True, kw_only=True)
class Settings:
    """What is drawn, and how. Fields that are None are chosen for the volume.

    Texts are spelled as options of the command ``voxsplat render``; its guide describes their effects.
    """

    transfer: Any = None
    """A preset (see `presets`), a file of a transfer function, ``"map:NAME"``, ``"labels"``, a dictionary such as
    ``{"points": [{"value": 0, "color": "#ffffff", "opacity": 0}, ..]}``, or a sequence of (value, colour, opacity);
    opacities belong to slabs as thick as the smallest spacing."""
    window: Sequence[float] | None = None
    """(level, width): the values that the transfer function spans."""
    transfer_values: str = "auto"
    """Whether a preset uses ``"absolute"`` values or is ``"fitted"``; ``"auto"``."""
    gradient_opacity: str | Sequence[tuple[float, float]] | None = None
    """Pairs (magnitude, factor of the opacity), magnitudes in values per world unit, or ``"off"``."""
    model: str = "composite"
    """``"composite"``, ``"xray"``, ``"mip"``, ``"minip"`` or ``"average"``."""
    response: str = "absorption"
    """Of an X-ray: ``"absorption"``, ``"depth"``, ``"window[:LOW,HIGH]"`` or ``"film[:EXPOSURE,GAMMA]"``."""
    depth_coded: bool = False
    """Whether colours of mip and minip encode depth."""
    attenuation: float = 0.0
    """Of mip: dims distant values by up to exp(-attenuation), 0 to 20."""
    shading: str = "pre"
    """``"pre"`` (fast) or ``"post"`` (sharp)."""
    light: str | bool | Sequence[Any] | None = None
    """``"studio"``, ``"studio:eye"``, ``"headlight"``, ``"AZ,EL"``, ``"@X,Y,Z"``, (azimuth, elevation), False (off),
    or a list of up to 4."""
    material: Sequence[float] | None = None
    """(ambient, diffuse, specular, shininess): three of 0 to 1, and 1 to 1000."""
    shadows: str | bool | float | None = None
    """True, False, a strength of 0 to 1, or ``"exact"``."""
    light_size: float | None = None
    """Angular size of lights at (azimuth, elevation), 0 to 90 degrees."""
    occlusion: str | float | bool | None = None
    """Radius of ambient occlusion in voxels, or False."""
    shadow_bias: float | None = None
    """Occluders closer than this many voxels are ignored, 0 to 16."""
    clip: str | Sequence[Any] | None = None
    """Parts to keep: ``"R"`` (a side of the patient), ``"voxels:10:20,:,40:"`` (x, y, z), ``"box:X0,X1,Y0,Y1,Z0,Z1"``,
    ``"NX,NY,NZ[,D]"``, or a list of them; up to 8 planes."""
    kernel: str | None = None
    """``"gaussian[:SIGMA,RADIUS]"`` or ``"kaiser-bessel[:RADIUS,ALPHA]"``, lengths in voxels."""
    sharpness: float | None = None
    """The share of the kernel's blur that is undone, 0 to 1."""
    level: str | int = "auto"
    """Cells of 2^level voxels replace voxels, 0 to 12; ``"auto"``."""
    painter: str = "auto"
    """``"auto"``, ``"tiles"`` or ``"quads"``."""
    resolution: str | None = None
    """Of tiles: ``"capped"`` or ``"full"``, a ray for each pixel."""
    sheet_thickness: float | None = None
    """Of quads: thickness of a sheet in voxels, 0.05 to 64; 1 by default."""
    termination: float = 1e-3
    """Light below which rays end, 0 to under 1. No channel of the picture changes by more."""
    antialiasing: bool = True
    """Whether kernels grow if voxels are closer together than pixels."""


class Volume:
    """Samples with a place in the world, for many pictures.

    Parameters
    ----------
    data
        An array of three axes, or an object that has one: ndarray, xarray, Zarr, Dask (computed), DLPack, nibabel,
        SimpleITK, pyvista; or a path, a folder of slices, ``"demo:NAME"``. Types are bool, every integer type and every
        real type. The samples are copied once, at their width, whatever the order of the axes in memory; float16 and
        foreign byte orders are converted.
    spacing
        World lengths between samples, in the order of the shape.
    origin
        World point (x, y, z) of the first sample.
    axes
        The axes of the array: ``"zyx"`` by default, ``"xyz"`` for arrays that nibabel indexes.
    affine
        4 x 4 numbers, from (x, y, z) indices to the world, in place of spacing and origin.
    space
        ``"LPS"`` or ``"RAS"``: the affine leads to a patient, whose front is shown and whose sides clip.
    units
        The unit of lengths, such as ``"mm"``, or ``{"length": .., "value": ..}``. Values in ``"HU"`` are CT.
    modality
        In the terms of DICOM: ``"CT"``, ``"MR"``, ``"PT"``; it decides on the preset.
    replace_nan
        Replaces NaN and infinite samples, which are refused otherwise.
    time, channel, dims, dtype, endian, offset, series, missing_slices, pyramid
        Of files, as the options of the command; spacing is then in the order (z, y, x) as well.
    """

    def __init__(self, data: Any, **facts: Any) -> None:
        self._native: _native.Volume = _volume(data, facts)

    def info(self) -> dict[str, Any]:
        """Return lattice, values, and the preset that suits them. Reads all samples."""
        return self._native.info()

    def __repr__(self) -> str:
        return f"<voxsplat.Volume at {id(self):#x}>"


class Image:
    """A picture: an array, a PNG in notebooks, and its statistics.

    ``numpy.asarray(image)`` is f32 of shape (height, width, 4), rows from the top: red, green, blue and alpha,
    premultiplied. It is read-only; ``numpy.array(image)`` is a copy.
    """

    def __init__(self, native: _native.Image) -> None:
        self._native = native

    @property
    def size(self) -> tuple[int, int]:
        """Width and height, pixels."""
        return self._native.size

    @property
    def shape(self) -> tuple[int, int, int]:
        """Height, width and 4."""
        width, height = self.size
        return height, width, 4

    @property
    def stats(self) -> dict[str, Any]:
        """Statistics: adapter, painter, voxels, bytes, and the seconds of each stage."""
        return self._native.stats

    @property
    def choices(self) -> list[str]:
        """The choices that were left open, with their reasons."""
        return self._native.choices

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> NDArray[Any]:
        array = self._native.array
        if dtype is not None and np.dtype(dtype) != array.dtype:
            if copy is False:
                raise ValueError(f"a picture of float32 cannot be {np.dtype(dtype)} without a copy")
            return array.astype(dtype)
        return array.copy() if copy else array

    def rgba8(self, background: str | None = None) -> NDArray[np.uint8]:
        """Return 8-bit RGBA, (height, width, 4), over a background; over ``"transparent"`` alpha is straight."""
        return self._native.rgba8(background)

    def to_png(self, background: str | None = None) -> bytes:
        """Return the bytes of a PNG, over a background such as ``"white"`` or ``"transparent"``."""
        return self._native.to_png(background)

    def save(self, path: str | os.PathLike[str], background: str | None = None) -> None:
        """Write a .png (8 bits) or an .exr (f32). The file appears whole or not at all."""
        self._native.save(path, background)

    def _repr_png_(self) -> bytes:
        return self._native.to_png(None)

    def __repr__(self) -> str:
        width, height = self.size
        return f"<voxsplat.Image of {width} x {height} pixels>"


class Scene:
    """A volume prepared by a `Renderer` with its settings, for many views."""

    def __init__(self, native: _native.Scene) -> None:
        self._native = native

    @property
    def choices(self) -> list[str]:
        """The choices that were left open, with their reasons."""
        return self._native.choices


class Renderer:
    """A graphics device, opened for the first scene. Threads may each have one, or share one in turn.

        with voxsplat.Renderer() as renderer:
            scene = renderer.prepare(volume, "ct-bone")
            for azimuth in range(0, 360, 10):
                renderer.render(scene, azimuth=azimuth).save(f"{azimuth}.png")
    """

    def __init__(self, adapter: str | None = None) -> None:
        """Choose the adapter by a part of its name; None chooses the best one."""
        self._native = _native.Renderer(adapter)

    def prepare(
        self,
        volume: Any,
        transfer: Any = None,
        settings: Settings | None = None,
        view: View | None = None,
        *,
        size: tuple[int, int] = _SIZE,
        progress: Progress = None,
        **changes: Any,
    ) -> Scene:
        """Prepare a volume. Studio light stands around `view` and stays there when the view turns.

        `changes` are fields of `Settings`, and of `Volume` for a volume that is none yet.
        """
        settings = settings if settings is not None else Settings()
        names = {field.name for field in fields(Settings)}
        settings = replace(settings, **{name: changes.pop(name) for name in list(changes) if name in names})
        if transfer is not None:
            settings = replace(settings, transfer=transfer)
        source = _volume(volume, changes)
        size = _pixels(size)
        with _Reported(progress) as report:
            scene = self._native.prepare(source, _texts(settings), _checked(view or View()), size, report)
        return Scene(scene)

    def render(
        self,
        scene: Scene,
        view: View | None = None,
        *,
        size: tuple[int, int] = _SIZE,
        region: tuple[int, int, int, int] | None = None,
        background: str = "black",
        progress: Progress = None,
        **changes: Any,
    ) -> Image:
        """Render a scene of this renderer: `size` is (width, height), 1 to 32768 pixels.

        Without a view the picture has the view that the scene was prepared with. `changes` are fields of `View`.
        `region` is (x, y, width, height), a part of the picture with the same pixels.
        """
        if changes:
            view = replace(view or View(), **changes)
        given = None if view is None else _checked(view)
        part = None if region is None else _whole("region", region, 4)
        with _Reported(progress) as report:
            image = self._native.render(scene._native, given, _pixels(size), part, background, report)  # type: ignore[arg-type]
        return Image(image)

    def close(self) -> None:
        """Close the device. Scenes and pictures of the renderer stay, but the scenes cannot be rendered."""
        self._native.close()

    def __enter__(self) -> Renderer:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


_thread = threading.local()


def _renderer(adapter: str | None) -> Renderer:
    """The renderer that this thread keeps for `render`."""
    kept: tuple[str | None, int, Renderer] | None = getattr(_thread, "renderer", None)
    if kept is not None and kept[:2] == (adapter, os.getpid()):
        return kept[2]
    renderer = Renderer(adapter)
    _thread.renderer = (adapter, os.getpid(), renderer)
    return renderer


def render(
    volume: Any,
    transfer: Any = None,
    *,
    size: tuple[int, int] = _SIZE,
    azimuth: float | None = None,
    elevation: float | None = None,
    light: str | bool | Sequence[Any] | None = None,
    shading: str = "pre",
    model: str = "composite",
    kernel: str | None = None,
    sharpness: float | None = None,
    spacing: Sequence[float] | None = None,
    background: str = "black",
    region: tuple[int, int, int, int] | None = None,
    adapter: str | None = None,
    executor: Any = None,
    progress: Progress = None,
    **options: Any,
) -> Image:
    """Render a picture of a volume.

    Parameters
    ----------
    volume
        An array of axes (z, y, x), an image of another package, or a path: see `Volume`.
    transfer
        A preset, a file, ``"map:NAME"``, ``"labels"``, a dictionary or points: see `Settings`. By default the preset
        that suits the volume.
    size
        (width, height), 1 to 32768 pixels.
    azimuth, elevation
        The side of the volume, degrees: see `View`.
    light, shading, model, kernel, sharpness
        See `Settings`. By default surfaces are in studio light at sharpness 0.5.
    spacing
        World lengths between samples, in the order of the shape.
    background
        Behind PNGs of the picture: ``"#rrggbb"``, a name or ``"transparent"``. The array has none.
    region
        (x, y, width, height) of a part of the picture, whose pixels are the ones of the whole picture.
    adapter
        A part of the name of the graphics adapter: see `adapters`.
    executor
        Draws the picture in bricks, by an object with ``submit`` such as `concurrent.futures.ProcessPoolExecutor`: see
        `voxsplat.dask.render`, whose parameters are options then. Needs ``pip install voxsplat[dask]``.
    progress
        A callback of (stage, fraction), or True for a bar.
    **options
        Further fields of `View`, `Settings` and `Volume`.

    Raises
    ------
    ValueError
        Shapes, types, settings out of range, and volumes that cannot be drawn, such as NaN without `replace_nan`.
    MemoryError, OSError, DeviceError
        No memory on the host or the device; a file that cannot be read; no adapter, with what to install.
    """
    options |= {"azimuth": azimuth, "elevation": elevation, "light": light, "shading": shading, "model": model}
    options |= {"kernel": kernel, "sharpness": sharpness}
    if spacing is not None:
        options["spacing"] = spacing
    if executor is not None:
        if region is not None:
            raise ValueError("region: a picture in bricks is drawn whole")
        try:
            from .dask import render as render_in_bricks
        except ImportError as fault:
            raise ImportError(f"executor= needs Dask ({fault}): pip install voxsplat[dask]") from fault
        with _Reported(progress) as report:
            return render_in_bricks(
                volume,
                transfer,
                size=_pixels(size),
                executor=executor,
                adapter=adapter,
                background=background,
                progress=report,
                **options,
            )
    names = [{field.name for field in fields(kind)} for kind in (View, Settings)]
    parts = [{name: options.pop(name) for name in list(options) if name in known} for known in names]
    view, settings = View(**parts[0]), Settings(transfer=transfer, **parts[1])
    # Before a long conversion.
    _native.check(_checked(view), _texts(settings), _pixels(size))
    renderer = _renderer(adapter)
    scene = renderer.prepare(_volume(volume, options), settings=settings, view=view, size=size, progress=progress)
    return renderer.render(scene, size=size, background=background, region=region, progress=progress)


def plan(
    volume: Any,
    grid: Sequence[Any],
    *,
    transfer: Any = None,
    size: tuple[int, int] = _SIZE,
    shape: Sequence[int] | None = None,
    affine: Any = None,
    **options: Any,
) -> Plan:
    """Plan a picture in bricks, which `brick` draws of slices of the samples, on any machine, and `merge` merges.

    Parameters
    ----------
    volume
        The volume, as for `render`; or an overview: an array with fewer samples of the same type in the same place,
        such as a coarse level of a pyramid or every 8th sample. The transfer function, the frame, the light and the
        memory of bricks are chosen by it.
    grid
        Numbers of chunks along (z, y, x), or three sequences of sizes of chunks in voxels, such as ``darr.chunks``.
    transfer, size
        See `render`.
    shape, affine
        Of the volume itself, if `volume` is an overview: its shape (z, y, x), and 4 x 4 numbers from its (x, y, z)
        indices to the world.
    **options
        Further fields of `View`, `Settings` and, of the overview, `Volume`. A ray is drawn for each pixel. Light that
        is not given has no shadows; shadows, occlusion, labels and channels are refused.

    Raises
    ------
    ValueError
        Settings out of range, and pictures that cannot be drawn in bricks.
    """
    if shape is not None and (affine is None or len(shape) != 3):
        raise ValueError("shape: expected three numbers (z, y, x), with an affine of the volume")
    rows = None
    if shape is None:
        if affine is not None:
            options["affine"] = affine
    else:
        matrix = np.array(affine, dtype=np.float64)
        if matrix.shape != (4, 4):
            raise ValueError(f"affine: an array of shape {matrix.shape}, expected 4 x 4")
        rows = tuple(tuple(row) for row in matrix[:3].tolist())
        clip = options.get("clip") or []
        if any(str(one).startswith("voxels:") for one in ([clip] if isinstance(clip, str) else clip)):
            raise ValueError("clip: voxels of an overview are not those of the volume, give a box: box:X0,X1,Y0,Y1,Z0,Z1")
    names = [{field.name for field in fields(kind)} for kind in (View, Settings)]
    parts = [{name: options.pop(name) for name in list(options) if name in known} for known in names]
    view, settings = View(**parts[0]), Settings(transfer=transfer, **parts[1])
    size = _pixels(size)
    _native.check(_checked(view), _texts(settings), size)
    overview = _volume(volume, options)
    whole = tuple(int(n) for n in (overview.info()["shape"] if shape is None else shape))
    z, y, x = chunk_sizes(grid, whole)
    return Plan(_native.Plan(overview, _texts(settings), _checked(view), size, whole[::-1], rows, (x, y, z)))


def info(volume: Any, **facts: Any) -> dict[str, Any]:
    """Return lattice, values, and the preset that suits them: see `Volume` for the parameters. Reads all samples."""
    return _volume(volume, facts).info()


def presets() -> dict[str, str]:
    """Return the presets of transfer functions, with the data that each is for."""
    return dict(_native.presets())


def colour_maps() -> list[str]:
    """Return the names of the colour maps, for ``transfer="map:NAME"``."""
    return _native.colour_maps()


def adapters() -> list[dict[str, str]]:
    """Return the graphics adapters, best first."""
    return list(json.loads(_native.adapters()))


def from_napari(viewer: Any, *, size: tuple[int, int] | None = None, **options: Any) -> Image:
    """Render the selected or first visible image layer of a napari viewer without a display.

    Takes the camera (angles, centre, zoom), the scale and the translation of the layer, its contrast limits, its colour
    map, and its rendering: mip, minip, average and attenuated_mip are projections of intensity, all others are
    composites. `size` is (width, height), by default the canvas; `options` are those of `render`.
    """
    from ._napari import scene_of

    volume, found, canvas = scene_of(viewer, None if size is None else _pixels(size))
    return render(volume, **({"size": size or canvas} | found | options))


def _volume(data: Any, facts: dict[str, Any]) -> _native.Volume:
    if isinstance(data, Volume):
        if facts:
            raise ValueError(f"{next(iter(facts))}: the volume is a voxsplat.Volume already")
        return data._native
    known = volume_of.__kwdefaults__ or {}
    for name in facts:
        if name not in known:
            raise TypeError(f"{name!r} is no option of View, Settings or Volume")
    return volume_of(data, **facts)


def _whole(name: str, values: Sequence[int], count: int) -> tuple[int, ...]:
    try:
        numbers = tuple(int(value) for value in values)
        is_whole = all(number == value for number, value in zip(numbers, values, strict=True))
    except (TypeError, ValueError):
        numbers, is_whole = (), False
    if len(numbers) != count or not is_whole or not all(0 <= number < 1 << 32 for number in numbers):
        raise ValueError(f"{name}: {values!r}, expected {count} whole numbers of pixels")
    return numbers


def _pixels(size: Any) -> tuple[int, int]:
    width, height = _whole("size", (size, size) if isinstance(size, int) else size, 2)
    return width, height


def _checked(view: View) -> View:
    numbers: dict[str, Any] = {name: _vector(name, getattr(view, name)) for name in ("up", "direction", "target")}
    return replace(view, **numbers)


def _vector(name: str, values: Sequence[float] | None, count: int = 3) -> tuple[float, ...] | None:
    if values is None:
        return None
    vector = tuple(float(value) for value in values)
    if len(vector) != count:
        raise ValueError(f"{name}: {values!r}, expected {count} numbers")
    return vector


def _texts(settings: Settings) -> Settings:
    """The same settings as the texts and numbers of the native module."""
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
        light=_lights(settings.light),
        material=_vector("material", settings.material, 4),
        shadows=None if shadows is None else str(shadows),
        occlusion=None if occlusion is None else "off" if occlusion is False else str(occlusion),
        clip=[] if settings.clip is None else [settings.clip] if isinstance(settings.clip, str) else list(settings.clip),
        level=str(settings.level),
    )


def _transfer(transfer: Any) -> Any:
    """A transfer function as a name or as the text of a file."""
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
    # A pair of angles, or several lights.
    if len(light) == 2 and all(isinstance(number, (int, float)) for number in light):
        return [f"{light[0]},{light[1]}"]
    return [text for one in light for text in _lights(one)]


class _Reported:
    """The callback for progress: the caller's, or a bar."""

    def __init__(self, progress: Progress) -> None:
        self._progress = progress
        self._bar: Any = None
        self._stage = ""

    def __enter__(self) -> Callable[[str, float], object] | None:
        if self._progress is None or self._progress is False:
            return None
        if self._progress is not True:
            return self._progress
        try:
            from tqdm.auto import tqdm
        except ImportError:
            return self._print
        self._bar = tqdm(total=100, leave=False, bar_format="{l_bar}{bar}| {elapsed}<{remaining}")
        return self._show

    def __exit__(self, *_: object) -> None:
        if self._bar is not None:
            self._bar.close()

    def _show(self, stage: str, done: float) -> None:
        if stage != self._stage:
            self._stage = stage
            self._bar.reset()
            self._bar.set_description(stage)
        self._bar.update(100 * done - self._bar.n)

    def _print(self, stage: str, done: float) -> None:
        if stage != self._stage:
            self._stage = stage
            print(f"voxsplat: {stage}")
