"""Pictures of Dask arrays and Zarr stores, on clusters of this machine and of MPI. All of them are slow: test_executors.py
has quick tests of the same bricks on other executors."""

from __future__ import annotations

import contextlib
import json
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import dask
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
from test_executors import LIMIT, OPTIONS, limited, store, whole_picture  # noqa: F401
from voxsplat.large import Large

@pytest.fixture(scope="module")
def client() -> Iterator[distributed.Client]:
    with (
        distributed.LocalCluster(n_workers=2, threads_per_worker=1, memory_limit="2GB", dashboard_address=":0") as cluster,
        distributed.Client(cluster) as client,
    ):
        yield client


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


MPI = """
import sys, numpy, voxsplat
from mpi4py.futures import MPIPoolExecutor

if __name__ == "__main__":
    with MPIPoolExecutor() as pool:
        assert pool.num_workers == 2, pool.num_workers
        image = voxsplat.render(numpy.load(sys.argv[1]), spacing=(2, 1, 1), executor=pool, bricks=5, **OPTIONS)
    numpy.save(sys.argv[2], numpy.asarray(image))
"""


def test_processes_of_mpi_draw(whole: vs.Image, tmp_path: Path) -> None:
    volume, picture, script = (tmp_path / name for name in ("volume.npy", "picture.npy", "script.py"))
    np.save(volume, samples(np.uint8))
    script.write_text(f"OPTIONS = {OPTIONS}\n{MPI}")
    mpiexec = Path(sys.executable).with_name("mpiexec")
    python = (sys.executable, "-m", "mpi4py.futures", script, volume, picture)
    # Open MPI asks before it runs as root or on fewer processors than it has processes.
    allowed = dict.fromkeys(("OMPI_ALLOW_RUN_AS_ROOT", "OMPI_ALLOW_RUN_AS_ROOT_CONFIRM"), "1")
    environment = os.environ | allowed | {"PYTHONPATH": str(Path(vs.__file__).parents[1])}
    words = [mpiexec, "--oversubscribe", "-n", "3", *python]
    done = subprocess.run(words, env=environment, capture_output=True, text=True, timeout=LIMIT)
    assert done.returncode == 0, done.stdout + done.stderr
    assert np.abs(np.load(picture) - np.asarray(whole)).max() < 1e-5


def test_the_executor_of_dask_draws(client: distributed.Client, whole: vs.Image) -> None:
    image = limited(lambda: vs.render(samples(np.uint8), spacing=(2, 1, 1), executor=client.get_executor(), **OPTIONS))
    assert difference(image, whole) < 1e-5


@pytest.mark.parametrize("kind", ["u1", "f4"])
def test_presets_are_those_of_the_whole_volume(
    client: distributed.Client, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, kind: str
) -> None:
    # Every third sample is planned by; the brightest and the darkest samples lie between them.
    monkeypatch.setattr("voxsplat.large._OVERVIEW", 1500)
    monkeypatch.setattr("voxsplat.sources._BLOCK", 4000)
    array = samples(np.float64) * 1.5
    array[0, 0, 0], array[9, 12, 15:18] = -80, 250
    array = (array + 80 if kind == "u1" else array + 0.25).astype(kind)
    for transfer, facts in [("ct-bone", {}), ("angiography", {}), (None, {"modality": "CT"}), ("map:viridis", {})]:
        options = {"size": (60, 50), "light": False, "frame": "volume", "spacing": (2, 1, 1)} | facts
        made = {}
        for name, volume in [("memory", array), ("dask", da.from_array(array, chunks=(7, 16, 11)))]:
            large = Large(vd._Cluster(client, None), volume, transfer, None, bricks=2, azimuth=20, **options)
            assert large.step == 3
            made[name] = json.loads(large._plan(large.options).to_json())["transfer"]
        whole = vs.plan(array, (1, 1, 2), transfer=transfer, azimuth=20, **options)
        assert made["dask"] == made["memory"] == json.loads(whole.to_json())["transfer"]


