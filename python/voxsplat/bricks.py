"""Pictures in bricks: for volumes that one machine cannot hold, and for many machines.

    plan = voxsplat.plan(volume, grid=(2, 2, 2), size=(1024, 1024))
    parts = [voxsplat.brick(plan, b, volume[b.held]) for b in plan.bricks]
    image = voxsplat.merge(plan, parts)

A plan knows no engine: any executor may draw the bricks, in any order, on any machine. Plans, light and partial pictures
can be pickled. `voxsplat.dask` does all of it for Dask arrays and Zarr stores, without shadows.

Shadows fall from brick to brick. If the light of a plan casts shadows, it is swept once through the whole volume:

    plan = voxsplat.plan(volume, grid=(2, 2, 2), light="studio")
    light = voxsplat.sweep_light(plan, volume)
    parts = [voxsplat.brick(plan, b, volume[b.held], light=light[b.number]) for b in plan.bricks]
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np

from . import _native
from .convert import native_slice
from .image import Image
from .progress import Reported
from .renderer import kept_renderer

__all__ = ["Brick", "IncomingLight", "Partial", "Plan", "brick", "merge", "sweep_light"]

Slices: TypeAlias = tuple[slice, slice, slice]


@dataclass(frozen=True)
class Brick:
    """A brick of a plan."""

    number: int
    """Its place in the order of the plan, front to back."""
    voxels: Slices
    """The voxels that it owns, along z, y and x."""
    held: Slices
    """The slice of the samples that it needs: its voxels and its halo. ``array[brick.held]`` is that slice."""
    bytes: int
    """The predicted memory of a process that draws it on software Vulkan, without its picture, 16 bytes a pixel."""


class Plan:
    """A plan of a picture: lattice, camera, settings and bricks. It holds no samples. See `voxsplat.plan`."""

    def __init__(self, native: _native.Plan) -> None:
        self._native = native
        self._bricks = [
            Brick(number, _slices(voxels), _slices(held), size)
            for number, (voxels, held, size) in enumerate(native.bricks)
        ]

    @classmethod
    def from_json(cls, text: str) -> Plan:
        """Read a plan from its JSON."""
        return _plan_of(text, [])

    def to_json(self) -> str:
        """Return the plan as JSON."""
        return self._native.to_json()

    @property
    def bricks(self) -> list[Brick]:
        """The bricks, front to back."""
        return self._bricks

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of the picture, pixels."""
        return self._native.size

    @property
    def choices(self) -> list[str]:
        """The choices that were left open, with their reasons."""
        return self._native.choices

    @property
    def casts_shadows(self) -> bool:
        """Whether bricks need the light that enters them: see `voxsplat.sweep_light`."""
        return self._native.casts_shadows

    def __reduce__(self) -> tuple[Callable[[str, list[str]], Plan], tuple[str, list[str]]]:
        return _plan_of, (self.to_json(), self.choices)

    def __repr__(self) -> str:
        width, height = self.size
        return f"<voxsplat.Plan of {width} x {height} pixels in {len(self._bricks)} bricks>"


class Partial:
    """A partial picture: the part of each pixel that the matter of consecutive bricks makes. See `voxsplat.brick`."""

    def __init__(self, native: _native.Partial) -> None:
        self._native = native

    @classmethod
    def from_bytes(cls, data: bytes) -> Partial:
        """Read a partial picture from the bytes of its OpenEXR file."""
        return cls(_native.Partial.from_bytes(data))

    def to_bytes(self) -> bytes:
        """Return the bytes of an OpenEXR file, as the command ``voxsplat brick`` writes it."""
        return self._native.to_bytes()

    @property
    def bricks(self) -> range:
        """The numbers of the bricks of the partial picture in the order of the plan."""
        return range(*self._native.bricks)

    def over(self, back: Partial) -> Partial:
        """Composite over the partial picture directly behind. Associative: any tree over the ordered bricks will do."""
        return Partial(self._native.over(back._native))

    def __reduce__(self) -> tuple[Callable[[bytes], Partial], tuple[bytes]]:
        return Partial.from_bytes, (self.to_bytes(),)

    def __repr__(self) -> str:
        numbers = self.bricks
        return f"<voxsplat.Partial of bricks {numbers.start} to {numbers.stop - 1}>"


