"""Pictures of Dask arrays and Zarr stores, drawn in bricks by many machines.

    import voxsplat.dask as vd

    image = vd.render(array, spacing=(2, 0.5, 0.5), light="headlight")
    vd.turntable(array, frames=36, to="frames/{frame}.png")
    vd.film(series, to="times/{frame}.png")

The current client of Dask draws, otherwise a cluster on this machine, which ends with the call; or an executor of
another engine: ``executor=`` takes whatever has `submit` or `map`, such as `concurrent.futures.ProcessPoolExecutor`,
`mpi4py.futures.MPIPoolExecutor` or `multiprocessing.Pool`.

A picture is planned by an overview, every n-th sample of the array, and by counts of all samples, which choose the preset
and its range as `voxsplat.render` does. Then each brick is a task: it carries the plan and the samples of a slice, and
returns a partial picture of a few megabytes. Partial pictures are composited in a tree. Bricks become smaller until they
fit into the memory of a worker. Dask repeats the tasks of a worker that dies.
"""

from __future__ import annotations

import asyncio
import concurrent.futures
import contextlib
import logging
import os
import uuid
from collections.abc import Callable, Iterator, Mapping
from typing import Any

import numpy as np

try:
    import distributed
    from dask.base import annotate
    from dask.delayed import delayed
except ImportError as fault:
    raise ImportError("voxsplat.dask needs Dask and distributed: pip install 'voxsplat[dask]'") from fault

from .engines import Engine, Executor, Join, Report, Task, byte_count
from .image import Image
from .large import Large
from .progress import Progress, Reported
from .settings import single

__all__ = ["film", "render", "turntable"]

# Partial pictures that a task composites.
_BRANCHES = 8
# Seconds between looks at the progress.
_TICK = 0.3


