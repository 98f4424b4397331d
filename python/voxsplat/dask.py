"""Pictures of Dask arrays and Zarr stores, drawn in bricks by many machines.

    import voxsplat.dask as vd

    image = vd.render(array, spacing=(2, 0.5, 0.5), light="headlight")
    vd.turntable(array, frames=36, to="frames/{frame}.png")
    vd.film(series, to="times/{frame}.png")

The current client of Dask draws, otherwise a cluster on this machine, which ends with the call; or an executor of
another engine: ``executor=`` takes whatever has `submit`, such as `concurrent.futures.ProcessPoolExecutor` or
`mpi4py.futures.MPIPoolExecutor`.

A picture is planned by an overview, every n-th sample of the array. Then each brick is a task: it carries the plan and
the samples of a slice, and returns a partial picture of a few megabytes. Partial pictures are composited in a tree. Bricks
become smaller until they fit into the memory of a worker. Dask repeats the tasks of a worker that dies.
"""

from __future__ import annotations

import asyncio
import concurrent.futures
import contextlib
import logging
import os
import uuid
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from typing import Any, TypeAlias

import distributed
import numpy as np
from dask.delayed import delayed
from dask.utils import parse_bytes

from . import Image, Partial, Plan, _native, brick, merge, plan
from .bricks import chunk_sizes
from .convert import located, samples_of

__all__ = ["film", "render", "turntable"]

Report: TypeAlias = Callable[[str, float], object]

# The most samples of an overview, and the tasks that read it.
_OVERVIEW = 1 << 24
_PIECES = 32
# Voxels along a brick below which a brick is mostly halo.
_SMALLEST = 16
# Partial pictures that a task composites.
_BRANCHES = 8
# Seconds between looks at the progress.
_TICK = 0.3
_FACTS = ("spacing", "origin", "axes", "affine", "space", "units", "modality")


def render(
    array: Any,
    transfer: Any = None,
    *,
    size: tuple[int, int] = (1024, 1024),
    memory: int | str | None = None,
    bricks: int | None = None,
    executor: Any = None,
    missing_chunks: str = "refuse",
    replace_nan: float | None = None,
    adapter: str | None = None,
    background: str = "black",
    progress: Report | None = None,
    **options: Any,
) -> Image:
    """Render a picture of an array that no machine needs to hold.

    Parameters
    ----------
    array
        A Dask array, a Zarr array, an xarray.DataArray of either, or a NumPy array; three axes.
    transfer, size, adapter, background
        See `voxsplat.render`.
    memory
        The bytes that drawing a brick may take, such as ``"2GB"``; by default the memory of the smallest worker over
        its threads.
    bricks
        The least number of bricks; by default two for each worker.
    executor
        An executor other than Dask: has ``submit(function, *arguments)``, which returns a future.
    missing_chunks
        ``"refuse"`` raises ValueError if a Zarr store lacks chunks; ``"fill"`` draws their fill value.
    replace_nan
        Replaces NaN and infinite samples, which are refused otherwise.
    progress
        A callback of (stage, fraction).
    **options
        Fields of `voxsplat.View` and `voxsplat.Settings`, and spacing, origin, axes, affine, space, units, modality.

    Raises
    ------
    ValueError
        As `voxsplat.plan` and `voxsplat.brick`, and if chunks are missing.
    MemoryError
        The bricks fit into no worker, with the numbers, before anything is drawn; or workers ran out of memory.
    RuntimeError
        Workers die again and again, or the scheduler is gone.
    """
    options |= {"size": size, "memory": memory, "bricks": bricks, "missing_chunks": missing_chunks}
    options |= {"replace_nan": replace_nan, "adapter": adapter, "background": background}
    with _engine(executor) as engine:
        return _picture(engine, array, transfer, progress or _unreported, **options)


def _picture(
    engine: _Engine,
    array: Any,
    transfer: Any,
    report: Report,
    *,
    size: Any = (1024, 1024),
    memory: int | str | None = None,
    bricks: int | None = None,
    missing_chunks: str = "refuse",
    replace_nan: float | None = None,
    adapter: str | None = None,
    background: str = "black",
    **options: Any,
) -> Image:
    """The picture of `render` by an engine."""
    facts = {name: options.pop(name) for name in _FACTS if name in options}
    source = _Source(array, facts, missing_chunks)
    report("overview", 0.0)
    drawn = _Drawn(source, engine, replace_nan)
    report("overview", 1.0)
    made = drawn.plan(transfer, size, engine.memory(memory), engine.least(bricks), options)
    return drawn.picture(made, adapter, background, report)