class IncomingLight:
    """The light that enters a brick, under shadows of other bricks. See `voxsplat.sweep_light`."""

    def __init__(self, native: _native.IncomingLight) -> None:
        self._native = native

    @classmethod
    def from_bytes(cls, data: bytes) -> IncomingLight:
        """Read the light from the bytes of its OpenEXR file."""
        return cls(_native.IncomingLight.from_bytes(data))

    def to_bytes(self) -> bytes:
        """Return the bytes of an OpenEXR file, as the command ``voxsplat plan`` writes it."""
        return self._native.to_bytes()

    @property
    def brick(self) -> int:
        """The number of the brick in the order of the plan."""
        return self._native.brick

    def __reduce__(self) -> tuple[Callable[[bytes], IncomingLight], tuple[bytes]]:
        return IncomingLight.from_bytes, (self.to_bytes(),)

    def __repr__(self) -> str:
        return f"<voxsplat.IncomingLight of brick {self.brick}>"


def sweep_light(
    plan: Plan,
    samples: Any,
    *,
    replace_nan: float | None = None,
    slope: float = 1.0,
    intercept: float = 0.0,
    progress: Any = None,
) -> list[IncomingLight]:
    """Sweep the light of a plan once through the whole volume: the light that enters each brick, in the plan's order.

    `samples` are those of the volume, axes (z, y, x): ``samples[slices]`` is read for one slab of planes after another,
    of 16 million voxels or about as many as the largest brick has. Returns an empty list if no light casts shadows. `replace_nan`,
    `slope` and `intercept` are those of the volume.
    """

    def sliced(voxels: Sequence[tuple[int, int]]) -> _native.Volume:
        return native_slice(samples[_slices(voxels)], slope=slope, intercept=intercept, replace_nan=replace_nan)

    with Reported(progress) as report:
        swept = kept_renderer(None)._native.sweep_light(plan._native, sliced, report)
        return [IncomingLight(light) for light in swept]


def brick(
    plan: Plan,
    which: Brick | int,
    samples: Any,
    *,
    light: IncomingLight | None = None,
    replace_nan: float | None = None,
    slope: float = 1.0,
    intercept: float = 0.0,
    adapter: str | None = None,
    progress: Any = None,
) -> Partial:
    """Draw a brick of a plan, given the samples of its slice: ``array[brick.held]``, axes (z, y, x).

    `light` is the light that enters the brick, by `sweep_light`, if the plan casts shadows. `replace_nan`, `slope` and
    `intercept` are those of the volume. Raises ValueError if the slice has another shape or the light is missing.
    """
    number = which.number if isinstance(which, Brick) else int(which)
    volume = native_slice(samples, slope=slope, intercept=intercept, replace_nan=replace_nan)
    with Reported(progress) as report:
        incoming = light._native if light is not None else None
        return Partial(kept_renderer(adapter)._native.brick(plan._native, number, volume, incoming, report))


def merge(plan: Plan, parts: Iterable[Partial], background: str = "black") -> Image:
    """Merge the partial pictures of all bricks, in any order, into the picture of the plan: a `voxsplat.Image`.

    Raises ValueError if a brick is missing or there twice, or a part belongs to another plan.
    """
    return Image(plan._native.merge([part._native for part in parts], background))


def chunk_sizes(grid: Any, shape: Sequence[int]) -> list[list[int]]:
    """Return the sizes of chunks along z, y and x: `grid` has numbers of chunks, or sequences of sizes."""
    if len(grid) != 3:
        raise ValueError(f"grid: {grid!r}, expected three numbers of chunks or three sequences of sizes (z, y, x)")
    counts = [int(chunks) if isinstance(chunks, (int, np.integer)) else None for chunks in grid]
    even = _native.even_chunks(tuple(shape)[::-1], tuple(1 if count is None else count for count in counts)[::-1])[::-1]
    return [
        [int(size) for size in chunks] if count is None else sizes
        for chunks, count, sizes in zip(grid, counts, even, strict=True)
    ]


def _plan_of(text: str, choices: list[str]) -> Plan:
    return Plan(_native.Plan.from_json(text, choices))


def _slices(ranges: Sequence[tuple[int, int]]) -> Slices:
    z, y, x = (slice(start, end) for start, end in ranges)
    return z, y, x
