"""Functions of the package: pictures of volumes, plans of pictures in bricks, and lists of what may be chosen."""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from . import _native
from .bricks import Plan, chunk_sizes
from .convert import in_world, matrix_of
from .image import Image
from .progress import Progress, Reported
from .renderer import FACTS, PLANES, Renderer, Scene, Volume, kept_renderer, native_volume
from .settings import (
    SIZE,
    Settings,
    View,
    as_texts,
    check,
    checked,
    documented,
    field_names,
    pixels,
    refuse_unknown,
    single,
    split,
)

if TYPE_CHECKING:
    from .notebook import Viewer


@documented(View, Settings, Volume)
def render(
    volume: Any,
    transfer: Any = None,
    *,
    size: tuple[int, int] = SIZE,
    azimuth: float | None = None,
    elevation: float | None = None,
    light: str | bool | Sequence[Any] | None = None,
    shading: str = "pre",
    model: str = "composite",
    kernel: str | None = None,
    sharpness: float | None = None,
    spacing: Sequence[float] | None = None,
    labels: Any = None,
    mask: Any = None,
    overlays: Any = (),
    meshes: Any = None,
    depth: Any = None,
    planes: str | Sequence[str] = (),
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
        A preset (see `presets`), a file of a transfer function, ``"map:NAME"``, ``"labels"``, or points: a sequence of
        (value, colour, opacity), or a dictionary. By default the preset that suits the volume, with surfaces in studio
        light at sharpness 0.5.
    size
        (width, height), 1 to 32768 pixels.
    spacing
        World lengths between samples, in the order of the shape.
    labels
        Labels to draw too: an array of integers of the volume's shape and axes, or an image or a file, of which each
        voxel gets the nearest label. Label 0 is clear. `Settings.label` and `Settings.label_table` have their looks.
    mask
        Shows the volume only where an array of the volume's shape, an image or a file is not 0. With an empty mask the
        picture is empty, and there is a `VolumeWarning`.
    overlays
        A volume to draw over the volume, or a list of them, each in its own lattice and place: an array, an image or a
        file, or a tuple (volume, look) or (volume, look, (low, high)). A look is ``"two-sided"``, ``"hot"``, a colour,
        ``"labels"`` or a transfer function by name; None chooses what suits the values. Without `transfer` the volume
        becomes grey and translucent.
    meshes
        Opaque surfaces in the picture, which hide the matter behind them: a mesh or several, each maybe with a colour,
        ``mesh`` or ``(mesh, "gold")``. A mesh is a path (PLY, STL, OBJ, VTP), a mesh of pyvista or trimesh, or two
        arrays (vertices, triangles), in the world of the volume: (x, y, z), for patients LPS.
    depth
        A depth buffer of the surfaces of another program, (height, width): matter behind it is hidden. A depth is a
        distance along the view, from the eye or, along parallel rays, from the plane through the target; NaN and
        infinity are no surface. `Renderer.depths` is its counterpart.
    planes
        Planes with the section of the volume on them, clear where it is black: ``"axial"``, ``"coronal"`` or
        ``"sagittal"`` (or ``"xy"``, ``"xz"``, ``"yz"``), each maybe with a place along its axis such as
        ``"axial:12.5"``; or a normal and a place as of ``clip``, ``"NX,NY,NZ,D"``. One or a list.
    background
        Behind PNGs of the picture: ``"#rrggbb"``, a name of CSS or ``"transparent"``. The array has none.
    region
        (x, y, width, height) of a part of the picture, whose pixels are the ones of the whole picture.
    adapter
        A part of the name of the graphics adapter, or ``"#1"``, its index in `adapters`.
    executor
        Draws the picture in bricks, by an object with ``submit`` or ``map`` such as
        `concurrent.futures.ProcessPoolExecutor`: see `voxsplat.dask.render`, whose parameters are options then.
    progress
        A callback of (stage, fraction), or True for a bar.
    **options
        Further fields of `View`, `Settings` and `Volume`.

    Raises
    ------
    ValueError
        Shapes, types, settings out of range, and volumes that cannot be drawn, such as NaN alone.
    TypeError
        Objects that are no volume, and unknown options.
    MemoryError, OSError, DeviceError
        No memory on the host or the device; a file that cannot be read; no adapter, with what to install.
    """
    options |= {"azimuth": azimuth, "elevation": elevation, "light": light, "shading": shading, "model": model}
    options = single(options | {"kernel": kernel, "sharpness": sharpness})
    if spacing is not None:
        options["spacing"] = spacing
    if executor is not None:
        if region is not None:
            raise ValueError("region: a picture in bricks is drawn whole")
        refused = [("labels", labels), ("mask", mask), ("overlays", overlays)]
        refused += [("meshes", meshes), ("depth", depth), ("planes", planes)]
        for name, given in refused:
            if given is not None and not (isinstance(given, (list, tuple)) and not given):
                raise ValueError(f"{name}: it is refused in bricks")
        from .engines import Executor
        from .large import Large

        options |= {"size": pixels(size), "adapter": adapter, "background": background}
        with Reported(progress) as report:
            return Large(Executor(executor), volume, transfer, report, **options).picture(report)
    beside = {"labels": labels, "mask": mask, "overlays": overlays, "size": size, "progress": progress}
    renderer, scene = _prepared(render, volume, transfer, adapter, beside, options)
    return renderer.render(
        scene,
        size=size,
        background=background,
        region=region,
        meshes=meshes,
        depth=depth,
        planes=planes,
        progress=progress,
    )


def _prepared(
    function: Any, volume: Any, transfer: Any, adapter: str | None, beside: dict[str, Any], options: dict[str, Any]
) -> tuple[Renderer, Scene]:
    """Return a renderer and a scene for the keywords and further options of a function."""
    known = field_names(View, Settings) | FACTS | (function.__kwdefaults__ or {}).keys()
    refuse_unknown(options, known, f"{function.__name__}, View, Settings or Volume")
    parts = split(options, View, Settings)
    view, settings = View(**parts[0]), Settings(transfer=transfer, **parts[1])
    # Before a long conversion.
    check(view, settings, pixels(beside["size"]))
    renderer = kept_renderer(adapter)
    return renderer, renderer.prepare(volume, settings=settings, view=view, **beside, **options)


@documented(View, Settings, Volume)
def slices(
    volume: Any,
    transfer: Any = None,
    *,
    at: Sequence[float] | None = None,
    planes: str | Sequence[str] = PLANES,
    size: tuple[int, int] = SIZE,
    title: str | None = None,
    caption: str | None = None,
    labels: Any = None,
    mask: Any = None,
    overlays: Any = (),
    background: str = "black",
    adapter: str | None = None,
    progress: Progress = None,
    **options: Any,
) -> Image:
    """Draw a figure of sections of a volume beside its picture.

    Sections show values in grey over `window`, or over the foreground, tinted where the transfer function shows
    matter; colour maps keep their colours. `clip` and `mask` cut the picture alone. All sections have one scale, a
    scale bar, and the letters of the patient. An axial section is seen from the feet, a coronal one from the front and
    a sagittal one from the left.

    Parameters
    ----------
    volume, transfer, labels, mask, overlays
        As for `render`.
    at
        World point (x, y, z), for patients LPS, through which the planes go; the middle of the volume by default.
    planes
        Planes of the sections, as for `render`, one panel each.
    size
        (width, height) of the whole figure, pixels: panels have sides of 128 or more.
    title, caption
        Texts above and below the figure.
    background, adapter, progress
        As for `render`.
    **options
        Further fields of `View`, `Settings` and `Volume`, for the picture beside the sections.

    Raises
    ------
    ValueError
        As `render`, and planes that miss the volume, and panels that are too small.
    """
    beside = {"labels": labels, "mask": mask, "overlays": overlays, "size": size, "progress": progress}
    renderer, scene = _prepared(slices, volume, transfer, adapter, beside, single(options))
    return renderer.slices(
        scene,
        at=at,
        planes=planes,
        size=size,
        title=title,
        caption=caption,
        background=background,
        progress=progress,
    )


@documented(View, Settings, Volume)
def plan(
    volume: Any,
    grid: Sequence[Any],
    *,
    transfer: Any = None,
    size: tuple[int, int] = SIZE,
    shape: Sequence[int] | None = None,
    affine: Any = None,
    counts: _native.Counts | None = None,
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
    transfer
        A preset, a file, ``"map:NAME"``, ``"labels"`` or points: see `render`.
    size
        (width, height), 1 to 32768 pixels.
    shape, affine
        Of the volume itself, if `volume` is an overview: its shape (z, y, x), and 4 x 4 numbers from its (x, y, z)
        indices to `space`, by default the one of the overview: RAS if it is oriented, otherwise the world.
    counts
        Of all samples, if `volume` is an overview: presets and ranges are chosen by them, instead of by its samples.
    **options
        Further fields of `View`, `Settings` and, of the overview, `Volume`. A ray is drawn for each pixel. Light that
        is not given has no shadows, and given ones need `sweep_light`. Labels and channels are refused, and on a device
        shadows and occlusion.

    Raises
    ------
    ValueError
        Settings out of range, and pictures that cannot be drawn in bricks.
    """
    if shape is not None and (affine is None or len(shape) != 3):
        raise ValueError("shape: expected three numbers (z, y, x), with an affine of the volume")
    known = field_names(View, Settings) | FACTS | (plan.__kwdefaults__ or {}).keys()
    refuse_unknown(options, known, "plan, View, Settings or Volume")
    if shape is None:
        if affine is not None:
            options["affine"] = affine
    else:
        affine = matrix_of(affine)
        space = options.get("space")
        if isinstance(volume, Volume):
            options.pop("space", None)
        clip = options.get("clip") or []
        if any(str(one).startswith("voxels:") for one in ([clip] if isinstance(clip, str) else clip)):
            raise ValueError("clip: voxels of an overview are not those of the volume, give a box: box:X0,X1,Y0,Y1,Z0,Z1")
    parts = split(options, View, Settings)
    view, settings = View(**parts[0]), Settings(transfer=transfer, **parts[1])
    size = pixels(size)
    check(view, settings, size)
    overview = native_volume(volume, options)
    rows = None
    if shape is not None:
        space = space or ("RAS" if overview.info()["oriented"] else "world")
        rows = tuple(tuple(row) for row in in_world(affine, space)[:3].tolist())
    whole = tuple(int(n) for n in (overview.info()["shape"] if shape is None else shape))
    z, y, x = chunk_sizes(grid, whole)
    texts = as_texts(settings)
    return Plan(_native.Plan(overview, texts, checked(view), size, whole[::-1], rows, counts, (x, y, z)))


@documented(Volume)
def info(volume: Any, **options: Any) -> dict[str, Any]:
    """Return lattice, values, and the preset that suits them. Reads all samples.

    Parameters
    ----------
    volume
        An array of axes (z, y, x), an image of another package, or a path: see `Volume`.
    **options
        Facts of the volume.

    Returns
    -------
    dict
        ``shape`` and ``spacing`` in the order (z, y, x), ``affine`` from (x, y, z) indices to the world, ``length_unit``
        and ``value_unit``, ``oriented`` (whether sides of a patient are known), ``sample_type``, ``min``, ``max``,
        ``mean`` and ``std`` of the samples, the numbers of ``channels``, ``times`` and ``levels`` of the file, and
        ``transfer``, ``"labels"`` or the preset that suits the values (None of a built-in volume, and if none fits), with
        its ``reason`` and ``is_guess``.

    Raises
    ------
    ValueError, TypeError, OSError
        No volume, or a file that cannot be read.
    """
    return native_volume(volume, options).info()


def presets() -> dict[str, str]:
    """Return the presets of transfer functions, with the data that each is for."""
    return dict(_native.presets())


def colour_maps() -> list[str]:
    """Return the names of the colour maps, for ``transfer="map:NAME"``."""
    return _native.colour_maps()


def adapters() -> list[dict[str, str]]:
    """Return the graphics adapters, best first. ``adapter="#1"`` chooses the second."""
    return list(json.loads(_native.adapters()))


def from_napari(viewer: Any, *, size: tuple[int, int] | None = None, **options: Any) -> Image:
    """Render the selected or first visible image layer of a napari viewer without a display.

    Takes the camera (angles, centre, zoom), the scale and the translation of the layer, its contrast limits, its colour
    map, and its rendering: mip, minip, average and attenuated_mip are projections of intensity, all others are
    composites. `size` is (width, height), by default the canvas; `options` are those of `render`.
    """
    from ._napari import scene_of

    volume, found, canvas = scene_of(viewer, None if size is None else pixels(size))
    return render(volume, **({"size": size or canvas} | found | options))


@documented(View, Settings, Volume)
def view(volume: Any, transfer: Any = None, *, size: tuple[int, int] = (512, 512), **options: Any) -> Viewer:
    """Show a volume in a notebook: a widget in which it turns when it is dragged. Needs ``voxsplat[notebook]``.

    The wheel zooms, arrow keys turn, and a double click resets. Below the picture are sliders for level, width and time
    point, and the transfer functions. The processor draws: small pictures while the view moves, and full ones when it
    rests. Without a front end, as in exported notebooks, the widget is a PNG.

    Parameters
    ----------
    volume
        See `Volume`. Paths of files with time points have a slider for them.
    transfer
        See `render`.
    size
        (width, height) of the picture, pixels.
    labels, mask, overlays, meshes, background
        See `render`.
    adapter
        A graphics adapter that draws instead of the processor: see `render`.
    **options
        Further fields of `View`, `Settings` and `Volume`, but not `direction`. Volumes keep their size while they turn:
        the default of `frame` is ``"visible"``. Studio light stands around the first view.

    Returns
    -------
    Viewer
        A widget. ``azimuth``, ``elevation``, ``zoom``, ``transfer``, ``window`` and ``time`` can be read and set,
        ``image()`` is the full picture, and ``options()`` are its options for `render`.

    Raises
    ------
    ImportError
        anywidget is missing.
    ValueError, TypeError, OSError
        As `render`.
    """
    from .notebook import Viewer

    return Viewer(volume, transfer, size, options)
