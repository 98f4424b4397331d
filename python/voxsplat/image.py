"""Pictures."""

from __future__ import annotations

import os
from typing import Any

import numpy as np
from numpy.typing import NDArray

from . import _native

__all__ = ["Image"]


class Image:
    """A picture: an array, a PNG in notebooks, and its statistics.

    ``numpy.asarray(image)`` is f32 of shape (height, width, 4), rows from the top: red, green, blue and alpha,
    premultiplied. It is read-only; ``numpy.array(image)`` is a copy.
    """

    def __init__(self, native: _native.Image) -> None:
        self._native = native

    @property
    def size(self) -> tuple[int, int]:
        """Width and height, pixels."""
        return self._native.size

    @property
    def shape(self) -> tuple[int, int, int]:
        """Height, width and 4."""
        width, height = self.size
        return height, width, 4

    @property
    def stats(self) -> dict[str, Any]:
        """Statistics: adapter, painter, voxels, bytes, and the seconds of each stage."""
        return self._native.stats

    @property
    def choices(self) -> list[str]:
        """The choices that were left open, with their reasons."""
        return self._native.choices

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> NDArray[Any]:
        array = self._native.array
        if dtype is not None and np.dtype(dtype) != array.dtype:
            if copy is False:
                raise ValueError(f"a picture of float32 cannot be {np.dtype(dtype)} without a copy")
            return array.astype(dtype)
        return array.copy() if copy else array

    def rgba8(self, background: str | None = None) -> NDArray[np.uint8]:
        """Return 8-bit RGBA, (height, width, 4), over a background; over ``"transparent"`` alpha is straight."""
        return self._native.rgba8(background)

    def to_png(self, background: str | None = None) -> bytes:
        """Return the bytes of a PNG, over a background such as ``"white"`` or ``"transparent"``."""
        return self._native.to_png(background)

    def save(self, path: str | os.PathLike[str], background: str | None = None) -> None:
        """Write a .png (8 bits) or an .exr (f32). The file appears whole or not at all."""
        self._native.save(path, background)

    def _repr_png_(self) -> bytes:
        return self._native.to_png(None)

    def __repr__(self) -> str:
        width, height = self.size
        return f"<voxsplat.Image of {width} x {height} pixels>"
