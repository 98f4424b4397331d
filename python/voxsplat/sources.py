"""Arrays that no machine needs to hold, in slices that tasks read."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import accumulate, pairwise, product
from typing import Any

import numpy as np

from .bricks import chunk_sizes
from .convert import located

__all__ = ["Source", "grouped", "samples_in"]

# Bytes of a block of samples that a task reads to count them.
_BLOCK = 1 << 25


class Source:
    """An array of axes (z, y, x) whose slices tasks read, with its place in the world."""

    def __init__(self, data: Any, facts: dict[str, Any], missing_chunks: str) -> None:
        lazy = getattr(data, "data", None) if hasattr(data, "dims") and hasattr(data, "coords") else None
        found, axes, self.facts = located(data, **facts)
        array = found if lazy is None else lazy
        if sorted(axes) != ["x", "y", "z"] or len(array.shape) != 3:
            raise ValueError(f"an array of shape {array.shape} with axes {axes!r}, expected three (z, y, x)")
        if missing_chunks not in ("refuse", "fill"):
            raise ValueError(f"missing_chunks: {missing_chunks!r}, expected refuse or fill")
        self.order = [axes.index(letter) for letter in "zyx"]
        self.is_dask = hasattr(array, "dask") and hasattr(array, "rechunk")
        self.array = array
        self.dtype = np.dtype(array.dtype)
        self.shape = tuple(int(array.shape[axis]) for axis in self.order)
        chunks = getattr(array, "chunks", None)
        if self.is_dask:
            self.chunks = [list(array.chunks[axis]) for axis in self.order]
        elif chunks is not None and all(isinstance(size, int) for size in chunks):
            ends = [(self.shape[i], chunks[axis]) for i, axis in enumerate(self.order)]
            self.chunks = [[min(size, n - at) for at in range(0, n, size)] for n, size in ends]
            self._check_store(missing_chunks)
        else:
            self.chunks = [[n] for n in self.shape]

    def _check_store(self, missing_chunks: str) -> None:
        """Refuse a Zarr store with chunks that were never written, or were lost: they would read as the fill value."""
        written, expected = getattr(self.array, "nchunks_initialized", None), getattr(self.array, "nchunks", None)
        if missing_chunks == "refuse" and written is not None and written != expected:
            raise ValueError(
                f"{expected - written} of the {expected} chunks of the store are missing: "
                'missing_chunks="fill" draws their fill value'
            )

    @property
    def is_in_memory(self) -> bool:
        """Whether the samples are in the memory of this process."""
        return isinstance(self.array, np.ndarray)

    def part(self, held: Sequence[slice]) -> Any:
        """Return a slice: an array, of Dask or in memory, or what `samples_in` reads."""
        index = [held[self.order.index(axis)] for axis in range(3)]
        if self.is_dask or self.is_in_memory:
            return self.array[tuple(index)].transpose(self.order)
        return _Stored(self.array, index, self.order)

    def blocks(self) -> Iterator[tuple[slice, ...]]:
        """Return blocks of whole chunks if they are small, otherwise of parts of chunks; together they are the array."""
        sizes = [list(chunks) for chunks in self.chunks]
        counts = [len(chunks) for chunks in sizes]
        while np.prod([max(of) for of in sizes], dtype=np.float64) * self.dtype.itemsize > _BLOCK:
            counts[int(np.argmax([max(of) for of in sizes]))] *= 2
            sizes = [grouped(chunks, count) for chunks, count in zip(self.chunks, counts, strict=True)]
        # Neighbours along x, then y and z, are joined while they are small.
        for axis in (2, 1, 0):
            others = float(np.prod([max(of) for i, of in enumerate(sizes) if i != axis])) * self.dtype.itemsize
            sizes[axis] = _joined(sizes[axis], int(_BLOCK // others))
        ends = [[slice(*pair) for pair in pairwise(accumulate(of, initial=0))] for of in sizes]
        return product(*ends)


class _Stored:
    """A slice of a store, which the task reads that needs it."""

    def __init__(self, array: Any, index: list[slice], order: list[int]) -> None:
        self.array, self.index, self.order = array, index, order

    def read(self) -> np.ndarray[Any, Any]:
        return np.asarray(self.array[tuple(self.index)]).transpose(self.order)


def samples_in(part: Any) -> np.ndarray[Any, Any]:
    """Return the samples of a slice."""
    return part.read() if isinstance(part, _Stored) else np.asarray(part)


def grouped(chunks: list[int], count: int) -> list[int]:
    """Return sizes of about equal bricks: whole chunks of the store, if there are enough, otherwise parts of them."""
    voxels = sum(chunks)
    if count > len(chunks):
        return chunk_sizes((1, 1, count), (1, 1, voxels))[2]
    ends = np.cumsum(chunks)
    # The chunk that ends nearest to each even cut.
    cuts = {int(ends[np.argmin(np.abs(ends - voxels * i / count))]) for i in range(1, count)}
    return [int(size) for size in np.diff([0, *sorted(cuts - {voxels}), voxels])]


def _joined(sizes: list[int], most: int) -> list[int]:
    """Join the sizes of neighbours, as long as their sum is at most `most`."""
    joined: list[int] = []
    for size in sizes:
        if joined and joined[-1] + size <= most:
            joined[-1] += size
        else:
            joined.append(size)
    return joined
