"""The tools by which agents look at volumes, for the server of `voxsplat.mcp`. Needs the package mcp."""

from __future__ import annotations

import inspect
import json
import textwrap
import warnings
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Annotated, Any, TypeVar, get_type_hints

import anyio
import numpy as np
from anyio import from_thread, to_thread
from mcp.server.mcpserver import Context, Image, MCPServer
from mcp.server.mcpserver.exceptions import ToolError
from mcp.types import CallToolResult, InputRequiredResult, ToolAnnotations
from pydantic import Field, ValidationError, create_model

import voxsplat

from . import _native
from .convert import volume_of
from .folders import Folders
from .renderer import FACTS, Volume
from .settings import Settings, View, parameter_texts, pixels, refuse_unknown
from .warning import VolumeWarning

if TYPE_CHECKING:
    from .image import Image as Picture

__all__ = ["make_server"]

_Result = TypeVar("_Result")
_Tool = TypeVar("_Tool", bound=Callable[..., Any])
_Report = Callable[[str, float], None]

# The longest side of a picture in pixels: models see smaller ones anyway.
_MOST_PIXELS = 2048
_MOST_VOLUMES = 200
_MOST_VIEWS = 12
# The six sides of the world's box.
_SIDES = [{"azimuth": a, "elevation": e} for a, e in ((0, 0), (90, 0), (180, 0), (270, 0), (0, 90), (0, -90))]

_INSTRUCTIONS = """Pictures of voxel volumes (CT, MRI, PET, microscopy, simulations).
1. list_volumes, then describe_volume: lattice, world box, range of values, the preset that suits them.
2. render: without options it chooses preset, light and side, and its notes say why. Look at the picture.
3. Correct it. If it is empty or a block, set transfer or window by the range of values; for another side azimuth and
elevation; if something is in front, clip; for small structures zoom and target, or model "mip".
4. compare_views shows several sides or looks in one picture, slices shows cross-sections.
World coordinates of patients are LPS in the unit of length: +x left, +y posterior, +z superior.
Paths are relative to the first of the folders, or absolute. Nothing is written."""

_VolumeName = Annotated[
    str,
    Field(description="A file or a folder of slices as list_volumes lists them, FILE:DATASET, or a built-in volume such"
          " as demo:nautilus."),
]
# Options that are files or JSON here, or have no text in the package: type, default, text.
_OWN: dict[str, tuple[Any, Any, str]] = {
    "transfer": (
        str | dict[str, Any] | list[list[Any]] | None,
        None,
        "A preset of list_presets, map:NAME of a colour map, labels, a file of a transfer function, or points "
        "[[value, colour, opacity], ..] with values in the range of describe_volume, a colour such as #ffe0c0 or gold, "
        "and the opacity of a voxel, 0 to 1. By default the preset that suits the volume.",
    ),
    "label": (
        str | dict[str, str | float | bool] | list[str] | None,
        None,
        'Looks of labels by numbers or names: {"3": "red", "liver": 0.2, "1,4,7-9": "off"} or "all:0.2". A look is an '
        'opacity of 0 to 1, "x0.5" (a factor of it), "on", "off" or a colour; later looks change earlier ones.',
    ),
    "label_table": (str | None, None, "A file with names, colours and opacities of labels."),
    "labels": (str | None, None, "Path of a volume of labels (a segmentation) to draw too. Label 0 is clear."),
    "mask": (str | None, None, "Path of a volume that shows the volume only where the mask is not 0."),
    "overlays": (
        list[str | tuple[str, str | None] | tuple[str, str | None, tuple[float | None, float | None]]],
        [],
        "Volumes to draw over the volume: paths, or [path, look] or [path, look, [low, high]]. A look is two-sided, "
        "hot, a colour, labels or a transfer function; null chooses.",
    ),
    "meshes": (list[str | tuple[str, str]], [], "Opaque surfaces (PLY, STL, OBJ, VTP): paths, or [path, colour]."),
    "planes": (list[str], [], "Planes with the section of the volume: axial, coronal, sagittal, axial:12.5."),
    "size": (int | list[int], [768, 768], f"[width, height] in pixels, or one number for both: 1 to {_MOST_PIXELS}."),
    "background": (str, "black", "Colour behind the picture: #rrggbb, a name of CSS or transparent."),
    "spacing": (list[float] | None, None, "World lengths between samples, z, y, x, in place of those of the file."),
    "axes": (str | None, None, "Order of the axes of a file of NumPy or of bare samples: zyx (the default) or xyz."),
    "time": (int | None, None, "Number of the time point of a file that has several, from 0."),
    "channel": (int | None, None, "Number of the channel of a file that has several, from 0."),
    "dims": (list[int] | None, None, "Numbers of samples along x, y and z of a file of bare samples."),
    "dtype": (str | None, None, "Type of bare samples, such as uint16."),
    "endian": (str | None, None, "Byte order of bare samples: little (the default) or big."),
    "offset": (int, 0, "Bytes before the first of bare samples."),
}
# Facts of arrays, which files state themselves.
_OF_ARRAYS = {"data", "origin", "affine", "space", "units", "modality"}