def _unreported(stage: str, done: float) -> None:
    """Nobody asked for the progress."""


def turntable(
    array: Any,
    transfer: Any = None,
    *,
    frames: int = 36,
    to: str = "{frame}.png",
    size: tuple[int, int] = (1024, 1024),
    azimuth: float = 0.0,
    memory: int | str | None = None,
    bricks: int | None = None,
    executor: Any = None,
    missing_chunks: str = "refuse",
    replace_nan: float | None = None,
    adapter: str | None = None,
    background: str = "black",
    progress: Report | None = None,
    **options: Any,
) -> list[str]:
    """Render `frames` pictures around an array and write each to `to`, with ``{frame}`` in place of its number.

    Returns the paths. The overview is read once. Parameters are those of `render`.
    """
    _check_frames(frames, to)
    facts = {name: options.pop(name) for name in _FACTS if name in options}
    report = progress or _unreported
    paths = []
    with _engine(executor) as engine:
        drawn = _Drawn(_Source(array, facts, missing_chunks), engine, replace_nan)
        for frame in range(frames):
            turned = options | {"azimuth": azimuth + 360.0 * frame / frames}
            made = drawn.plan(transfer, size, engine.memory(memory), engine.least(bricks), turned)
            image = drawn.picture(made, adapter, background, _unreported)
            paths.append(_written(image, to, frame))
            report("frames", (frame + 1) / frames)
    return paths


def film(
    series: Any,
    transfer: Any = None,
    *,
    dim: str = "time",
    to: str = "{frame}.png",
    executor: Any = None,
    progress: Report | None = None,
    **options: Any,
) -> list[str]:
    """Render each time of a series of four axes, the first of them time, or `dim` of an xarray.DataArray.

    Returns the paths. `options` are those of `render`. Each time chooses its own preset, fitted to its values, unless
    `transfer` has values that are the same for all times, such as a file or points.
    """
    is_named = hasattr(series, "dims") and hasattr(series, "isel")
    if is_named and dim not in series.dims:
        raise ValueError(f"dim: {dim!r}, expected one of {tuple(series.dims)}")
    if not is_named and len(series.shape) != 4:
        raise ValueError(f"an array of shape {series.shape}, expected four axes, the first of them time")
    count = series.sizes[dim] if is_named else series.shape[0]
    _check_frames(count, to)
    report = progress or _unreported
    paths = []
    with _engine(executor) as engine:
        for frame in range(count):
            one = series.isel({dim: frame}) if is_named else series[frame]
            paths.append(_written(_picture(engine, one, transfer, _unreported, **options), to, frame))
            report("frames", (frame + 1) / count)
    return paths


def _check_frames(count: int, to: str) -> None:
    if count < 1:
        raise ValueError(f"frames: {count}, expected 1 or more")
    if count > 1 and to.format(frame=0) == to.format(frame=1):
        raise ValueError(f"to: {to!r} is the same for all frames, expected a place for {{frame}}")


def _written(image: Image, to: str, frame: int) -> str:
    path = to.format(frame=frame)
    os.makedirs(os.path.dirname(path) or ".", exist_ok=True)
    image.save(path)
    return path


