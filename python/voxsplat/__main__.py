"""The command ``voxsplat``: the program is inside the native module. Also ``python -m voxsplat``."""

from __future__ import annotations

import contextlib
import os
import sys

from ._native import command


def main() -> int:
    """Run the command line of this process, and return its exit code: 0 done, 1 failed, 2 wrong arguments."""
    # A closed standard stream would become the next file that is opened. A program of Rust opens this file for it too,
    # but a module does not.
    for stream in range(3):
        try:
            os.fstat(stream)
        except OSError:
            with contextlib.suppress(OSError):
                os.open(os.devnull, os.O_RDWR)
    return command(["voxsplat", *sys.argv[1:]])


if __name__ == "__main__":
    sys.exit(main())