def _options() -> dict[str, inspect.Parameter]:
    """Return the options of pictures as keyword parameters, with the types and texts of the package."""
    texts = {name: text for kind in (Volume, View, Settings) for name, text in parameter_texts(kind).items()}
    rows: dict[str, tuple[Any, Any, str]] = {}
    for kind in (View, Settings, volume_of):
        hints = get_type_hints(kind)
        for name, parameter in inspect.signature(kind).parameters.items():
            if name not in _OF_ARRAYS:
                text = " ".join(texts.get(name, "").split()).replace("``", "")
                rows[name] = hints[name], parameter.default, text
    return {name: _parameter(name, *row) for name, row in (rows | _OWN).items()}


def _parameter(name: str, kind: Any, default: Any, text: str) -> inspect.Parameter:
    annotation = Annotated[kind, Field(description=text)]
    return inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=default, annotation=annotation)


_OPTIONS = _options()
_FACTS = {name: option for name, option in _OPTIONS.items() if name in FACTS}
_LOOKS = ("transfer", "window", "azimuth", "elevation", "labels", "mask", "overlays", "background", "size")
_fields: dict[str, Any] = {name: (option.annotation, option.default) for name, option in _OPTIONS.items()}
_Checked = create_model("_Checked", **_fields)


def _with(options: Mapping[str, inspect.Parameter]) -> Callable[[_Tool], _Tool]:
    """Return a decorator that replaces the parameter `options` of a tool by named ones, for the schema of the tool."""

    def signed(tool: _Tool) -> _Tool:
        signature = inspect.signature(tool, eval_str=True)
        own = [parameter for parameter in signature.parameters.values() if parameter.name != "options"]
        vars(tool)["__signature__"] = signature.replace(parameters=[*own, *options.values()])
        return tool

    return signed


class _Server(MCPServer[Any]):
    """A server whose errors are one line, with a hint for a misspelt option."""

    async def call_tool(
        self, name: str, arguments: dict[str, Any], context: Context[Any, Any] | None = None
    ) -> CallToolResult | InputRequiredResult:
        try:
            known = {tool.name: tool.input_schema["properties"] for tool in await self.list_tools()}
            refuse_unknown(arguments, known.get(name, arguments), name)
            return await super().call_tool(name, arguments, context)
        except (ToolError, TypeError) as fault:
            cause = fault.__cause__ or fault
            if isinstance(cause, (ValueError, TypeError, OSError, MemoryError, RuntimeError)):
                raise ToolError(_line(cause)) from fault
            raise


def _line(fault: BaseException) -> str:
    """Return an error as one line."""
    if isinstance(fault, ValidationError):
        reasons: dict[str, list[str]] = {}
        for one in fault.errors():
            reasons.setdefault(str(one["loc"][0]), []).append(one["msg"])
        return "; ".join(f"{name}: {' or '.join(dict.fromkeys(of))}" for name, of in reasons.items())
    if isinstance(fault, OSError) and fault.filename is not None:
        return f"{fault.filename}: {fault.strerror}"
    return " ".join(str(fault).split())


def _titles(views: list[dict[str, Any]]) -> list[str]:
    """Return the number and the options of each view."""
    texts = [json.dumps(view, separators=(", ", " "))[1:-1].replace('"', "") for view in views]
    return [f"{number}: {text}" for number, text in enumerate(texts, 1)]


def _answer(title: str, image: Picture, notes: list[str], warned: list[str]) -> list[Image | str]:
    """Return a picture and its text: the title, notes and warnings."""
    width, height = image.size
    lines = [f"{title}, {width} x {height} pixels", *(f"note: using {note}" for note in dict.fromkeys(notes))]
    lines += [f"warning: {text}" for text in dict.fromkeys(warned)]
    return [Image(data=image.to_png(), format="png"), "\n".join(lines)]


