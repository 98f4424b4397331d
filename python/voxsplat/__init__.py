"""Pictures of voxel volumes.

    import voxsplat

    image = voxsplat.render(volume, azimuth=30, size=(800, 600))
    image.save("volume.png")

`volume` is an array of NumPy, xarray, Zarr, Dask or another package with DLPack, an image of nibabel, SimpleITK or
pyvista, or the path of a file. `render` makes the choices that the command ``voxsplat render`` makes, so both make the
same picture of a file. `Renderer` keeps a device and its scenes for many pictures.

A picture is premultiplied RGBA, f32, composited linearly: its values are the ones of the transfer function's colours
(display values), neither clamped nor encoded again.

Errors are `ValueError` (shapes, types, settings, volumes that cannot be drawn), `TypeError` (objects that are no volume,
unknown options), `MemoryError`, `OSError` (files) and `DeviceError` (no graphics adapter, or it failed). A
`VolumeWarning` says that the axes of an array are in doubt, or that a mask or a volume of labels is empty.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from ._native import DeviceError, __version__

if TYPE_CHECKING:
    from .bricks import Brick, IncomingLight, Partial, Plan, brick, merge, sweep_light
    from .functions import adapters, colour_maps, from_napari, info, plan, presets, render, slices, view
    from .image import Image
    from .renderer import Renderer, Scene, Volume
    from .settings import Settings, View
    from .warning import VolumeWarning

__all__ = [
    "Brick",
    "DeviceError",
    "Image",
    "IncomingLight",
    "Partial",
    "Plan",
    "Renderer",
    "Scene",
    "Settings",
    "View",
    "Volume",
    "VolumeWarning",
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
    "slices",
    "sweep_light",
    "view",
]

# The documentation of pyclasses lives in the package.
DeviceError.__module__ = "voxsplat"

# The modules of the other names. They are imported when a name is used, because the command needs none of them and
# NumPy takes ten times as long to import as the program to start.
_MODULES = {
    "bricks": ("Brick", "IncomingLight", "Partial", "Plan", "brick", "merge", "sweep_light"),
    "functions": ("adapters", "colour_maps", "from_napari", "info", "plan", "presets", "render", "slices", "view"),
    "image": ("Image",),
    "renderer": ("Renderer", "Scene", "Volume"),
    "settings": ("Settings", "View"),
    "warning": ("VolumeWarning",),
}

if not TYPE_CHECKING:

    def __getattr__(name: str) -> Any:
        """Import a public name when it is used (PEP 562)."""
        for module, names in _MODULES.items():
            if name in names:
                value = getattr(import_module(f".{module}", __name__), name)
                globals()[name] = value
                return value
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")

    def __dir__() -> list[str]:
        """Return the public names, also those that are not imported yet."""
        return sorted({*__all__, *(name for name in globals() if name.startswith("__"))})
