"""The progress of long work."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeAlias

__all__ = ["Progress", "Reported"]

Progress: TypeAlias = Callable[[str, float], object] | bool | None
"""A callback that gets the stage and the fraction done, 0 to 1; ``True`` shows a bar of tqdm, or lines without tqdm."""


class Reported:
    """The callback for progress: the caller's, or a bar."""

    def __init__(self, progress: Progress) -> None:
        self._progress = progress
        self._bar: Any = None
        self._stage = ""

    def __enter__(self) -> Callable[[str, float], object] | None:
        if self._progress is None or self._progress is False:
            return None
        if self._progress is not True:
            return self._progress
        try:
            from tqdm.auto import tqdm
        except ImportError:
            return self._print
        self._bar = tqdm(total=100, leave=False, bar_format="{l_bar}{bar}| {elapsed}<{remaining}")
        return self._show

    def __exit__(self, *_: object) -> None:
        if self._bar is not None:
            self._bar.close()

    def _show(self, stage: str, done: float) -> None:
        if stage != self._stage:
            self._stage = stage
            self._bar.reset()
            self._bar.set_description(stage)
        self._bar.update(100 * done - self._bar.n)

    def _print(self, stage: str, done: float) -> None:
        if stage != self._stage:
            self._stage = stage
            print(f"voxsplat: {stage}")
