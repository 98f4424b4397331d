"""The command ``voxsplat-mcp``: a server of the Model Context Protocol, through which agents look at volumes.

    voxsplat-mcp FOLDER..          # also python -m voxsplat.mcp; needs pip install 'voxsplat[mcp]'

It speaks over its standard streams. Its tools read files in the folders, and no others: neither by absolute paths, nor
by links, nor by the data files that headers name. They write nothing.
"""

from __future__ import annotations

import argparse
import signal
import sys

from ._native import __version__
from .folders import Folders

__all__ = ["main"]


def main() -> int:
    """Serve until the client closes the streams, and return the exit code: 0 done, 1 failed; argparse exits with 2."""
    parser = argparse.ArgumentParser(
        prog="voxsplat-mcp", description="Serve pictures of volumes to agents, by the Model Context Protocol on stdio."
    )
    parser.add_argument("--version", action="version", version=f"voxsplat-mcp {__version__}")
    parser.add_argument("folders", nargs="+", metavar="FOLDER", help="a folder whose files agents may read")
    try:
        folders = Folders(parser.parse_args().folders)
    except ValueError as fault:
        parser.error(str(fault))
    # Ctrl-C ends the process at once: the SDK would wait for the next line of its input. Nothing is written.
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    try:
        from .tools import make_server
    except ModuleNotFoundError as fault:
        print(f"voxsplat-mcp: {fault}: pip install 'voxsplat[mcp]'", file=sys.stderr)
        return 1
    make_server(folders).run()
    return 0


if __name__ == "__main__":
    sys.exit(main())