class _Source:
    """An array of axes (z, y, x) whose slices tasks read, with its place in the world."""

    def __init__(self, data: Any, facts: dict[str, Any], missing_chunks: str) -> None:
        lazy = getattr(data, "data", None) if hasattr(data, "dims") and hasattr(data, "coords") else None
        found, axes, self.facts = located(data, **facts)
        array = found if lazy is None else lazy
        if sorted(axes) != ["x", "y", "z"] or len(array.shape) != 3:
            raise ValueError(f"an array of shape {array.shape} with axes {axes!r}, expected three (z, y, x)")
        if missing_chunks not in ("refuse", "fill"):
            raise ValueError(f"missing_chunks: {missing_chunks!r}, expected refuse or fill")
        self.order = [axes.index(letter) for letter in "zyx"]
        self.is_dask = hasattr(array, "dask") and hasattr(array, "rechunk")
        self.array = array
        self.shape = tuple(int(array.shape[axis]) for axis in self.order)
        chunks = getattr(array, "chunks", None)
        if self.is_dask:
            self.chunks = [list(array.chunks[axis]) for axis in self.order]
        elif chunks is not None and all(isinstance(size, int) for size in chunks):
            ends = [(self.shape[i], chunks[axis]) for i, axis in enumerate(self.order)]
            self.chunks = [[min(size, n - at) for at in range(0, n, size)] for n, size in ends]
            self._check_store(missing_chunks)
        else:
            self.chunks = [[n] for n in self.shape]
        self.itemsize = int(np.dtype(array.dtype).itemsize)

    def _check_store(self, missing_chunks: str) -> None:
        """Refuse a Zarr store with chunks that were never written, or were lost: they would read as the fill value."""
        written, expected = getattr(self.array, "nchunks_initialized", None), getattr(self.array, "nchunks", None)
        if missing_chunks == "refuse" and written is not None and written != expected:
            raise ValueError(
                f"{expected - written} of the {expected} chunks of the store are missing: "
                'missing_chunks="fill" draws their fill value'
            )

    def part(self, held: Sequence[slice]) -> Any:
        """A slice: an array of Dask, or what `read` reads."""
        index = [held[self.order.index(axis)] for axis in range(3)]
        if self.is_dask or isinstance(self.array, np.ndarray):
            return self.array[tuple(index)].transpose(self.order)
        return _Stored(self.array, index, self.order)


class _Stored:
    """A slice of a store, which the task reads that draws it."""

    def __init__(self, array: Any, index: list[slice], order: list[int]) -> None:
        self.array, self.index, self.order = array, index, order

    def read(self) -> np.ndarray[Any, Any]:
        return np.asarray(self.array[tuple(self.index)]).transpose(self.order)


def _samples(part: Any) -> np.ndarray[Any, Any]:
    """A task: reads a slice."""
    return part.read() if isinstance(part, _Stored) else np.asarray(part)


def _plan_of(text: str) -> Plan:
    """A task: the plan of all bricks."""
    return Plan.from_json(text)


def _drawn_brick(made: Plan, number: int, part: Any, options: dict[str, Any], topic: str | None = None) -> Partial:
    """A task: draws a brick, and tells Dask."""
    drawn = brick(made, number, _samples(part), **options)
    if topic is not None:
        distributed.get_worker().log_event(topic, number)
    return drawn


def _over(parts: list[Partial]) -> Partial:
    """A task: composites neighbours, front to back."""
    merged = parts[0]
    for part in parts[1:]:
        merged = merged.over(part)
    return merged


