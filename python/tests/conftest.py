"""Scans of the tests: small, made of formulas."""

from __future__ import annotations

import os
import subprocess
from pathlib import Path

import nibabel
import numpy as np
import pytest

# Whether slow tests run too: sh tests/python.sh --slow. They need the packages of requirements-slow.txt.
SLOW = "VOXSPLAT_SLOW_TESTS" in os.environ
# Each test of these files is slow, and has a quick twin in test_executors.py.
collect_ignore = [] if SLOW else ["test_dask.py"]

REPOSITORY = Path(__file__).parents[2]
PROGRAM = Path(os.environ.get("VOXSPLAT_PROGRAM", REPOSITORY / "target/debug/voxsplat"))


def samples(dtype: object = np.int16) -> np.ndarray:
    """A bent, lopsided body of 20 x 30 x 40 (z, y, x) samples from 0 to about 100, the same in no mirror image."""
    z, y, x = np.meshgrid(*(np.linspace(-1, 1, n) for n in (20, 30, 40)), indexing="ij")
    body = np.exp(-3 * (x**2 + (y - 0.4 * x**2) ** 2 + z**2)) + 0.7 * np.exp(-20 * ((x - 0.6) ** 2 + y**2 + (z - 0.5) ** 2))
    return np.round(80 * body).astype(dtype)


# A lattice turned in space, with three spacings: from (x, y, z) indices to RAS, exact in f32.
_TURN = np.array([[0.8, -0.6, 0.0], [0.6, 0.8, 0.0], [0.0, 0.0, 1.0]])
_LEAN = np.array([[1.0, 0.0, 0.0], [0.0, 0.96, -0.28], [0.0, 0.28, 0.96]])
RAS = np.eye(4)
RAS[:3, :3] = (_TURN @ _LEAN * np.array([1.0, 1.25, 2.0])).astype(np.float32)
RAS[:3, 3] = (-20.5, 12.25, 7.0)
LPS = np.diag([-1.0, -1.0, 1.0, 1.0]) @ RAS


@pytest.fixture(scope="session")
def scan(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An oblique NIfTI of `samples`."""
    image = nibabel.Nifti1Image(samples().transpose(2, 1, 0), None)
    image.header.set_xyzt_units("mm")
    image.set_sform(RAS, code=1)
    image.set_qform(RAS, code=1)
    path = tmp_path_factory.mktemp("scan") / "scan.nii"
    nibabel.save(image, path)
    return path


def command(*words: object, code: int = 0) -> str:
    """Run the program, and return what it prints."""
    done = subprocess.run([PROGRAM, *map(str, words)], capture_output=True, text=True, check=False, timeout=600)
    assert done.returncode == code, done.stderr
    return done.stdout + done.stderr


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Leave slow tests out, unless they are requested."""
    slow = [item for item in items if item.get_closest_marker("slow") and not SLOW]
    items[:] = [item for item in items if item not in slow]
    config.hook.pytest_deselected(items=slow)
