"""The folders that a server shows to its clients: which files are in them, and names that clients give to files."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from . import _native

__all__ = ["Folders"]

# Files and folders that one list of volumes looks at: a list of a large disk ends.
_MOST_SEARCHED = 20_000
# Endings by which the name of a transfer function means a file.
_ENDINGS = (".json", ".vp", ".xml")


class Folders:
    """Folders whose files may be read, and no others."""

    def __init__(self, folders: Sequence[str]) -> None:
        """Raise ValueError for names that are no folders. Links are followed once, here."""
        for folder in folders:
            if not os.path.isdir(folder):
                raise ValueError(f"{folder!r} is no folder")
        self.roots = [os.path.realpath(folder) for folder in folders]

    def __str__(self) -> str:
        return ", ".join(self.roots)

    def holds(self, path: str) -> bool:
        """Return whether a path leads into the folders, after all links."""
        real = Path(os.path.realpath(path))
        return any(real.is_relative_to(root) for root in self.roots)

    def file(self, option: str, name: str, mark: str = ":") -> str:
        """Return the path, without links, of a file or a folder that a client names for an option.

        Names are absolute, or relative to the first folder. A part behind `mark` stays, such as in ``scan.h5:/set``.
        """
        if "://" in name:
            raise ValueError(f"{option}: {name!r} is an address, expected a file in {self}")
        path, rest = os.path.join(self.roots[0], name), ""
        head, _, tail = name.rpartition(mark)
        if head and not os.path.exists(path) and os.path.exists(os.path.join(self.roots[0], head)):
            path, rest = os.path.join(self.roots[0], head), mark + tail
        # The same answer whether the file exists or not: a client learns nothing about other folders.
        if not self.holds(path):
            raise ValueError(f"{option}: {name!r} is outside of the folders of this server: {self}")
        if not os.path.exists(path):
            raise ValueError(f"{option}: there is no {name!r} in {self}: list_volumes lists the volumes there")
        return os.path.realpath(path) + rest

    def folder(self, option: str, name: str) -> str:
        """Return the path of a folder that a client names for an option."""
        path = self.file(option, name)
        if not os.path.isdir(path):
            raise ValueError(f"{option}: {name!r} is no folder")
        return path

    def volume(self, option: str, name: str) -> str:
        """Return the path of a volume all of whose files are in the folders, or the name of a built-in volume."""
        if name.startswith("demo:"):
            return name
        path = self.file(option, name)
        source = path if os.path.exists(path) else path.rpartition(":")[0]
        # Headers name data files anywhere, and slices and chunks may be links.
        for data in _native.data_files(source):
            if not self.holds(data):
                raise ValueError(f"{option}: {name!r} reads {data!r}, which is outside of the folders of this server")
        return path

    def transfer(self, option: str, given: Any) -> Any:
        """Return a transfer function or the look of an overlay: files are checked, all else is left as it is."""
        if not isinstance(given, str) or given.startswith("{") or given in dict(_native.presets()):
            return given
        kind = "map:" if given.startswith("map:") else ""
        name = given.removeprefix(kind)
        # The names that the library takes for files, also in the working directory of the server.
        files = {name, name.partition("#")[0], name.rpartition("#")[0]}
        is_file = name == "-" or any(mark in name for mark in "/\\")
        is_file |= any(file.lower().endswith(_ENDINGS) or (file != "" and os.path.exists(file)) for file in files)
        return kind + self.file(option, name, "#") if is_file else given

    def volumes(self, below: str, most: int) -> tuple[list[tuple[str, str]], bool]:
        """Return up to `most` volumes below a path of `file`, each with its format, and whether these are all.

        Links to folders are not followed.
        """
        found: list[tuple[str, str]] = []
        searched = 0
        for folder, folders, files in os.walk(below):
            folders.sort()
            format = _native.format_of(folder)
            if format == "Zarr":
                folders.clear()
            # Files of these folders are slices and chunks.
            paths = [] if format in ("DICOM", "Zarr") else [os.path.join(folder, name) for name in sorted(files)]
            searched += 1 + len(paths)
            kinds = [(folder, format)]
            kinds += [(path, _native.format_of(path)) for path in paths[:_MOST_SEARCHED] if self.holds(path)]
            found += [(path, kind) for path, kind in kinds if kind is not None]
            if len(found) > most or searched > _MOST_SEARCHED:
                return found[:most], False
        return found, True

    def listed(self, path: str, format: str) -> dict[str, Any]:
        """Return a row of a list of volumes: the name that a client gives, the format and, of a file, its bytes."""
        name = os.path.relpath(path, self.roots[0]) if Path(path).is_relative_to(self.roots[0]) else path
        row: dict[str, Any] = {"path": name, "format": format}
        return row | ({"bytes": os.path.getsize(path)} if os.path.isfile(path) else {})
