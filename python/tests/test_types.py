"""Types: the stubs match the module, and the package keeps them."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import voxsplat

CONFIG = Path(__file__).parents[1] / "pyproject.toml"
INSTALLED = Path(voxsplat.__file__).parent


def run(*words: str) -> None:
    words = (sys.executable, "-m", *words)
    environment = {**os.environ, "MYPYPATH": str(INSTALLED.parent), "PYTHONPATH": str(INSTALLED.parent)}
    # Not in the folder of the sources, which have no native module.
    done = subprocess.run(words, capture_output=True, text=True, check=False, cwd=Path(__file__).parent, env=environment)
    assert done.returncode == 0, done.stdout + done.stderr


def test_stubs_describe_the_native_module() -> None:
    run("mypy.stubtest", "voxsplat._native", "--mypy-config-file", str(CONFIG))


def test_the_package_keeps_its_types() -> None:
    run("mypy", "--config-file", str(CONFIG), "-p", "voxsplat")
