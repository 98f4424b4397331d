"""Types: the stubs match the module, and the package keeps them."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

FOLDER = Path(__file__).parents[1]


def run(*words: str) -> None:
    done = subprocess.run([sys.executable, "-m", *words], capture_output=True, text=True, check=False, cwd=FOLDER)
    assert done.returncode == 0, done.stdout + done.stderr


def test_stubs_describe_the_native_module() -> None:
    run("mypy.stubtest", "voxsplat._native", "--mypy-config-file", "pyproject.toml")


def test_the_package_keeps_its_types() -> None:
    run("mypy", "voxsplat")