class _Tools:
    """The tools of a server. Their docstrings are their descriptions for models."""

    def __init__(self, folders: Folders) -> None:
        self.folders = folders
        # One picture at a time, in one thread: each thread has a device of its own.
        self.turn = anyio.CapacityLimiter(1)

    @property
    def all(self) -> list[Callable[..., Any]]:
        """The functions that are tools."""
        return [
            self.list_volumes, self.describe_volume, self.list_presets, self.render, self.compare_views, self.slices
        ]

    async def _worked(
        self, context: Context[Any, Any], work: Callable[[_Report], _Result]
    ) -> tuple[_Result, list[str]]:
        """Work in a thread, with progress. Return the result and the warnings."""
        stage_now, before, sent = "", -1.0, -1.0

        def report(stage: str, done: float) -> None:
            nonlocal stage_now, before, sent
            # Ends the work of a client that has cancelled it.
            from_thread.check_cancelled()
            if stage != stage_now:
                stage_now, before = stage, before + 1
            # Progress only grows, and counts stages, because their number is not known.
            if before + done >= sent + 0.1:
                sent = before + done
                from_thread.run(context.report_progress, sent, None, stage)

        def caught() -> tuple[_Result, list[str]]:
            with warnings.catch_warnings(record=True) as warned:
                warnings.simplefilter("always", VolumeWarning)
                return work(report), [str(warning.message) for warning in warned]

        return await to_thread.run_sync(caught, limiter=self.turn)

    def _checked(self, given: Mapping[str, Any]) -> dict[str, Any]:
        """Return options of `voxsplat.render` for the options of a tool. All files are in the folders."""
        options = {name: value for name, value in given.items() if value != _OPTIONS[name].default}
        files: dict[str, Callable[[str, Any], Any]] = {
            "transfer": self.folders.transfer,
            "label_table": self.folders.file,
            "labels": self.folders.volume,
            "mask": self.folders.volume,
            "overlays": lambda name, several: [self._overlay(name, one) for one in several],
            "meshes": lambda name, several: [self._mesh(name, one) for one in several],
        }
        options |= {name: files[name](name, value) for name, value in options.items() if name in files}
        options["size"] = pixels(given["size"])
        if max(options["size"]) > _MOST_PIXELS:
            raise ValueError(f"size: {given['size']}, expected up to {_MOST_PIXELS} pixels a side")
        return options

    def _overlay(self, option: str, one: str | tuple[Any, ...]) -> tuple[Any, ...]:
        name, look, *ends = (one, None) if isinstance(one, str) else one
        return self.folders.volume(option, name), self.folders.transfer(option, look), *ends

    def _mesh(self, option: str, one: str | tuple[str, str]) -> str | tuple[str, str]:
        file = self.folders.file
        return file(option, one) if isinstance(one, str) else (file(option, one[0]), one[1])

    async def list_volumes(
        self,
        context: Context[Any, Any],
        folder: Annotated[str, Field(description="A folder to search, by default all folders of the server.")] = "",
    ) -> dict[str, Any]:
        """List the volumes in the folders: path, format and size in bytes."""
        roots = [self.folders.folder("folder", folder)] if folder else self.folders.roots

        def found(_: _Report) -> dict[str, Any]:
            parts = [self.folders.volumes(root, _MOST_VOLUMES) for root in roots]
            rows = [self.folders.listed(*row) for part, _ in parts for row in part]
            is_whole = len(rows) <= _MOST_VOLUMES and all(whole for _, whole in parts)
            rest = "" if is_whole else "there are more: list a folder below"
            return {"folders": self.folders.roots, "volumes": rows[:_MOST_VOLUMES], "left_off": rest}

        return (await self._worked(context, found))[0]

    @_with(_FACTS)
    async def describe_volume(
        self, context: Context[Any, Any], volume: _VolumeName, **options: Any
    ) -> dict[str, Any]:
        """Describe a volume: lattice, world box, units, values, channels, times, and the preset that suits it.

        shape and spacing are in the order z, y, x; affine leads from (x, y, z) indices to the world; box has the least
        and the greatest world x, y and z, for target, at, and clip "box:X0,X1,Y0,Y1,Z0,Z1". transfer is the preset that
        suits the values, or labels, for the reason given. Reads all samples.
        """
        path = self.folders.volume("volume", volume)
        facts = {name: value for name, value in options.items() if value != _OPTIONS[name].default}
        found, warned = await self._worked(context, lambda _: voxsplat.info(path, **facts))
        affine = np.array(found["affine"])[:3]
        # Voxels reach half a step beyond the lattice points.
        edges = affine[:, :3] * found["shape"][::-1]
        low = affine @ (-0.5, -0.5, -0.5, 1.0) + np.minimum(edges, 0).sum(axis=1)
        box = np.stack([low, low + np.abs(edges).sum(axis=1)], axis=1)
        return found | {"box": box.tolist(), "warnings": warned}

    async def list_presets(self) -> dict[str, Any]:
        """List the presets of transfer functions with the data that each is for, and the colour maps, for transfer."""
        return {"presets": voxsplat.presets(), "colour_maps": [f"map:{name}" for name in voxsplat.colour_maps()]}

    @_with(_OPTIONS)
    async def render(
        self, context: Context[Any, Any], volume: _VolumeName, **options: Any
    ) -> list[Image | str]:
        """Render a picture of a volume, and return it with notes: the choices that were left open, with reasons.

        Without options it chooses a preset, light, sharpness and a side. azimuth 0 is the front of a patient, 90 the
        left, 180 the back, 270 the right; elevation 90 is the top. Look at the picture: if it is empty or a block, set
        transfer or window by the range of values of describe_volume.
        """
        path, asked = self.folders.volume("volume", volume), self._checked(options)
        image, warned = await self._worked(context, lambda report: voxsplat.render(path, progress=report, **asked))
        return _answer(volume, image, image.choices, warned)

    async def compare_views(
        self,
        context: Context[Any, Any],
        volume: _VolumeName,
        views: Annotated[
            list[dict[str, Any]],
            Field(description=f"Up to {_MOST_VIEWS} objects, each with the options of render in which its picture "
                  'differs, such as {"azimuth": 90} or {"transfer": "ct-bone"}. By default the six sides.'),
        ] = _SIDES,
        options: Annotated[
            dict[str, Any],
            Field(description="Options of render for all pictures. size is the size of each, by default 384."),
        ] = {},
    ) -> list[Image | str]:
        """Render several views or looks of a volume side by side in one picture, each with its number and its options.

        Views of one look have one scale, unless an option frames or places them.
        """
        path = self.folders.volume("volume", volume)
        if not 1 <= len(views) <= _MOST_VIEWS:
            raise ValueError(f"views: {len(views)} views, expected 1 to {_MOST_VIEWS}")
        default: dict[str, Any] = {"size": 384}
        if not any(name in one for one in (options, *views) for name in ("target", "view_height", "distance")):
            # One scale.
            default |= {"frame": "visible"}
        all_given = [default | options | view for view in views]
        for given in all_given:
            refuse_unknown(given, _OPTIONS, "render")
        all_asked = [self._checked(dict(_Checked(**given))) for given in all_given]
        sizes = {asked["size"] for asked in all_asked}
        if len(sizes) > 1:
            raise ValueError(f"size: views of {len(sizes)} sizes, expected one in options")
        ((width, height),) = sizes
        if len(views) * width * height > _MOST_PIXELS**2:
            every = f"{len(views)} pictures of {width} x {height}"
            raise ValueError(f"size: {every} have over {_MOST_PIXELS} x {_MOST_PIXELS} pixels")
        titles = _titles(views)

        def drawn(report: _Report) -> tuple[Picture, list[str]]:
            pictures = []
            for title, asked in zip(titles, all_asked, strict=True):
                def labelled(stage: str, done: float, title: str = title) -> None:
                    report(f"{title}: {stage}", done)

                pictures.append(voxsplat.render(path, progress=labelled, **asked))
            notes = [note for picture in pictures for note in picture.choices]
            named = [(one._native, title) for one, title in zip(pictures, titles, strict=True)]
            return voxsplat.Image(_native.Image.sheet(named)), notes

        (image, notes), warned = await self._worked(context, drawn)
        return _answer("\n".join([*titles, f"{volume}: {len(views)} pictures, by rows"]), image, notes, warned)

    @_with({name: _OPTIONS[name] for name in (*_LOOKS, *_FACTS)})
    async def slices(
        self,
        context: Context[Any, Any],
        volume: _VolumeName,
        at: Annotated[
            list[float] | None, Field(description="World point [x, y, z] of all planes; by default the middle.")
        ] = None,
        planes: Annotated[
            list[str], Field(description="Planes, each maybe with a place: axial, coronal, sagittal, axial:12.5.")
        ] = ["axial", "coronal", "sagittal"],
        **options: Any,
    ) -> list[Image | str]:
        """Draw cross-sections of a volume beside its picture, at one scale, to see where a structure lies."""
        path, asked = self.folders.volume("volume", volume), self._checked(options)
        asked |= {"at": at, "planes": planes}
        image, warned = await self._worked(context, lambda report: voxsplat.slices(path, progress=report, **asked))
        return _answer(volume, image, image.choices, warned)


def make_server(folders: Folders) -> MCPServer[Any]:
    """Return a server whose tools read files in the folders, and no others."""
    server = _Server("voxsplat", instructions=_INSTRUCTIONS, version=voxsplat.__version__, log_level="WARNING")
    hints = ToolAnnotations(read_only_hint=True, idempotent_hint=True, open_world_hint=False)
    for tool in _Tools(folders).all:
        server.add_tool(tool, annotations=hints)
    return server
