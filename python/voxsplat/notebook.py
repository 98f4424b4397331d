"""The widget of `voxsplat.view`, in which a volume turns."""

from __future__ import annotations

import base64
import contextlib
import re
import threading
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import traitlets

from .functions import colour_maps, presets
from .image import Image
from .progress import Progress
from .renderer import FACTS, Renderer, Scene, Volume, native_volume
from .settings import Settings, View, as_texts, check, field_names, pixels, refuse_unknown, single, split

try:
    import anywidget
except ImportError as fault:
    raise ImportError("voxsplat.view needs anywidget: pip install 'voxsplat[notebook]'") from fault

__all__ = ["Viewer"]

# The options that are no fields of View, Settings and Volume: of scenes and of pictures.
_OF_SCENES = ("labels", "mask", "overlays")
_OF_PICTURES = ("meshes", "background")
# The values that the user changes.
_CHANGED = ("azimuth", "elevation", "zoom", "transfer", "window", "time")
# The seconds for a moving picture, and the least share that its sides have of the sides of a still picture.
_SECONDS = 0.07
_LEAST = 0.25


class _Overtaken(Exception):  # noqa: N818
    """A newer picture is requested."""


class _Refused(traitlets.TraitError, ValueError):  # noqa: N818
    """A value without a picture. Only its own errors make `traitlets` restore the value before."""


def _name(transfer: Any, _: Any = None) -> str:
    """Return a transfer function as the front end knows it: empty if it is none of the names."""
    return transfer if isinstance(transfer, str) else ""


