"""Warnings about volumes."""

from __future__ import annotations

import sys
import warnings

__all__ = ["VolumeWarning", "warn"]


class VolumeWarning(UserWarning):
    """A volume may not be the one that was meant: the order of its axes is in doubt, or its mask is empty."""

    # Its documentation lives in the package.
    __module__ = "voxsplat"


def warn(message: str) -> None:
    """Warn about the line of the caller's program that called the package."""
    frame, level = sys._getframe(), 1
    while frame.f_back is not None and frame.f_globals.get("__name__", "").split(".")[0] == "voxsplat":
        frame, level = frame.f_back, level + 1
    warnings.warn(message, VolumeWarning, stacklevel=level)
