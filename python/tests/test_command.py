"""The program inside the package."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest
from conftest import command


def module(*words: object) -> subprocess.CompletedProcess[str]:
    """Run ``python -m voxsplat``."""
    line = [sys.executable, "-m", "voxsplat", *map(str, words)]
    return subprocess.run(line, capture_output=True, text=True, check=False, timeout=600)


def test_the_package_runs_the_command(scan: Path, tmp_path: Path) -> None:
    done = module("--version")
    assert (done.returncode, done.stdout) == (0, command("--version"))
    words = ("render", scan, "--size", 48, "--painter", "cpu", "--output")
    done = module(*words, tmp_path / "package.png")
    assert done.returncode == 0, done.stderr
    assert done.stderr == command(*words, tmp_path / "program.png")
    assert (tmp_path / "package.png").read_bytes() == (tmp_path / "program.png").read_bytes()


def test_the_command_of_the_package_has_the_codes_and_lines_of_the_program(tmp_path: Path) -> None:
    done = module("render", "none.nrrd", "-o", tmp_path / "none.png")
    assert (done.returncode, done.stderr.count("\n"), done.stdout) == (1, 1, "")
    done = module("render", "--sise", "8")
    assert done.returncode == 2
    assert done.stderr == command("render", "--sise", "8", code=2)
    # A name that is no UTF-8 reaches the program as it is.
    done = module("info", "\udcff.nrrd")
    assert done.returncode == 1
    assert len(list(tmp_path.iterdir())) == 0


@pytest.mark.skipif(os.name != "posix", reason="descriptors of POSIX")
@pytest.mark.parametrize("closed", ["<&-", ">&-", "2>&-", "<&- >&- 2>&-"])
def test_a_closed_stream_is_an_empty_one(closed: str, tmp_path: Path) -> None:
    # Without a file in its place, the next file that is opened becomes the stream, and the command waits for itself.
    line = f'exec "$0" -m voxsplat render demo:sphere:16 -o "$1" --size 16 --painter cpu {closed}'
    for picture in (str(tmp_path / "a.png"), "-"):
        done = subprocess.run(["sh", "-c", line, sys.executable, picture], capture_output=True, check=False, timeout=600)
        assert done.returncode == 0, done.stderr
    assert (tmp_path / "a.png").read_bytes().startswith(b"\x89PNG")
    done = subprocess.run(["sh", "-c", '"$0" -m voxsplat info - <&-', sys.executable], capture_output=True, timeout=600)
    assert (done.returncode, done.stderr.count(b"\n")) == (1, 1)
