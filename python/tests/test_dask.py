"""Pictures of Dask arrays and Zarr stores, on clusters of this machine."""

from __future__ import annotations

import concurrent.futures
import contextlib
import multiprocessing
import os
import signal
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import dask.array as da
import distributed
import numpy as np
import pytest
import voxsplat as vs
import voxsplat.dask as vd
import xarray
import zarr
from conftest import samples
from test_bricks import difference

OPTIONS = {"size": (100, 80), "light": "headlight", "azimuth": 35, "termination": 0.0}
# Seconds after which a test has failed: nothing may hang.
LIMIT = 120


def limited(call) -> object:
    """The result of a call that ends in time."""
    result: list[object] = []
    fault: list[BaseException] = []

    def run() -> None:
        try:
            result.append(call())
        except BaseException as error:
            fault.append(error)

    thread = threading.Thread(target=run, daemon=True)
    thread.start()
    thread.join(LIMIT)
    assert not thread.is_alive(), "it hangs"
    if fault:
        raise fault[0]
    return result[0]


@pytest.fixture(scope="module")
def client() -> Iterator[distributed.Client]:
    with (
        distributed.LocalCluster(n_workers=2, threads_per_worker=1, memory_limit="2GB", dashboard_address=":0") as cluster,
        distributed.Client(cluster) as client,
    ):
        yield client


@pytest.fixture(scope="module")
def whole() -> vs.Image:
    return vs.render(samples(np.uint8), resolution="full", spacing=(2, 1, 1), **OPTIONS)


def store(path: Path, array: np.ndarray) -> zarr.Array:
    made = zarr.create_array(path, shape=array.shape, chunks=(8, 16, 16), dtype=array.dtype, fill_value=0)
    made[:] = array
    return made


def test_a_cluster_is_made_for_a_call(whole: vs.Image) -> None:
    # No other test has made a cluster yet.
    with pytest.raises(ValueError):
        distributed.Client.current()
    image = limited(lambda: vd.render(samples(np.uint8), spacing=(2, 1, 1), **OPTIONS))
    assert difference(image, whole) < 1e-5
    with pytest.raises(ValueError):
        distributed.Client.current()


def test_arrays_and_stores_are_drawn_as_one(client: distributed.Client, whole: vs.Image, tmp_path: Path) -> None:
    array = samples(np.uint8)
    chunked = da.from_array(array, chunks=(7, 16, 11))
    stored = store(tmp_path / "a.zarr", array)
    named = xarray.DataArray(chunked.transpose(2, 1, 0), dims=("x", "y", "z"))
    stages: list[str] = []
    for volume, bricks in [(chunked, 9), (stored, None), (named, 4), (array, 3)]:
        image = limited(
            lambda volume=volume, bricks=bricks: vd.render(
                volume,
                spacing=(1, 1, 2) if volume is named else (2, 1, 1),
                bricks=bricks,
                progress=lambda stage, done: stages.append(stage),
                **OPTIONS,
            )
        )
        assert difference(image, whole) < 1e-5
    assert set(stages) == {"overview", "bricks"}


def test_other_executors_draw(whole: vs.Image, tmp_path: Path) -> None:
    stored = store(tmp_path / "a.zarr", samples(np.uint8))
    context = multiprocessing.get_context("spawn")
    with concurrent.futures.ProcessPoolExecutor(2, mp_context=context) as pool:
        image = limited(lambda: vd.render(stored, spacing=(2, 1, 1), executor=pool, bricks=3, **OPTIONS))
    assert difference(image, whole) < 1e-5
    with concurrent.futures.ThreadPoolExecutor(1) as pool:
        chunked = da.from_array(samples(np.uint8), chunks=(10, 30, 40))
        image = limited(lambda: vs.render(chunked, spacing=(2, 1, 1), executor=pool, bricks=2, **OPTIONS))
    assert difference(image, whole) < 1e-5
    with pytest.raises(ValueError, match="submit"):
        vd.render(stored, executor=object())


def test_bricks_fit_into_memory(client: distributed.Client) -> None:
    array = da.zeros((200, 200, 200), chunks=(50, 50, 50), dtype=np.uint8) + da.arange(200, dtype=np.uint8)
    options = OPTIONS | {"transfer": [(0, "#ffffff", 0.0), (199, "#ffffff", 0.5)], "bricks": 1}
    one = limited(lambda: vd.render(array, memory="4GB", **options))
    several = limited(lambda: vd.render(array, memory="110MB", **options))
    assert difference(one, several) < 1e-5
    with pytest.raises(MemoryError, match=r"takes \d+ MB, a worker has 60 MB"):
        limited(lambda: vd.render(array, memory="60MB", **options))


