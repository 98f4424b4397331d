"""The native module: the interface of the package is `voxsplat`."""

from collections.abc import Callable, Mapping
from os import PathLike
from typing import Any, final

import numpy as np
from numpy.typing import NDArray

__version__: str
__all__ = [
    "Counts",
    "DeviceError",
    "Image",
    "Mesh",
    "Partial",
    "Plan",
    "Renderer",
    "Scene",
    "Volume",
    "__version__",
    "adapters",
    "check",
    "colour_maps",
    "command",
    "data_files",
    "even_chunks",
    "format_of",
    "hint",
    "needs_counts",
    "presets",
]

class DeviceError(RuntimeError): ...

@final
class Volume:
    @staticmethod
    def of_array(array: NDArray[Any], facts: Mapping[str, Any]) -> Volume: ...
    @staticmethod
    def of_file(path: str | PathLike[str], facts: Mapping[str, Any]) -> Volume: ...
    def info(self) -> dict[str, Any]: ...

@final
class Renderer:
    def __new__(cls, adapter: str | None) -> Renderer: ...
    def prepare(
        self,
        volume: Volume,
        labels: Volume | None,
        mask: Volume | None,
        overlays: list[tuple[Volume, str, str | None, str | None]],
        settings: Any,
        view: Any,
        size: tuple[int, int],
        progress: Callable[[str, float], object] | None,
    ) -> Scene: ...
    def render(
        self,
        scene: Scene,
        view: Any,
        size: tuple[int, int],
        region: tuple[int, int, int, int] | None,
        background: str,
        meshes: list[Mesh],
        depth: NDArray[np.float32] | None,
        planes: list[str],
        progress: Callable[[str, float], object] | None,
    ) -> Image: ...
    def slices(
        self,
        scene: Scene,
        size: tuple[int, int],
        planes: list[str],
        at: tuple[float, ...] | None,
        background: str,
        title: str | None,
        caption: str | None,
        progress: Callable[[str, float], object] | None,
    ) -> Image: ...
    def depths(
        self,
        scene: Scene,
        view: Any,
        size: tuple[int, int],
        region: tuple[int, int, int, int] | None,
        progress: Callable[[str, float], object] | None,
    ) -> NDArray[np.float32]: ...
    def brick(
        self,
        plan: Plan,
        number: int,
        slice: Volume,
        light: IncomingLight | None,
        progress: Callable[[str, float], object] | None,
    ) -> Partial: ...
    def sweep_light(
        self,
        plan: Plan,
        slice: Callable[[list[tuple[int, int]]], Volume],
        progress: Callable[[str, float], object] | None,
    ) -> list[IncomingLight]: ...
    def close(self) -> None: ...

@final
class Plan:
    def __new__(
        cls,
        overview: Volume,
        settings: Any,
        view: Any,
        size: tuple[int, int],
        dims: tuple[int, ...],
        affine: Any,
        counts: Counts | None,
        chunks: tuple[list[int], list[int], list[int]],
    ) -> Plan: ...
    @staticmethod
    def from_json(text: str, choices: list[str]) -> Plan: ...
    def to_json(self) -> str: ...
    @property
    def bricks(self) -> list[tuple[list[tuple[int, int]], list[tuple[int, int]], int]]: ...
    @property
    def size(self) -> tuple[int, int]: ...
    @property
    def choices(self) -> list[str]: ...
    @property
    def casts_shadows(self) -> bool: ...
    def merge(self, parts: list[Partial], background: str) -> Image: ...

@final
class Partial:
    @staticmethod
    def from_bytes(bytes: bytes) -> Partial: ...
    def to_bytes(self) -> bytes: ...
    @property
    def bricks(self) -> tuple[int, int]: ...
    def over(self, back: Partial) -> Partial: ...

@final
class IncomingLight:
    @staticmethod
    def from_bytes(bytes: bytes) -> IncomingLight: ...
    def to_bytes(self) -> bytes: ...
    @property
    def brick(self) -> int: ...

@final
class Counts:
    def __new__(cls, json: str) -> Counts: ...
    @staticmethod
    def of(part: Volume) -> Counts: ...
    def refined(self, part: Volume) -> Counts: ...
    def plus(self, other: Counts) -> Counts: ...
    @property
    def is_complete(self) -> bool: ...
    def to_json(self) -> str: ...
    def __reduce__(self) -> tuple[type[Counts], tuple[str]]: ...

@final
class Mesh:
    @staticmethod
    def of_file(path: str | PathLike[str], color: str | None) -> Mesh: ...
    @staticmethod
    def of_arrays(
        vertices: NDArray[np.float32],
        triangles: NDArray[np.uint32],
        colors: NDArray[np.uint8] | None,
        color: str | None,
    ) -> Mesh: ...

@final
class Scene:
    @property
    def choices(self) -> list[str]: ...
    @property
    def hidden(self) -> list[str]: ...

@final
class Image:
    @staticmethod
    def sheet(pictures: list[tuple[Image, str]]) -> Image: ...
    @property
    def size(self) -> tuple[int, int]: ...
    @property
    def array(self) -> NDArray[np.float32]: ...
    @property
    def stats(self) -> dict[str, Any]: ...
    @property
    def choices(self) -> list[str]: ...
    def rgba8(self, background: str | None) -> NDArray[np.uint8]: ...
    def to_png(self, background: str | None) -> bytes: ...
    def save(self, path: str | PathLike[str], background: str | None) -> None: ...

def presets() -> list[tuple[str, str]]: ...
def colour_maps() -> list[str]: ...
def adapters() -> str: ...
def command(words: list[str]) -> int: ...
def data_files(path: str | PathLike[str]) -> list[str]: ...
def format_of(path: str | PathLike[str]) -> str | None: ...
def hint(word: str, names: list[str]) -> str: ...
def needs_counts(settings: Any) -> bool: ...
def even_chunks(dims: tuple[int, ...], counts: tuple[int, ...]) -> list[list[int]]: ...
def check(view: Any, settings: Any, size: tuple[int, int]) -> None: ...
