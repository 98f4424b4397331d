"""The command ``voxsplat``: the program is inside the native module. Also ``python -m voxsplat``."""

from __future__ import annotations

import sys

from ._native import command


def main() -> int:
    """Run the command line of this process, and return its exit code: 0 done, 1 failed, 2 wrong arguments."""
    return command(["voxsplat", *sys.argv[1:]])


if __name__ == "__main__":
    sys.exit(main())
