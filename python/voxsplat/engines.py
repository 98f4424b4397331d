"""Engines, which run the tasks of a picture in bricks."""

from __future__ import annotations

import concurrent.futures
import itertools
import os
import re
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from typing import Any, TypeAlias

__all__ = ["Engine", "Executor", "Here", "Report", "byte_count"]

Report: TypeAlias = Callable[[str, float], object]
Task: TypeAlias = Callable[[Any, Any, Any], Any]
"""A function of an object that all tasks share, the key of a part, and its samples or a slice of a store."""
Join: TypeAlias = Callable[[list[Any]], Any]
"""A function of the results of neighbours in their order."""

_UNITS = {"": 1, "k": 10**3, "m": 10**6, "g": 10**9, "t": 10**12, "ki": 2**10, "mi": 2**20, "gi": 2**30, "ti": 2**40}


class Engine:
    """An engine, which runs tasks."""

    def memory(self, given: int | str | None) -> float:
        """Return the bytes that a task may take."""
        return float("inf") if given is None else byte_count(given)

    def least(self, given: int | None) -> int:
        """Return the least number of bricks."""
        return 2 * self.workers() if given is None else given

    def workers(self) -> int:
        """Return the number of tasks that run at a time."""
        return 1

    def reduced(
        self,
        task: Task,
        shared: Any,
        parts: list[tuple[Any, Any]],
        join: Join,
        look: Callable[[float], object],
        draws: bool = False,
    ) -> Any:
        """Run a task for each key and part, and join the results. `look` is called with the fraction done."""
        raise NotImplementedError


def _joined(results: Iterable[Any], count: int, join: Join, look: Callable[[float], object]) -> Any:
    merged = None
    for done, result in enumerate(results, 1):
        merged = result if done == 1 else join([merged, result])
        look(done / count)
    return merged


class Here(Engine):
    """The engine of this process: one task after the other."""

    def reduced(
        self,
        task: Task,
        shared: Any,
        parts: list[tuple[Any, Any]],
        join: Join,
        look: Callable[[float], object],
        draws: bool = False,
    ) -> Any:
        return _joined((task(shared, key, part) for key, part in parts), len(parts), join, look)


def _called(call: tuple[Task, Any, Any, Any]) -> Any:
    task, shared, key, part = call
    return task(shared, key, part)


class Executor(Engine):
    """The engine of an object that has `submit` or `map`."""

    def __init__(self, executor: Any) -> None:
        self.submits = callable(getattr(executor, "submit", None))
        if not self.submits and not callable(getattr(executor, "map", None)):
            raise ValueError(f"executor: {type(executor).__name__}, expected an object with submit or map")
        self.executor = executor

    def workers(self) -> int:
        names = ("_max_workers", "num_workers", "_processes")
        known = (getattr(self.executor, name, None) for name in names)
        return next((int(count) for count in known if count), os.cpu_count() or 1)

    def reduced(
        self,
        task: Task,
        shared: Any,
        parts: list[tuple[Any, Any]],
        join: Join,
        look: Callable[[float], object],
        draws: bool = False,
    ) -> Any:
        return _joined(self._results(task, shared, parts), len(parts), join, look)

    def _results(self, task: Task, shared: Any, parts: list[tuple[Any, Any]]) -> Iterator[Any]:
        """Yield the results in order. Few tasks wait at a time, because each may carry samples."""
        waiting: deque[Any] = deque()
        few = 2 * self.workers()
        # The executor may not know Dask.
        calls = ((task, shared, key, part.compute() if hasattr(part, "dask") else part) for key, part in parts)
        try:
            while not self.submits and (some := list(itertools.islice(calls, few))):
                yield from self.executor.map(_called, some)
            for call in calls:
                waiting.append(self.executor.submit(*call))
                if len(waiting) >= few:
                    yield waiting.popleft().result()
            while waiting:
                yield waiting.popleft().result()
        except concurrent.futures.BrokenExecutor as fault:
            raise RuntimeError(f"a process of the executor died: {fault}") from fault
        finally:
            for future in waiting:
                future.cancel()


def byte_count(given: int | float | str) -> float:
    """Return a number of bytes, such as ``"2GB"`` or ``"512 MiB"``."""
    found = re.fullmatch(r"\s*([0-9.]+(?:e[0-9]+)?)\s*([kmgt]?i?)b?\s*", str(given).lower())
    if found is None or found[2] not in _UNITS:
        raise ValueError(f"memory: {given!r}, expected bytes such as 2000000000 or '2GB'")
    return float(found[1]) * _UNITS[found[2]]