def test_bricks_take_resources_of_workers(whole: vs.Image) -> None:
    with (
        distributed.LocalCluster(n_workers=1, threads_per_worker=1, dashboard_address=":0", resources={"GPU": 1}) as cluster,
        distributed.Client(cluster) as client,
    ):
        cluster.new_spec["options"]["resources"] = {}
        cluster.scale(2)
        client.wait_for_workers(2)
        named = lambda: [os.environ.setdefault("DRAWS", "1"), "#0"][1]  # noqa: E731
        image = limited(
            lambda: vd.render(
                samples(np.uint8), spacing=(2, 1, 1), bricks=6, resources={"GPU": 1}, adapter=named, **OPTIONS
            )
        )
        assert difference(image, whole) < 1e-5
        drew = client.run(lambda dask_worker: (dict(dask_worker.state.total_resources), "DRAWS" in os.environ))
        assert sorted(drew.values(), key=lambda pair: pair[1]) == [({}, False), ({"GPU": 1}, True)]
        with pytest.raises(ValueError, match="takes 2 of 'GPU', and workers have 1"):
            vd.render(samples(np.uint8), resources={"GPU": 2}, **OPTIONS)


def test_bricks_fit_into_memory(client: distributed.Client) -> None:
    array = da.zeros((200, 200, 200), chunks=(50, 50, 50), dtype=np.uint8) + da.arange(200, dtype=np.uint8)
    options = OPTIONS | {"transfer": [(0, "#ffffff", 0.0), (199, "#ffffff", 0.5)], "bricks": 1}
    one = limited(lambda: vd.render(array, memory="4GB", **options))
    several = limited(lambda: vd.render(array, memory="180MB", **options))
    assert difference(one, several) < 1e-5
    with pytest.raises(MemoryError, match=r"takes \d+ MB, a worker has 100 MB"):
        limited(lambda: vd.render(array, memory="100MB", **options))


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


def test_a_worker_that_is_killed_does_not_matter(whole: vs.Image, tmp_path: Path) -> None:
    with (
        distributed.LocalCluster(n_workers=2, threads_per_worker=1, memory_limit="2GB", dashboard_address=":0") as cluster,
        distributed.Client(cluster) as client,
    ):
        victim, other = client.run(os.getpid).values()
        gate = tmp_path / "gate"
        killed: list[int] = []

        def held(block: np.ndarray) -> np.ndarray:
            # While the gate is closed, only the victim works: bricks are missing when it dies.
            while gate.exists() and os.getpid() == other:
                time.sleep(0.01)
            return block

        def kill(stage: str, done: float) -> None:
            if stage == "overview" and done == 1:
                gate.touch()
            if stage == "bricks" and 0 < done < 1 and not killed:
                killed.append(victim)
                os.kill(victim, signal.SIGKILL)
                gate.unlink()

        array = da.from_array(samples(np.uint8), chunks=(5, 10, 10)).map_blocks(held, meta=np.empty((0, 0, 0), np.uint8))
        image = limited(lambda: vd.render(array, spacing=(2, 1, 1), bricks=32, progress=kill, **OPTIONS))
        assert killed == [victim]
        assert difference(image, whole) < 1e-5


def test_workers_that_die_again_and_again_end_in_one_error() -> None:
    def deadly(block: np.ndarray) -> np.ndarray:
        # As Dask ends a worker beyond its limit of memory.
        os.kill(os.getpid(), signal.SIGKILL)
        return block

    with (
        dask.config.set({"distributed.scheduler.allowed-failures": 1}),
        distributed.LocalCluster(n_workers=1, threads_per_worker=1, dashboard_address=":0") as cluster,
        distributed.Client(cluster),
    ):
        array = da.from_array(samples(np.uint8), chunks=(20, 30, 40)).map_blocks(deadly, meta=np.empty((0, 0, 0), np.uint8))
        with pytest.raises(MemoryError, match="workers died"):
            limited(lambda: vd.render(array, memory="500MB", **OPTIONS))


def test_a_scheduler_that_goes_away_ends_the_wait(tmp_path: Path) -> None:
    begun, end = tmp_path / "begun", tmp_path / "end"

    def endless(block: np.ndarray) -> np.ndarray:
        begun.touch()
        while not end.exists():
            time.sleep(0.01)
        return block

    cluster = distributed.LocalCluster(n_workers=1, threads_per_worker=1, dashboard_address=":0")
    client = distributed.Client(cluster)

    def leave() -> None:
        while not begun.exists() and not end.exists():
            time.sleep(0.01)
        client.sync(cluster.scheduler.close)

    try:
        array = da.from_array(samples(np.uint8), chunks=(20, 30, 40)).map_blocks(endless, meta=np.empty((0, 0, 0), np.uint8))
        threading.Thread(target=leave, daemon=True).start()
        with pytest.raises(RuntimeError, match="the scheduler of Dask is gone"):
            limited(lambda: vd.render(array, **OPTIONS))
    finally:
        end.touch()
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
