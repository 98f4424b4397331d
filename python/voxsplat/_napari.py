"""The picture of a napari viewer: its camera, and the look of a layer."""

from __future__ import annotations

from typing import Any

import numpy as np

from . import _native
from .convert import volume_of

# The canvas for which napari fits a view while it has no window, width and height.
_CANVAS = (800, 600)
# The largest opacity of a voxel of a translucent layer.
_OPACITY = 0.3
# Points of the colour map.
_STEPS = 64
# How a maximum is dimmed at the far end: exp(-1). The shader of napari has no such bound.
_ATTENUATION = 1.0


def scene_of(viewer: Any, size: tuple[int, int] | None) -> tuple[_native.Volume, dict[str, Any], tuple[int, int]]:
    """Return the volume of a viewer's layer, the options of its picture, and the size of its canvas."""
    layer = _layer(viewer)
    shown = tuple(int(axis) for axis in viewer.dims.displayed)
    if len(shown) != 3:
        raise ValueError("the viewer shows 2 dimensions: set viewer.dims.ndisplay = 3")
    camera = viewer.camera
    # Axes of napari's world in their order are x, y and z: it is right-handed like this, unless the camera mirrors it.
    mirror = np.diag([-1.0 if str(getattr(camera, "handedness", "right")).lower().endswith("left") else 1.0, 1.0, 1.0])
    canvas = _canvas(viewer)
    width, height = size or canvas
    side = min(width, height) / min(canvas)
    options: dict[str, Any] = {
        "direction": tuple(mirror @ np.array(camera.view_direction, dtype=float)),
        "up": tuple(mirror @ np.array(camera.up_direction, dtype=float)),
        "target": tuple(mirror @ np.array(camera.center, dtype=float)[-3:]),
        "view_height": height / side / float(camera.zoom),
    }
    if camera.perspective > 0:
        options |= {"projection": "perspective", "fov": float(camera.perspective)}
    array, affine = _samples(viewer, layer, shown)
    affine[:3] = mirror @ affine[:3]
    return volume_of(array, axes="zyx", affine=affine, space="world", replace_nan=None), options | _look(layer), canvas


def _layer(viewer: Any) -> Any:
    images = [layer for layer in viewer.layers if type(layer).__name__ in ("Image", "Labels") and layer.visible]
    active = viewer.layers.selection.active
    if active in images:
        return active
    if not images:
        raise ValueError("the viewer has no visible layer of images or labels")
    return images[0]


def _canvas(viewer: Any) -> tuple[int, int]:
    """Return the width and the height of the canvas of a viewer; the default size without a window."""
    window = getattr(viewer, "window", None)
    canvas = getattr(getattr(window, "_qt_viewer", None), "canvas", None)
    if canvas is None:
        return _CANVAS
    height, width = canvas.size
    return int(width), int(height)


def _samples(viewer: Any, layer: Any, shown: tuple[int, ...]) -> tuple[Any, np.ndarray[Any, Any]]:
    """Return the displayed samples (z, y, x), and the map from their indices (x, y, z) to the world of the viewer."""
    if getattr(layer, "rgb", False):
        raise ValueError(f"layer {layer.name!r} is RGB: show one channel of it")
    data = layer.data[0] if getattr(layer, "multiscale", False) else layer.data
    missing = viewer.dims.ndim - data.ndim
    if missing > 0 and any(axis < missing for axis in shown):
        raise ValueError(f"layer {layer.name!r} has {data.ndim} dimensions, and the viewer shows another one")
    kept = [axis - missing for axis in shown]
    point = np.array(layer.world_to_data(np.array(viewer.dims.point, dtype=float)[missing:]))
    places = np.clip(np.round(point), 0, np.array(data.shape) - 1).astype(int)
    array = data[tuple(slice(None) if axis in kept else int(places[axis]) for axis in range(data.ndim))]
    # Axes of the array are ascending, displayed axes may be in another order.
    order = [sorted(kept).index(axis) for axis in kept]

    def world(index: np.ndarray[Any, Any]) -> np.ndarray[Any, Any]:
        return np.asarray(layer.data_to_world(index), dtype=float)[kept]

    first = np.where(np.isin(np.arange(data.ndim), kept), 0.0, places)
    affine = np.eye(4)
    affine[:3, 3] = world(first)
    for column, axis in enumerate(reversed(kept)):
        step = first.copy()
        step[axis] = 1.0
        affine[:3, column] = world(step) - affine[:3, 3]
    return np.asarray(array).transpose(order), affine


def _look(layer: Any) -> dict[str, Any]:
    """Return the transfer function and the model of a layer."""
    if type(layer).__name__ == "Labels":
        return {"transfer": "labels"}
    low, high = (float(limit) for limit in layer.contrast_limits)
    places = np.linspace(0.0, 1.0, _STEPS)
    colors = np.asarray(layer.colormap.map(places ** float(layer.gamma)))
    rendering = str(layer.rendering)
    models = {"mip": "mip", "attenuated_mip": "mip", "minip": "minip", "average": "average"}
    model = models.get(rendering, "composite")
    options: dict[str, Any] = {"model": model, "light": False}
    if rendering == "iso":
        threshold = float(layer.iso_threshold)
        color = colors[np.abs(places - (threshold - low) / (high - low)).argmin(), :3]
        channels = np.clip(np.round(255 * color), 0, 255).astype(int)
        return options | {"iso": [(threshold, "#{:02x}{:02x}{:02x}".format(*channels))], "light": "headlight"}
    if model == "composite":
        opacities = _OPACITY * float(layer.opacity) * places
    else:
        # Colours alone show the values; below the limits nothing is shown.
        opacities = np.where(places > 0, 1.0, 0.0) if model != "minip" else np.ones(_STEPS)
    if rendering == "attenuated_mip":
        options["attenuation"] = _ATTENUATION
    values = low + places * (high - low)
    points = zip(values.tolist(), colors[:, :3].tolist(), opacities.tolist(), strict=True)
    return options | {"transfer": [(value, [min(max(c, 0.0), 1.0) for c in color], a) for value, color, a in points]}