def render(
    array: Any,
    transfer: Any = None,
    *,
    size: tuple[int, int] = (1024, 1024),
    memory: int | str | None = None,
    bricks: int | None = None,
    executor: Any = None,
    resources: Mapping[str, float] | None = None,
    missing_chunks: str = "refuse",
    replace_nan: float | None = None,
    adapter: str | Callable[[], str] | None = None,
    background: str = "black",
    progress: Progress = None,
    **options: Any,
) -> Image:
    """Render a picture of an array that no machine needs to hold.

    Parameters
    ----------
    array
        A Dask array, a Zarr array, an xarray.DataArray of either, or a NumPy array; three axes.
    transfer, size, adapter, background
        See `voxsplat.render`. An adapter may be a function: each task calls it where it draws, such as
        ``lambda: f"#{distributed.get_worker().name}"`` for a GPU for each worker of a `LocalCluster`.
    memory
        The bytes that drawing a brick may take, such as ``"2GB"``; by default the memory of the smallest worker over
        its threads.
    bricks
        The least number of bricks; by default two for each worker.
    executor
        An executor: has ``submit(function, *arguments)``, which returns a future, or ``map(function, values)``.
    resources
        Resources of Dask's workers that drawing a brick takes, such as ``{"GPU": 1}``.
    missing_chunks
        ``"refuse"`` raises ValueError if a Zarr store lacks chunks; ``"fill"`` draws their fill value.
    replace_nan
        Replaces NaN and infinite samples, which are refused otherwise.
    progress
        A callback of (stage, fraction), or True for a bar.
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
    options = single(options | {"replace_nan": replace_nan, "adapter": adapter, "background": background})
    with _engine(executor, resources) as engine, Reported(progress) as report:
        return Large(engine, array, transfer, report, **options).picture(report)


def turntable(
    array: Any,
    transfer: Any = None,
    *,
    frames: int = 36,
    to: str = "{frame}.png",
    azimuth: float = 0.0,
    executor: Any = None,
    resources: Mapping[str, float] | None = None,
    progress: Progress = None,
    **options: Any,
) -> list[str]:
    """Render `frames` pictures around an array and write each to `to`, with ``{frame}`` in place of its number.

    Returns the paths. The overview is read once. `options` are those of `render`.
    """
    _check_frames(frames, to)
    paths = []
    with _engine(executor, resources) as engine, Reported(progress) as report:
        large = Large(engine, array, transfer, None, **options)
        for frame in range(frames):
            image = large.picture(None, azimuth=azimuth + 360.0 * frame / frames)
            paths.append(_written(image, to, frame, frames, report))
    return paths


def film(
    series: Any,
    transfer: Any = None,
    *,
    dim: str = "time",
    to: str = "{frame}.png",
    executor: Any = None,
    resources: Mapping[str, float] | None = None,
    progress: Progress = None,
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
    paths = []
    with _engine(executor, resources) as engine, Reported(progress) as report:
        for frame in range(count):
            one = series.isel({dim: frame}) if is_named else series[frame]
            image = Large(engine, one, transfer, None, **options).picture(None)
            paths.append(_written(image, to, frame, count, report))
    return paths


def _check_frames(count: int, to: str) -> None:
    if count < 1:
        raise ValueError(f"frames: {count}, expected 1 or more")
    if count > 1 and to.format(frame=0) == to.format(frame=1):
        raise ValueError(f"to: {to!r} is the same for all frames, expected a place for {{frame}}")


def _written(image: Image, to: str, frame: int, count: int, report: Report | None) -> str:
    path = to.format(frame=frame)
    os.makedirs(os.path.dirname(path) or ".", exist_ok=True)
    image.save(path)
    if report is not None:
        report("frames", (frame + 1) / count)
    return path


def _same(shared: Any) -> Any:
    """A task: returns the object that all other tasks share."""
    return shared


def _told(topic: str, task: Task, shared: Any, key: Any, part: Any) -> Any:
    """A task of an engine, which tells Dask that it is done."""
    result = task(shared, key, part)
    distributed.get_worker().log_event(topic, 1)
    return result


class _Cluster(Engine):
    """The workers of a client of Dask."""

    def __init__(self, client: Any, resources: Mapping[str, float] | None) -> None:
        self.client, self.resources = client, dict(resources or {})
        for name, amount in self.resources.items():
            known = [info["resources"].get(name, 0) for info in self._infos()]
            if max(known) < amount:
                raise ValueError(f"resources: a brick takes {amount} of {name!r}, and workers have {max(known)}")

    def _infos(self) -> list[dict[str, Any]]:
        # The client's own copy is seconds old.
        infos = list(self.client.scheduler_info(n_workers=-1)["workers"].values())
        if not infos:
            raise RuntimeError("the cluster has no workers: start some, or wait for them with client.wait_for_workers(1)")
        return infos

    def memory(self, given: int | str | None) -> float:
        if given is not None:
            return byte_count(given)
        # Dask pauses a worker at 0.8 of its limit. Python and its packages take about 150 MB of it.
        infos = self._infos()
        free = [0.8 * info["memory_limit"] - 150e6 if info["memory_limit"] else np.inf for info in infos]
        return float(min(bytes / info["nthreads"] for bytes, info in zip(free, infos, strict=True)))

    def workers(self) -> int:
        return int(sum(info["nthreads"] for info in self._infos()))

    def reduced(
        self,
        task: Task,
        shared: Any,
        parts: list[tuple[Any, Any]],
        join: Join,
        look: Callable[[float], object],
        draws: bool = False,
    ) -> Any:
        topic = f"voxsplat-{uuid.uuid4().hex}"
        # A task as well, so that it can be repeated, and is sent to each worker once.
        common = delayed(_same)(shared)
        annotated = annotate(resources=self.resources) if draws and self.resources else contextlib.nullcontext()
        with annotated:
            nodes = [delayed(_told)(topic, task, common, key, part) for key, part in parts]
        while len(nodes) > 1:
            nodes = [delayed(join)(nodes[at : at + _BRANCHES]) for at in range(0, len(nodes), _BRANCHES)]

        def count() -> None:
            look(min(len(self.client.get_events(topic)) / len(parts), 1.0))

        result = self._result(nodes[0], count)
        look(1.0)
        return result

    def _result(self, node: Any, look: Callable[[], None]) -> Any:
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


@contextlib.contextmanager
def _engine(executor: Any, resources: Mapping[str, float] | None) -> Iterator[Engine]:
    """Return the executor, the current client of Dask, or a cluster for this call, as an engine."""
    if executor is not None:
        if resources:
            raise ValueError("resources: they are of Dask's workers, and an executor is given")
        yield Executor(executor)
        return
    try:
        current = distributed.Client.current()  # type: ignore[no-untyped-call]
    except ValueError:
        current = None
    if current is not None:
        yield _Cluster(current, resources)
        return
    count = max(1, min(4, os.cpu_count() or 1))
    threads = {name: "1" for name in ("LP_NUM_THREADS", "RAYON_NUM_THREADS", "OMP_NUM_THREADS")} if count > 1 else {}
    cluster = distributed.LocalCluster(  # type: ignore[no-untyped-call]
        n_workers=count, threads_per_worker=1, dashboard_address=":0", env=threads, silence_logs=logging.ERROR,
        resources=resources,
    )
    client = distributed.Client(cluster, set_as_default=False)  # type: ignore[no-untyped-call]
    with cluster, client:
        yield _Cluster(client, resources)
