"""Volumes, devices, and scenes on them."""

from __future__ import annotations

import math
import os
import threading
from collections.abc import Sequence
from dataclasses import replace
from types import TracebackType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from . import _native
from .convert import volume_of
from .image import Image
from .meshes import depth_of, meshes_of
from .packages import found_in
from .progress import Progress, Reported
from .settings import SIZE, Settings, View, as_texts, checked, field_names, pixels, refuse_unknown, split, whole_numbers
from .warning import warn

__all__ = ["FACTS", "PLANES", "Renderer", "Scene", "Volume", "kept_renderer", "native_volume"]

# The planes of a figure of slices.
PLANES = ("axial", "coronal", "sagittal")

# The names of the facts about a volume.
FACTS = frozenset(volume_of.__kwdefaults__ or {})


class Volume:
    """Samples with a place in the world, for many pictures.

    Parameters
    ----------
    data
        An array of three axes, or an object that has one: ndarray, xarray, Zarr, Dask (computed), DLPack, nibabel,
        SimpleITK, pyvista; or a path, a folder of slices, ``"demo:NAME"``, a url (https, http, s3). Types are bool, every integer type and every
        real type. The samples are copied once, at their width, whatever the order of the axes in memory; float16 and
        foreign byte orders are converted.
    spacing
        World lengths between samples, in the order of the shape.
    origin
        World point (x, y, z) of the first sample.
    axes
        The axes of the array: ``"zyx"`` by default, ``"xyz"`` for arrays that nibabel indexes, such as
        ``image.get_fdata()``. A bare array of NumPy without axes whose first axis is the fastest in memory gives a
        `VolumeWarning`, unless it is a transposed view. Files of NumPy and of bare samples take axes too.
    affine
        4 x 4 numbers, from (x, y, z) indices to `space`, in place of spacing and origin.
    space
        The space that the affine, or spacing and origin, lead to. ``"RAS"``, the default of an affine, such as
        ``image.affine`` of nibabel, or ``"LPS"``: a patient, whose front is shown and whose sides clip. ``"world"``,
        otherwise the default: (x, y, z) of no patient. The world of pictures and of `info` is LPS for patients.
    units
        The unit of lengths, such as ``"mm"``, or ``{"length": .., "value": ..}``. Values in ``"HU"`` are CT.
    modality
        In the terms of DICOM: ``"CT"``, ``"MR"``, ``"PT"``; it decides on the preset.
    replace_nan
        Replaces NaN and infinite samples, of which nothing is drawn otherwise.
    time, channel
        Numbers of the time point and of the channel of a file that has several, from 0.
    series
        The number of the series of a folder of DICOM or of a TIFF, from 1.
    missing_slices
        Of a series of DICOM that lacks slices: ``"refuse"`` (the default) or ``"interpolate"``.
    complex
        The part of complex samples of a file: ``"abs"``, ``"real"``, ``"imag"`` or ``"phase"`` (radians).
    pyramid
        The level of a pyramid, 0 (the finest) and up; by default the level that suits the picture.
    fetch_limit
        The largest number of bytes that are fetched of a url: 1 GiB by default.
    dims, dtype, endian, offset
        Of a file of bare samples: numbers of samples along (x, y, z), their type such as ``"uint16"``, ``"little"``
        (the default) or ``"big"``, and the bytes before the first sample.
    """

    def __init__(self, data: Any, **facts: Any) -> None:
        self._native: _native.Volume = native_volume(data, facts)

    def info(self) -> dict[str, Any]:
        """Return lattice, values, and the preset that suits them. Reads all samples, of a url those of a coarse level."""
        return self._native.info()

    def __repr__(self) -> str:
        return f"<voxsplat.Volume at {id(self):#x}>"


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
        """Choose the adapter by a part of its name or ``"#1"``, its index in `adapters`; None chooses the best one."""
        self._native = _native.Renderer(adapter)

    def prepare(
        self,
        volume: Any,
        transfer: Any = None,
        settings: Settings | None = None,
        view: View | None = None,
        *,
        labels: Any = None,
        mask: Any = None,
        overlays: Any = (),
        size: tuple[int, int] = SIZE,
        progress: Progress = None,
        **changes: Any,
    ) -> Scene:
        """Prepare a volume. Studio light stands around `view` and stays there when the view turns.

        `labels`, `mask` and `overlays` are as of `voxsplat.render`. `changes` are fields of `Settings`, and of `Volume`
        for a volume that is none yet.
        """
        refuse_unknown(changes, field_names(Settings) | FACTS, "Settings or Volume")
        (changed,) = split(changes, Settings)
        settings = replace(settings or Settings(), **changed)
        if transfer is not None:
            settings = replace(settings, transfer=transfer)
        texts, view, size = as_texts(settings), checked(view or View()), pixels(size)
        over, shown = (_beside(one, volume, changes) for one in (labels, mask))
        layers = [_overlay(one, number, volume, changes) for number, one in enumerate(_listed(overlays))]
        source = native_volume(volume, changes)
        with Reported(progress) as report:
            scene = self._native.prepare(source, over, shown, layers, texts, view, size, report)
        for reason in scene.hidden:
            warn(reason)
        return Scene(scene)

    def render(
        self,
        scene: Scene,
        view: View | None = None,
        *,
        size: tuple[int, int] = SIZE,
        region: tuple[int, int, int, int] | None = None,
        background: str = "black",
        meshes: Any = None,
        depth: Any = None,
        planes: str | Sequence[str] = (),
        progress: Progress = None,
        **changes: Any,
    ) -> Image:
        """Render a scene of this renderer: `size` is (width, height), 1 to 32768 pixels.

        Without a view the picture has the view that the scene was prepared with. `changes` are fields of `View`.
        `region` is (x, y, width, height), a part of the picture with the same pixels.

        `meshes` and `planes` are opaque surfaces in the picture, and `depth` is a depth buffer that hides matter behind
        it: see `voxsplat.render`.
        """
        given, part = _part(view, region, changes)
        solids = (meshes_of(meshes), depth_of(depth), listed_planes(planes))
        with Reported(progress) as report:
            image = self._native.render(scene._native, given, pixels(size), part, background, *solids, report)
        return Image(image)

    def slices(
        self,
        scene: Scene,
        *,
        at: Sequence[float] | None = None,
        planes: str | Sequence[str] = PLANES,
        size: tuple[int, int] = SIZE,
        title: str | None = None,
        caption: str | None = None,
        background: str = "black",
        progress: Progress = None,
    ) -> Image:
        """Draw a figure of sections of a scene beside its picture, with the view of `prepare`: see `voxsplat.slices`."""
        point = None if at is None else tuple(float(number) for number in at)
        if point is not None and (len(point) != 3 or not all(map(math.isfinite, point))):
            raise ValueError(f"at: {at!r}, expected three finite numbers (x, y, z)")
        with Reported(progress) as report:
            texts = (background, title, caption)
            image = self._native.slices(scene._native, pixels(size), listed_planes(planes), point, *texts, report)
        return Image(image)

    def depths(
        self,
        scene: Scene,
        view: View | None = None,
        *,
        size: tuple[int, int] = SIZE,
        region: tuple[int, int, int, int] | None = None,
        progress: Progress = None,
        **changes: Any,
    ) -> NDArray[np.float32]:
        """Return the depths at which rays of a picture have lost half of their light: f32 of shape (height, width).

        A depth is a distance along the view in world units, from the eye or, along parallel rays, from the plane
        through the target. It is infinite where more than half of the light is left. Parameters are as of `render`.
        """
        given, part = _part(view, region, changes)
        with Reported(progress) as report:
            return self._native.depths(scene._native, given, pixels(size), part, report)

    def close(self) -> None:
        """Close the device. Scenes and pictures of the renderer stay, but the scenes cannot be rendered."""
        self._native.close()

    def __enter__(self) -> Renderer:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


