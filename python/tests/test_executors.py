"""Pictures in bricks by executors that need no Dask cluster."""

from __future__ import annotations

import concurrent.futures
import multiprocessing
import os
import subprocess
import sys
import threading
from pathlib import Path

import dask.array as da
import numpy as np
import pytest
import voxsplat as vs
import zarr
from conftest import samples
from test_bricks import difference

OPTIONS = {"painter": "tiles", "size": (100, 80), "light": "headlight", "azimuth": 35, "termination": 0.0}
# Seconds after which a test has failed, so that nothing hangs; no test needs a part of it.
LIMIT = 600


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


@pytest.fixture(scope="module", name="whole")
def whole_picture() -> vs.Image:
    return vs.render(samples(np.uint8), spacing=(2, 1, 1), **OPTIONS)


def store(path: Path, array: np.ndarray) -> zarr.Array:
    made = zarr.create_array(path, shape=array.shape, chunks=(8, 16, 16), dtype=array.dtype, fill_value=0)
    made[:] = array
    return made


def test_other_executors_draw(whole: vs.Image, tmp_path: Path) -> None:
    stored = store(tmp_path / "a.zarr", samples(np.uint8))
    context = multiprocessing.get_context("spawn")
    with concurrent.futures.ProcessPoolExecutor(2, mp_context=context) as pool:
        image = limited(lambda: vs.render(stored, spacing=(2, 1, 1), executor=pool, bricks=3, **OPTIONS))
    assert difference(image, whole) < 1e-5
    with concurrent.futures.ThreadPoolExecutor(1) as pool:
        chunked = da.from_array(samples(np.uint8), chunks=(10, 30, 40))
        image = limited(lambda: vs.render(chunked, spacing=(2, 1, 1), executor=pool, bricks=2, **OPTIONS))
    assert difference(image, whole) < 1e-5
    # A pool has no submit, but map.
    with context.Pool(2) as pool:
        image = limited(lambda: vs.render(samples(np.uint8), spacing=(2, 1, 1), executor=pool, bricks=6, **OPTIONS))
    assert difference(image, whole) < 1e-5
    with pytest.raises(ValueError, match="expected an object with submit or map"):
        vs.render(stored, executor=object())


def test_executors_need_no_dask(tmp_path: Path) -> None:
    (tmp_path / "dask.py").write_text("raise ImportError('there is no Dask')")
    code = """
import concurrent.futures, numpy, sys, voxsplat
array = numpy.random.default_rng(1).integers(0, 99, (40, 40, 40)).astype(numpy.uint8)
with concurrent.futures.ThreadPoolExecutor(1) as pool:
    image = voxsplat.render(array, executor=pool, bricks=2, memory="1 GB", size=40, light=False)
assert numpy.asarray(image)[..., 3].max() > 0 and "distributed" not in sys.modules
"""
    package = Path(vs.__file__).parents[1]
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(map(str, (tmp_path, package)))}
    done = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True, timeout=LIMIT)
    assert done.returncode == 0, done.stderr