class Viewer(anywidget.AnyWidget):
    """A volume that turns when it is dragged: see `voxsplat.view`.

    `azimuth`, `elevation`, `zoom`, `transfer`, `window` and `time` are the values that the user chose. Setting them
    changes the picture. A value without a picture raises `ValueError`, and a wrong type `traitlets.TraitError`.
    """

    _esm = Path(__file__).with_suffix(".js")

    azimuth = traitlets.CFloat(0.0).tag(sync=True)
    elevation = traitlets.CFloat(0.0).tag(sync=True)
    zoom = traitlets.CFloat(1.0).tag(sync=True)
    transfer = traitlets.Any().tag(sync=True, to_json=_name)
    window = traitlets.Tuple(traitlets.CFloat(), traitlets.CFloat(), allow_none=True, default_value=None).tag(sync=True)
    time = traitlets.CInt(0).tag(sync=True)
    # The still picture, and facts for the front end: the values of a reset, the range of the samples (none of labels),
    # the number of time points, and names of transfer functions.
    _picture = traitlets.Bytes().tag(sync=True)
    _size = traitlets.Any().tag(sync=True)
    _first = traitlets.Any().tag(sync=True)
    _range = traitlets.Any().tag(sync=True)
    _times = traitlets.Int(1).tag(sync=True)
    _transfers = traitlets.Any().tag(sync=True)

    def __init__(self, volume: Any, transfer: Any, size: Any, options: dict[str, Any]) -> None:
        refuse_unknown(
            options,
            field_names(View, Settings) | FACTS | {*_OF_SCENES, *_OF_PICTURES, "adapter"},
            "view, View, Settings or Volume",
        )
        if options.get("direction") is not None:
            raise ValueError("direction: give azimuth and elevation, which change when the volume is dragged")
        if options.get("adapter") is None:
            options = {"painter": "cpu"} | options
        # Volumes keep their size while they turn.
        options = single(options, frame="visible")
        self._options, self._pixels = options.copy(), pixels(size)
        views, settings = split(options, View, Settings)
        self._view, self._settings = View(**views), Settings(transfer=transfer, **settings)
        # Before a long conversion.
        check(self._view, self._settings, self._pixels)
        self._of_scenes, self._of_pictures = (
            {name: options.pop(name) for name in names if name in options} for names in (_OF_SCENES, _OF_PICTURES)
        )
        self._renderer = Renderer(options.pop("adapter", None))
        self._data, self._facts = volume, options
        self._held: tuple[Any, Volume] | None = None
        # The values of the scenes that are kept, and the scenes by their kinds; see `_scene`.
        self._preparing = threading.RLock()
        self._kept: tuple[Any, dict[str, Scene]] = (None, {})
        self._drawn: tuple[Any, Image] | None = None
        self._scale, self._level = 0.5, self._settings.level
        self._requesting = threading.Lock()
        self._wanted: str | None = None
        self._is_working = self._is_hearing = False
        info = native_volume(*self._source()).info()
        window = self._settings.window
        super().__init__(
            zoom=self._view.zoom,
            transfer=transfer,
            window=None if window is None else tuple(window),
            time=options.get("time") or 0,
            _times=1 if isinstance(volume, Volume) else info["times"],
            _size=self._pixels,
            _range=[0.0, 0.0] if info["transfer"] == "labels" else [info["min"], info["max"]],
            _transfers=["", *presets(), *(f"map:{name}" for name in colour_maps())],
        )
        self.azimuth, self.elevation = self._side()
        self._first = {name: getattr(self, name) for name in _CHANGED} | {"transfer": _name(transfer)}
        self.on_msg(self._hear)
        self.observe(self._change, _CHANGED)

    def image(self) -> Image:
        """Return the picture as it is when the volume rests."""
        return self._still(None)

    def options(self) -> dict[str, Any]:
        """Return the options with which `voxsplat.render` draws this view. Its studio light stands around this view."""
        chosen = {name: getattr(self, name) for name in _CHANGED if name != "time" or self._times > 1}
        return self._options | {"size": self._pixels} | chosen

    def close(self) -> None:
        """Close the widget and its renderer."""
        super().close()
        if hasattr(self, "_renderer"):
            self._renderer.close()

    def _repr_mimebundle_(self, **kwargs: Any) -> Any:
        # Notebooks keep the PNG for readers without a kernel, such as exports and forges.
        self._picture = self.image().to_png()
        data, metadata = super()._repr_mimebundle_(**kwargs) or ({}, {})
        return data | {"image/png": base64.b64encode(self._picture).decode()}, metadata

    def _side(self) -> tuple[float, float]:
        """Return the azimuth and the elevation of the first view, as requested or as suits the volume."""
        view = self._view
        self._scenes()["still"] = scene = self._scene("still")
        found = (re.match(r"azimuth (\S+), elevation (\S+) because ", choice) for choice in scene.choices)
        chosen = next((side.groups() for side in found if side), (view.azimuth or 0.0, view.elevation or 0.0))
        return float(chosen[0]), float(chosen[1])

    @traitlets.validate(*_CHANGED)
    def _validate(self, proposal: Any) -> Any:
        name, value = proposal["trait"].name, proposal["value"]
        if name == "time" and not 0 <= value < self._times:
            raise _Refused(f"time: {value}, expected 0 to {self._times - 1}")
        views, settings = split({name: value}, View, Settings)
        try:
            check(replace(self._view, **views), replace(self._settings, **settings), self._pixels)
        except (TypeError, ValueError) as fault:
            raise _Refused(str(fault)) from fault
        return value

    def _look(self) -> tuple[View, Settings]:
        """Return the view and the settings that the user chose."""
        view = replace(self._view, azimuth=self.azimuth, elevation=self.elevation, zoom=self.zoom)
        return view, replace(self._settings, transfer=self.transfer, window=self.window)

    def _source(self) -> tuple[Any, dict[str, Any]]:
        """Return the volume of the time point, and facts that it does not state."""
        facts = self._facts | ({"time": self.time} if self._times > 1 else {})
        # Bare arrays of labels have the axes of the array of the volume.
        if self._of_scenes or isinstance(self._data, Volume):
            return self._data, facts
        if self._held is None or self._held[0] != facts.get("time"):
            self._held = (facts.get("time"), Volume(self._data, **facts))
        return self._held[1], {}

    def _scenes(self) -> dict[str, Scene]:
        """Return the scenes of the values now that are kept."""
        values = (self.time, as_texts(self._look()[1]))
        if self._kept[0] != values:
            self._kept = (values, {})
        return self._kept[1]

    def _scene(self, kind: str, progress: Progress = None) -> Scene:
        """Return a new scene of still pictures, of moving ones (draft), or of moving ones without shadows (quick)."""
        settings = self._look()[1]
        volume, facts = self._source()

        def prepare(settings: Settings) -> Scene:
            # The light stands around the first view.
            given: dict[str, Any] = facts | self._of_scenes | {"size": self._pixels, "progress": progress}
            return self._renderer.prepare(volume, None, settings, self._view, **given)

        if kind == "still":
            return prepare(settings)
        # Pre-shaded light, and kernels that grow, depend on the view: each turn would filter all voxels again.
        settings = replace(settings, antialiasing=False)
        if kind == "quick":
            settings = replace(settings, shadows=False, occlusion=False)
        # X-rays are pre-shaded, and labels and channels have no cells either.
        for shading in ("post", "pre"):
            with contextlib.suppress(ValueError):
                return prepare(replace(settings, shading=shading, level=self._level))
        return prepare(settings)

    def _still(self, progress: Progress) -> Image:
        """Return the picture of the values now."""
        with self._preparing:
            view, settings = self._look()
            values = (self.time, view, as_texts(settings))
            if self._drawn is None or self._drawn[0] != values:
                scenes = self._scenes()
                if "still" not in scenes:
                    scenes["still"] = self._scene("still", progress)
                self._drawn = (values, self._picture_of(scenes["still"], 1.0, progress))
            return self._drawn[1]

    def _picture_of(self, scene: Scene, scale: float, progress: Progress = None) -> Image:
        """Return a picture of a scene; `scale` is the share of the sides."""
        width, height = (max(1, round(scale * side)) for side in self._pixels)
        view, _ = self._look()
        return self._renderer.render(scene, view, size=(width, height), progress=progress, **self._of_pictures)

    def _hear(self, _: Any, content: dict[str, Any], __: Any) -> None:
        """Take the values of a message of the front end, and draw them."""
        self._is_hearing = True
        try:
            with self.hold_sync():
                for name in _CHANGED:
                    if name in content:
                        value = content[name]
                        setattr(self, name, self._transfer_of(value) if name == "transfer" else value)
        except traitlets.TraitError as fault:
            self.send({"error": str(fault)})
            return
        finally:
            self._is_hearing = False
        self._request("moving" if content.get("moving") else "still")

    def _transfer_of(self, name: str) -> Any:
        """Return the transfer function of a name of the front end. The empty one is the given one, or the default."""
        given = self._settings.transfer
        return name or (None if isinstance(given, str) else given)

    def _change(self, _: Any) -> None:
        """Draw the values that Python or another widget has set."""
        if not self._is_hearing:
            self._request("still")

    def _request(self, wanted: str) -> None:
        """Request a picture of the values now, in place of requested ones that are not drawn."""
        with self._requesting:
            self._wanted = wanted
            if not self._is_working:
                self._is_working = True
                # Ends with the last request, so that it keeps no interpreter from ending.
                threading.Thread(target=self._work, name="voxsplat.view").start()

    def _work(self) -> None:
        """Draw requested pictures until there is no request."""
        while True:
            with self._requesting:
                wanted, self._wanted = self._wanted, None
                if wanted is None:
                    self._is_working = False
                    return
            try:
                self._draw(wanted)
            except _Overtaken:
                pass
            except Exception as fault:
                self.send({"error": str(fault)})

    def _overtake(self, *_: Any) -> None:
        """End the work on a picture if a newer one is requested: a callback for progress."""
        if self._wanted is not None:
            raise _Overtaken

    def _draw(self, wanted: str) -> None:
        """Draw a requested picture and send it."""
        if wanted == "still":
            self._picture = self._still(self._overtake).to_png()
            self.send({})
            self._make_draft()
            return
        with self._preparing:
            scenes = self._scenes()
            if not scenes.keys() & {"draft", "quick"}:
                scenes["quick"] = self._scene("quick")
            began = time.perf_counter()
            png = self._picture_of(scenes.get("draft") or scenes["quick"], self._scale).to_png()
        # Time grows with the number of pixels.
        factor = (_SECONDS / (time.perf_counter() - began)) ** 0.5
        self._scale = min(max(self._scale * min(max(factor, 0.5), 2.0), _LEAST), 1.0)
        self.send({"moving": True}, [png])

    def _make_draft(self) -> None:
        """Make the scene of the next moving pictures while the volume rests, with its shadows."""
        with self._preparing:
            scenes = self._scenes()
            if "draft" in scenes:
                return
            if "quick" not in scenes:
                scenes["quick"] = self._quick()
            draft = self._scene("draft", self._overtake)
            self._picture_of(draft, _LEAST, self._overtake)
            scenes["draft"] = draft
            scenes.pop("quick")

    def _quick(self) -> Scene:
        """Return a scene of moving pictures without shadows. Chooses the level of moving pictures."""
        quick = self._scene("quick", self._overtake)
        self._picture_of(quick, _LEAST, self._overtake)
        began = time.perf_counter()
        self._picture_of(quick, _LEAST, self._overtake)
        # Time grows with the number of voxels too.
        if self._level != "auto" or time.perf_counter() - began < _SECONDS:
            return quick
        self._level = 1
        return self._scene("quick", self._overtake)