def test_missing_and_damaged_chunks_make_no_hole(client: distributed.Client, tmp_path: Path) -> None:
    stored = store(tmp_path / "a.zarr", samples(np.uint8) + 1)
    chunk = next(path for path in sorted((tmp_path / "a.zarr").rglob("*")) if path.is_file() and path.name.isdigit())
    good = chunk.read_bytes()
    chunk.write_bytes(good[: len(good) // 2])
    with pytest.raises(Exception, match=r".") as fault:
        limited(lambda: vd.render(stored, **OPTIONS))
    assert not isinstance(fault.value, AssertionError)
    chunk.unlink()
    with pytest.raises(ValueError, match="1 of the 18 chunks of the store are missing"):
        limited(lambda: vd.render(stored, **OPTIONS))
    limited(lambda: vd.render(stored, missing_chunks="fill", **OPTIONS))


def test_a_worker_that_is_killed_does_not_matter(whole: vs.Image) -> None:
    def slow(block: np.ndarray) -> np.ndarray:
        time.sleep(0.05)
        return block

    array = da.from_array(samples(np.uint8), chunks=(5, 10, 10)).map_blocks(slow, meta=np.empty((0, 0, 0), np.uint8))
    with (
        distributed.LocalCluster(n_workers=2, threads_per_worker=1, memory_limit="2GB", dashboard_address=":0") as cluster,
        distributed.Client(cluster) as client,
    ):
        pids = list(client.run(os.getpid).values())
        killed: list[int] = []

        def kill(stage: str, done: float) -> None:
            if stage == "bricks" and 0 < done < 1 and not killed:
                killed.append(pids[0])
                os.kill(pids[0], signal.SIGKILL)

        image = limited(lambda: vd.render(array, spacing=(2, 1, 1), bricks=32, progress=kill, **OPTIONS))
        assert killed == pids[:1]
        assert difference(image, whole) < 1e-5


def test_workers_that_run_out_of_memory_end_in_one_error() -> None:
    def greedy(block: np.ndarray) -> np.ndarray:
        os.kill(os.getpid(), signal.SIGKILL)
        return block

    with (
        distributed.LocalCluster(n_workers=1, threads_per_worker=1, dashboard_address=":0") as cluster,
        distributed.Client(cluster),
    ):
        array = da.from_array(samples(np.uint8), chunks=(20, 30, 40)).map_blocks(greedy, meta=np.empty((0, 0, 0), np.uint8))
        with pytest.raises(MemoryError, match="workers died"):
            limited(lambda: vd.render(array, **OPTIONS))


def test_a_scheduler_that_goes_away_ends_the_wait() -> None:
    def slow(block: np.ndarray) -> np.ndarray:
        time.sleep(30)
        return block

    cluster = distributed.LocalCluster(n_workers=1, threads_per_worker=1, dashboard_address=":0")
    client = distributed.Client(cluster)
    try:
        array = da.from_array(samples(np.uint8), chunks=(20, 30, 40)).map_blocks(slow, meta=np.empty((0, 0, 0), np.uint8))
        threading.Timer(3, lambda: client.sync(cluster.scheduler.close)).start()
        with pytest.raises(RuntimeError, match="the scheduler of Dask is gone"):
            limited(lambda: vd.render(array, **OPTIONS))
    finally:
        for closed in (client, cluster):
            with contextlib.suppress(TimeoutError):
                closed.close(timeout=1)


def test_turntables_and_films_are_written(client: distributed.Client, tmp_path: Path) -> None:
    array = da.from_array(samples(np.uint8), chunks=(10, 30, 40))
    options = {"size": (60, 40), "light": False}
    paths = limited(lambda: vd.turntable(array, frames=2, to=str(tmp_path / "t/{frame}.png"), bricks=2, **options))
    assert [Path(path).name for path in paths] == ["0.png", "1.png"]
    assert Path(paths[0]).read_bytes() != Path(paths[1]).read_bytes()
    series = xarray.DataArray(da.stack([array, array // 2]), dims=("time", "z", "y", "x"))
    points = [(0, "#ffffff", 0.0), (80, "#ffffff", 0.5)]
    paths = limited(lambda: vd.film(series, points, to=str(tmp_path / "f/{frame}.png"), bricks=1, **options))
    assert Path(paths[0]).read_bytes() != Path(paths[1]).read_bytes()
    with pytest.raises(ValueError, match="{frame}"):
        vd.turntable(array, frames=2, to="a.png")
    with pytest.raises(ValueError, match="dim"):
        vd.film(series, dim="t")