def listed_planes(planes: str | Sequence[str]) -> list[str]:
    """Return the texts of planes."""
    return [planes] if isinstance(planes, str) else [str(plane) for plane in planes]


def _part(view: View | None, region: tuple[int, int, int, int] | None, changes: dict[str, Any]) -> tuple[Any, Any]:
    """Return the checked view and region of a picture."""
    if changes:
        view = replace(view or View(), **changes)
    return None if view is None else checked(view), None if region is None else whole_numbers("region", region, 4)


_thread = threading.local()


def kept_renderer(adapter: str | None) -> Renderer:
    """Return the renderer that this thread keeps for `render`."""
    kept: tuple[str | None, int, Renderer] | None = getattr(_thread, "renderer", None)
    if kept is not None and kept[:2] == (adapter, os.getpid()):
        return kept[2]
    renderer = Renderer(adapter)
    _thread.renderer = (adapter, os.getpid(), renderer)
    return renderer


def _beside(data: Any, volume: Any, facts: dict[str, Any]) -> _native.Volume | None:
    """Return the volume of labels or a mask. A bare array has the axes of the array of the volume."""
    if data is None or isinstance(data, Volume):
        return None if data is None else data._native
    has_axes = isinstance(volume, (Volume, str, os.PathLike))
    axes = facts.get("axes") or (None if has_axes else found_in(volume).axes)
    is_bare = not isinstance(data, (str, os.PathLike)) and found_in(data).affine is None
    return volume_of(data, axes=axes if is_bare else None, replace_nan=0.0)


def _listed(overlays: Any) -> list[Any]:
    """Return overlays as a list: none, one, or a list of them. A tuple is one overlay with its look."""
    if overlays is None or (isinstance(overlays, tuple) and not overlays):
        return []
    return overlays if isinstance(overlays, list) else [overlays]


def _overlay(
    overlay: Any, number: int, volume: Any, facts: dict[str, Any]
) -> tuple[_native.Volume, str, str | None, str | None]:
    """Return the volume, the name, the look and the range of an overlay."""
    data, look, ends = (*overlay, None, None)[:3] if isinstance(overlay, tuple) else (overlay, None, None)
    beside = _beside(data, volume, facts)
    if beside is None:
        raise ValueError(f"overlays: item {number} is None, expected a volume")
    name = os.fspath(data) if isinstance(data, (str, os.PathLike)) else f"overlay {number}"
    if ends is not None:
        low, high = ("" if end is None else repr(float(end)) for end in ends)
        ends = f"{low}..{high}"
    return beside, name, look, ends


def native_volume(data: Any, facts: dict[str, Any]) -> _native.Volume:
    """Return the native volume of an object, with facts that it does not state: the parameters of `Volume`."""
    refuse_unknown(facts, FACTS, "Volume")
    if isinstance(data, Volume):
        if facts:
            raise ValueError(f"{next(iter(facts))}: the volume is a voxsplat.Volume already")
        return data._native
    return volume_of(data, **facts)
