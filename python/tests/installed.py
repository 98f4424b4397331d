"""Checks the installed package, as its first user sees it: python installed.py. Needs no repository and no driver."""

from __future__ import annotations

import subprocess
import sys
import sysconfig
import tempfile
from pathlib import Path

import numpy as np
import voxsplat

PNG = b"\x89PNG\r\n"


def run(*words: object) -> str:
    """Run a command, which must succeed, and return what it prints."""
    done = subprocess.run(list(map(str, words)), capture_output=True, text=True, check=False)
    if done.returncode != 0:
        sys.exit(f"{words}: exit code {done.returncode}: {done.stderr}")
    return done.stdout


def main() -> None:
    """Render by the program, by the module and by the library, and compare the files."""
    script = Path(sysconfig.get_path("scripts")) / ("voxsplat.exe" if sys.platform == "win32" else "voxsplat")
    version = f"voxsplat {voxsplat.__version__}\n"
    assert run(script, "--version") == version
    assert run(sys.executable, "-m", "voxsplat", "--version") == version
    assert "cpu" in run(script, "devices", "--json")
    # The server needs its extra for more.
    assert run(script.with_stem("voxsplat-mcp"), "--version") == f"voxsplat-mcp {voxsplat.__version__}\n"
    assert Path(voxsplat.__file__).with_name("SKILL.md").is_file()
    with tempfile.TemporaryDirectory() as folder:
        samples, files = Path(folder, "samples.npy"), [Path(folder, name) for name in ("a.png", "b.png", "c.png")]
        z, y, x = np.mgrid[-1:1:32j, -1:1:32j, -1:1:32j]
        np.save(samples, np.exp(-4 * (x**2 + y**2 + z**2)).astype(np.float32))
        look = ("--size", "96", "--painter", "cpu")
        run(script, "render", samples, "-o", files[0], *look)
        run(sys.executable, "-m", "voxsplat", "render", samples, "-o", files[1], *look)
        voxsplat.render(samples, size=96, painter="cpu").save(files[2])
        pictures = [file.read_bytes() for file in files]
    assert pictures[0].startswith(PNG) and len(pictures[0]) > 1000
    assert pictures[0] == pictures[1] == pictures[2], "the program and the library differ"
    print(f"voxsplat {voxsplat.__version__} works: Python {sys.version.split()[0]} on {sysconfig.get_platform()}")


if __name__ == "__main__":
    main()