class _Drawn:
    """An array of which pictures are drawn."""

    def __init__(self, source: _Source, engine: _Engine, replace_nan: float | None) -> None:
        self.source, self.engine, self.replace_nan = source, engine, replace_nan
        step = 1
        while np.prod([-(-n // step) for n in source.shape], dtype=np.float64) > _OVERVIEW:
            step += 1
        self.is_whole = step == 1
        starts = [min((step - 1) // 2, n - 1) for n in source.shape]
        planes = range(starts[0], source.shape[0], step)
        pieces = []
        for at in range(0, len(planes), -(-len(planes) // _PIECES)):
            some = planes[at : at + -(-len(planes) // _PIECES)]
            rest = [slice(start, None, step) for start in starts[1:]]
            pieces.append(source.part([slice(some[0], some[-1] + 1, step), *rest]))
        overview = np.concatenate(engine.computed(pieces))
        self.affine = np.vstack([np.array(source.facts["affine"]), [0.0, 0.0, 0.0, 1.0]])
        coarse = np.diag([step, step, step, 1.0])
        coarse[:3, 3] = starts[::-1]
        rows = tuple(tuple(row) for row in (self.affine @ coarse)[:3].tolist())
        facts = source.facts | {"affine": rows, "replace_nan": replace_nan}
        self.overview = _native.Volume.of_array(samples_of(overview, "zyx"), facts)

    def plan(self, transfer: Any, size: Any, memory: float, least: int, options: dict[str, Any]) -> Plan:
        """Cut the volume until every brick fits into memory."""
        shape = self.source.shape
        whole: dict[str, Any] = {} if self.is_whole else {"shape": shape, "affine": self.affine}
        width, height = (size, size) if isinstance(size, int) else size
        counts = [1, 1, 1]
        while True:
            while int(np.prod(counts)) < least and self._split(counts):
                pass
            grid = [_grouped(chunks, count) for chunks, count in zip(self.source.chunks, counts, strict=True)]
            made = plan(self.overview, grid, transfer=transfer, size=size, **whole, **options)
            held = [float(np.prod([s.stop - s.start for s in brick.held])) for brick in made.bricks]
            # Dask holds the chunks of a slice while it joins them. Two partial pictures are composited into a third.
            copies = (2 if self.source.is_dask else 1) * self.source.itemsize
            pictures = 3 * 16 * width * height
            needed = max(brick.bytes + copies * n for brick, n in zip(made.bricks, held, strict=True)) + pictures
            if needed <= memory:
                return made
            if not self._split(counts):
                raise MemoryError(
                    f"drawing a brick of {max(held):.0f} samples takes {needed / 1e6:.0f} MB, a worker has "
                    f"{memory / 1e6:.0f} MB: give workers more memory, or draw fewer pixels"
                )

    def _split(self, counts: list[int]) -> bool:
        """Cut the longest bricks once more; False if they are too thin."""
        lengths = [n / count for n, count in zip(self.source.shape, counts, strict=True)]
        axis = int(np.argmax(lengths))
        if lengths[axis] < 2 * _SMALLEST:
            return False
        counts[axis] *= 2
        return True

    def picture(self, made: Plan, adapter: str | None, background: str, report: Report) -> Image:
        facts = self.source.facts
        options = {"replace_nan": self.replace_nan, "slope": facts["slope"], "intercept": facts["intercept"]}
        merged = self.engine.merged(made, self.source, options | {"adapter": adapter}, report)
        image: Image = merge(made, [merged], background)
        return image


def _grouped(chunks: list[int], count: int) -> list[int]:
    """Sizes of about equal bricks: whole chunks of the store, if there are enough of them, otherwise parts of them."""
    voxels = sum(chunks)
    if count > len(chunks):
        return chunk_sizes((1, 1, count), (1, 1, voxels))[2]
    ends = np.cumsum(chunks)
    # The chunk that ends nearest to each even cut.
    cuts = {int(ends[np.argmin(np.abs(ends - voxels * i / count))]) for i in range(1, count)}
    return [int(size) for size in np.diff([0, *sorted(cuts - {voxels}), voxels])]


class _Engine:
    """What runs tasks."""

    def memory(self, given: int | str | None) -> float:
        """The bytes that a task may take."""
        return float("inf") if given is None else float(parse_bytes(given))

    def least(self, given: int | None) -> int:
        """The least number of bricks."""
        return 2 * self.workers() if given is None else given

    def workers(self) -> int:
        raise NotImplementedError

    def computed(self, parts: list[Any]) -> list[np.ndarray[Any, Any]]:
        """The samples of slices."""
        raise NotImplementedError

    def merged(self, made: Plan, source: _Source, options: dict[str, Any], report: Report) -> Partial:
        """The partial picture of all bricks."""
        raise NotImplementedError


class _Cluster(_Engine):
    """The workers of a client of Dask."""

    def __init__(self, client: Any) -> None:
        self.client = client

    def _infos(self) -> list[dict[str, Any]]:
        # The client's own copy is seconds old.
        infos = list(self.client.scheduler_info(n_workers=-1)["workers"].values())
        if not infos:
            raise RuntimeError("the cluster has no workers: start some, or wait for them with client.wait_for_workers(1)")
        return infos

    def memory(self, given: int | str | None) -> float:
        if given is not None:
            return float(parse_bytes(given))
        # Dask pauses a worker at 0.8 of its limit. Python and its packages take about 150 MB of it.
        infos = self._infos()
        free = [0.8 * info["memory_limit"] - 150e6 if info["memory_limit"] else np.inf for info in infos]
        return float(min(bytes / info["nthreads"] for bytes, info in zip(free, infos, strict=True)))

    def workers(self) -> int:
        return int(sum(info["nthreads"] for info in self._infos()))

    def computed(self, parts: list[Any]) -> list[np.ndarray[Any, Any]]:
        return list(self._result(delayed([delayed(_samples)(part) for part in parts])))

    def merged(self, made: Plan, source: _Source, options: dict[str, Any], report: Report) -> Partial:
        topic = f"voxsplat-{uuid.uuid4().hex}"
        # A task as well, so that it can be repeated, and is sent to each worker once.
        shared = delayed(_plan_of)(made.to_json())
        nodes = [
            delayed(_drawn_brick)(shared, brick.number, source.part(brick.held), options, topic)
            for brick in made.bricks
        ]
        while len(nodes) > 1:
            nodes = [delayed(_over)(nodes[at : at + _BRANCHES]) for at in range(0, len(nodes), _BRANCHES)]

        def look() -> None:
            report("bricks", min(len(self.client.get_events(topic)) / len(made.bricks), 1.0))

        part = self._result(nodes[0], look)
        report("bricks", 1.0)
        return part  # type: ignore[no-any-return]

    def _result(self, node: Any, look: Callable[[], None] = lambda: None) -> Any:
        """Wait for a task. Ctrl-C cancels it, and a scheduler that goes away ends the wait."""
        future = self.client.compute(node, optimize_graph=True)
        try:
            while True:
                if self.client.status not in ("running", "connecting"):
                    raise RuntimeError("the scheduler of Dask is gone: start a cluster again")
                try:
                    return future.result(timeout=_TICK)
                except (TimeoutError, distributed.TimeoutError):
                    if not future.done():
                        with contextlib.suppress(OSError, distributed.TimeoutError):
                            look()
        except distributed.scheduler.KilledWorker as fault:
            raise MemoryError(
                f"workers died again and again while they drew: {fault.task}. They may have run out of memory: "
                "give a smaller memory="
            ) from fault
        except (concurrent.futures.CancelledError, asyncio.CancelledError) as fault:
            raise RuntimeError("the scheduler of Dask is gone: start a cluster again") from fault
        except BaseException:
            with contextlib.suppress(Exception):
                future.cancel()
            raise


class _Executor(_Engine):
    """Whatever has `submit`."""

    def __init__(self, executor: Any) -> None:
        if not callable(getattr(executor, "submit", None)):
            raise ValueError(f"executor: {type(executor).__name__}, expected an object with submit")
        self.executor = executor

    def workers(self) -> int:
        return int(getattr(self.executor, "_max_workers", None) or 1)

    def _results(self, calls: Iterator[tuple[Any, ...]]) -> Iterator[Any]:
        """The results of calls in order. Few of them wait at a time, because each may carry samples."""
        waiting: deque[Any] = deque()
        try:
            for call in calls:
                waiting.append(self.executor.submit(*call))
                if len(waiting) >= 2 * self.workers():
                    yield waiting.popleft().result()
            while waiting:
                yield waiting.popleft().result()
        except concurrent.futures.BrokenExecutor as fault:
            raise RuntimeError(f"a process of the executor died: {fault}") from fault
        finally:
            for future in waiting:
                future.cancel()

    def computed(self, parts: list[Any]) -> list[np.ndarray[Any, Any]]:
        return list(self._results((_samples, _sent(part)) for part in parts))

    def merged(self, made: Plan, source: _Source, options: dict[str, Any], report: Report) -> Partial:
        bricks = made.bricks
        calls = ((_drawn_brick, made, brick.number, _sent(source.part(brick.held)), options) for brick in bricks)
        merged: Partial | None = None
        for done, part in enumerate(self._results(calls), 1):
            merged = part if merged is None else merged.over(part)
            report("bricks", done / len(bricks))
        if merged is None:
            raise ValueError("plan: it has no bricks")
        return merged


def _sent(part: Any) -> Any:
    """A slice as an executor without Dask takes it."""
    return part.compute() if hasattr(part, "dask") else part


@contextlib.contextmanager
def _engine(executor: Any) -> Iterator[_Engine]:
    """The executor, the current client of Dask, or a cluster for this call."""
    if executor is not None:
        yield _Executor(executor)
        return
    try:
        current = distributed.Client.current()  # type: ignore[no-untyped-call]
    except ValueError:
        current = None
    if current is not None:
        yield _Cluster(current)
        return
    count = max(1, min(4, os.cpu_count() or 1))
    threads = {name: "1" for name in ("LP_NUM_THREADS", "RAYON_NUM_THREADS", "OMP_NUM_THREADS")} if count > 1 else {}
    cluster = distributed.LocalCluster(  # type: ignore[no-untyped-call]
        n_workers=count, threads_per_worker=1, dashboard_address=":0", env=threads, silence_logs=logging.ERROR
    )
    client = distributed.Client(cluster, set_as_default=False)  # type: ignore[no-untyped-call]
    with cluster, client:
        yield _Cluster(client)
