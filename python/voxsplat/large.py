"""Pictures of arrays that no machine needs to hold.

A picture is planned by an overview, every n-th sample along each axis, and by counts of all samples, from which presets
and ranges are chosen. Tasks read the array block by block for both. Then each brick is a task: it carries the plan and a
slice, and returns a partial picture.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from . import _native
from .bricks import Brick, Partial, Plan, brick, merge
from .convert import native_slice, samples_of
from .engines import Engine, Here, Report
from .image import Image
from .settings import SIZE, Settings, View, as_texts, field_names, refuse_unknown, split
from .sources import Source, grouped, samples_in

__all__ = ["Large"]

# The most samples of an overview.
_OVERVIEW = 1 << 24
# Voxels along a brick below which a brick is mostly halo.
_SMALLEST = 16
_FACTS = ("spacing", "origin", "axes", "affine", "space", "units", "modality")


class Large:
    """An array of which an engine draws pictures, with the parameters of `voxsplat.dask.render`."""

    def __init__(
        self,
        engine: Engine,
        array: Any,
        transfer: Any,
        report: Report | None,
        *,
        size: Any = SIZE,
        memory: int | str | None = None,
        bricks: int | None = None,
        missing_chunks: str = "refuse",
        replace_nan: float | None = None,
        adapter: Any = None,
        background: str = "black",
        **options: Any,
    ) -> None:
        self.engine, self.transfer, self.size, self.background = engine, transfer, size, background
        self.memory, self.least = engine.memory(memory), engine.least(bricks)
        self.source = Source(array, {name: options.pop(name) for name in _FACTS if name in options}, missing_chunks)
        known = field_names(View, Settings).union(_FACTS, Large.__init__.__kwdefaults__ or ())
        refuse_unknown(options, known, "render, View, Settings or Volume")
        self.options = options
        facts = self.source.facts
        self.slice_facts = {"replace_nan": replace_nan, "slope": facts["slope"], "intercept": facts["intercept"]}
        self.adapter = adapter
        self.affine = np.vstack([np.array(facts["affine"]), [0.0, 0.0, 0.0, 1.0]])
        self.overview, self.counts, self.step = self._survey(report)

    def _survey(self, report: Report | None) -> tuple[_native.Volume, _native.Counts | None, int]:
        """Return the overview, its step, and the counts of all samples if the transfer function depends on them."""
        source = self.source
        step = 1
        while np.prod([-(-n // step) for n in source.shape], dtype=np.float64) > _OVERVIEW:
            step += 1
        # A copy: `split` takes the fields of settings out.
        (settings,) = split(dict(self.options), Settings)
        is_counted = step > 1 and _native.needs_counts(as_texts(Settings(transfer=self.transfer, **settings)))
        first = [min((step - 1) // 2, n - 1) for n in source.shape]
        overview = np.empty([-(-(n - at) // step) for n, at in zip(source.shape, first, strict=True)], source.dtype)
        engine = Here() if source.is_in_memory else self.engine
        blocks = list(source.blocks())
        parts = [(tuple(one.start for one in block), source.part(block)) for block in blocks]

        def look(done: float) -> None:
            if report is not None:
                report("overview", done)

        pieces, counts = engine.reduced(_surveyed, (first, step, self.slice_facts if is_counted else None), parts, _both, look)
        for at, piece in pieces:
            overview[tuple(slice(start, start + n) for start, n in zip(at, piece.shape, strict=True))] = piece
        if counts is not None and not counts.is_complete:
            counts = engine.reduced(_refined, (counts, self.slice_facts), parts, _sum, look)
        coarse = np.diag([step, step, step, 1.0])
        coarse[:3, 3] = first[::-1]
        rows = tuple(tuple(row) for row in (self.affine @ coarse)[:3].tolist())
        facts = source.facts | {"affine": rows, "replace_nan": self.slice_facts["replace_nan"]}
        return _native.Volume.of_array(samples_of(overview, "zyx"), facts), counts, step

    def picture(self, report: Report | None, **view: Any) -> Image:
        """Draw a picture with other fields of the view."""
        made = self._plan(self.options | view)

        def look(done: float) -> None:
            if report is not None:
                report("bricks", done)

        parts = [(one.number, self.source.part(one.held)) for one in made.bricks]
        shared = (made, self.slice_facts, self.adapter)
        merged: Partial = self.engine.reduced(_drawn, shared, parts, _over, look, draws=True)
        return merge(made, [merged], self.background)

    def _plan(self, options: dict[str, Any]) -> Plan:
        """Cut the volume until every brick fits into memory."""
        from .functions import plan

        source = self.source
        whole: dict[str, Any] = {}
        if self.step > 1:
            # The affine leads to the world already.
            whole = {"shape": source.shape, "affine": self.affine, "space": "world", "counts": self.counts}
        counts = [1, 1, 1]
        while True:
            while int(np.prod(counts)) < self.least and self._split(counts):
                pass
            grid = [grouped(chunks, count) for chunks, count in zip(source.chunks, counts, strict=True)]
            made = plan(self.overview, grid, transfer=self.transfer, size=self.size, **whole, **options)
            if made.casts_shadows:
                raise ValueError("shadows: no task sweeps the light through all bricks: expected 0 (see voxsplat.sweep_light)")
            held = max(made.bricks, key=self._needed)
            needed = self._needed(held) + 3 * 16 * made.size[0] * made.size[1]
            if needed <= self.memory:
                return made
            if not self._split(counts):
                raise MemoryError(
                    f"drawing a brick of {_samples(held)} samples takes {needed / 1e6:.0f} MB, a worker has "
                    f"{self.memory / 1e6:.0f} MB: give workers more memory, or draw fewer pixels"
                )

    def _needed(self, one: Brick) -> float:
        """Return the bytes of a task without partial pictures, two of which are composited into a third."""
        # Dask holds the chunks of a slice while it joins them.
        copies = 2 if self.source.is_dask else 1
        return float(one.bytes + copies * self.source.dtype.itemsize * _samples(one))

    def _split(self, counts: list[int]) -> bool:
        """Cut the longest bricks once more; return False if they are too thin."""
        lengths = [n / count for n, count in zip(self.source.shape, counts, strict=True)]
        axis = int(np.argmax(lengths))
        if lengths[axis] < 2 * _SMALLEST:
            return False
        counts[axis] *= 2
        return True


def _samples(one: Brick) -> int:
    return int(np.prod([held.stop - held.start for held in one.held]))


def _surveyed(shared: Any, start: tuple[int, ...], part: Any) -> tuple[list[Any], _native.Counts | None]:
    """A task: the samples of a block that belong to the overview, with their place there, and the counts of all."""
    first, step, facts = shared
    samples = samples_in(part)
    skipped = [(at - begin) % step for at, begin in zip(first, start, strict=True)]
    place = tuple((begin + skip - at) // step for begin, skip, at in zip(start, skipped, first, strict=True))
    # A copy, so that the block is freed.
    piece = samples[tuple(slice(skip, None, step) for skip in skipped)].copy()
    counts = None if facts is None else _native.Counts.of(native_slice(samples, **facts))
    return [(place, piece)], counts


def _both(surveys: list[Any]) -> tuple[list[Any], _native.Counts | None]:
    pieces = [piece for pieces, _ in surveys for piece in pieces]
    return pieces, None if surveys[0][1] is None else _sum([counts for _, counts in surveys])


def _refined(shared: Any, start: tuple[int, ...], part: Any) -> _native.Counts:
    """A task: the counts of a block in bins of the range of all samples."""
    counts, facts = shared
    refined: _native.Counts = counts.refined(native_slice(samples_in(part), **facts))
    return refined


def _sum(counts: list[_native.Counts]) -> _native.Counts:
    total = counts[0]
    for one in counts[1:]:
        total = total.plus(one)
    return total


def _drawn(shared: Any, number: int, part: Any) -> Partial:
    """A task: draws a brick."""
    made, facts, adapter = shared
    return brick(made, number, samples_in(part), adapter=adapter() if callable(adapter) else adapter, **facts)


def _over(parts: list[Partial]) -> Partial:
    """A task: composites neighbours, front to back."""
    merged = parts[0]
    for part in parts[1:]:
        merged = merged.over(part)
    return merged
