"""The widget of notebooks: its kernel side driven by messages, and, slow, in a browser."""

from __future__ import annotations

import base64
import contextlib
import os
import secrets
import shutil
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import nibabel
import numpy as np
import pytest
import traitlets
import voxsplat as vs
from conftest import samples
from voxsplat.notebook import Viewer

PNG = b"\x89PNG\r\n"
SIZE = (96, 80)
# A side that no choice of the library has.
VIEW = {"azimuth": 40.0, "elevation": 10.0}


class FrontEnd:
    """A front end that keeps what the kernel sends."""

    def __init__(self, widget: Viewer) -> None:
        self.widget = widget
        self.heard: list[tuple[dict[str, Any], Any]] = []
        widget.send = lambda content, buffers=None: self.heard.append((content, buffers))  # type: ignore[method-assign]

    def ask(self, **content: Any) -> tuple[dict[str, Any], Any]:
        """Send a message, and return the answer."""
        self.widget._handle_custom_msg(content, [])
        return self.rest()

    def rest(self) -> tuple[dict[str, Any], Any]:
        """Wait until nothing is drawn, and return the last answer."""
        while self.widget._is_working:
            time.sleep(0.01)
        return self.heard[-1]


def width(png: bytes) -> int:
    assert png.startswith(PNG)
    return int.from_bytes(png[16:20], "big")


def test_the_picture_is_the_one_of_render(scan: Path) -> None:
    widget = vs.view(scan, size=SIZE, **VIEW)
    whole = vs.render(scan, size=SIZE, frame="visible", painter="cpu", **VIEW)
    assert np.array_equal(widget.image(), whole)
    assert np.array_equal(vs.render(scan, **widget.options()), whole)
    front = FrontEnd(widget)
    assert front.ask(moving=False) == ({}, None)
    assert widget._picture == whole.to_png()


def test_dragging_turns_the_volume(scan: Path) -> None:
    # At a level of its own, as the machine may be too slow for the default.
    widget = vs.view(scan, size=SIZE, light=False, level=0)
    front = FrontEnd(widget)
    content, buffers = front.ask(azimuth=75.0, elevation=-20.0, zoom=1.5, moving=True)
    assert content == {"moving": True} and width(buffers[0]) <= SIZE[0]
    assert (widget.azimuth, widget.elevation, widget.zoom) == (75, -20, 1.5)
    front.ask(moving=False)
    options = {"size": SIZE, "light": False, "frame": "visible", "painter": "cpu", "level": 0}
    turned = vs.render(scan, azimuth=75, elevation=-20, zoom=1.5, **options)
    assert widget._picture == turned.to_png()
    # The scene of moving pictures shows the same view.
    moving = widget._picture_of(widget._scenes()["draft"], 1.0)
    # Neither light nor kernels depend on the view, so a turn filters nothing.
    assert moving.stats["shading"] == "post" and moving.stats["kernel_growth"] == 1
    other = vs.render(scan, azimuth=-75, elevation=-20, zoom=1.5, **options)
    errors = [np.abs(np.asarray(moving) - np.asarray(picture)).mean() for picture in (turned, other)]
    assert errors[0] < 0.3 * errors[1]


def test_studio_light_keeps_its_place(scan: Path) -> None:
    widget = vs.view(scan, "ct-bone", size=SIZE, light="studio", **VIEW)
    widget.azimuth = 120
    with vs.Renderer() as renderer:
        settings = vs.Settings(light="studio", painter="cpu")
        scene = renderer.prepare(scan, "ct-bone", settings, vs.View(**VIEW), size=SIZE)
        turned = renderer.render(scene, azimuth=120, elevation=10, frame="visible", size=SIZE)
    assert np.array_equal(widget.image(), turned)


def test_the_side_is_the_one_that_suits_the_volume(scan: Path) -> None:
    for volume, side in [(scan, (0, 0)), (samples(), (30, 20)), ("demo:nautilus:24", (22, 12))]:
        widget = vs.view(volume, size=32)
        assert (widget.azimuth, widget.elevation) == side
        assert np.array_equal(widget.image(), vs.render(volume, size=32, frame="visible", painter="cpu"))


def test_looks_are_changed_from_both_sides(scan: Path) -> None:
    points = [(10, "red", 0.0), (60, "white", 0.5)]
    widget = vs.view(scan, points, size=SIZE, **VIEW)
    front = FrontEnd(widget)
    options: dict[str, Any] = VIEW | {"size": SIZE, "frame": "visible", "painter": "cpu"}
    assert "quick" not in widget._scenes()
    content, _ = front.ask(window=[50, 60], moving=True)
    assert content == {"moving": True} and widget.window == (50, 60)
    front.ask(moving=False)
    assert widget._picture == vs.render(scan, points, window=(50, 60), **options).to_png()
    front.ask(transfer="map:viridis", moving=False)
    assert widget._picture == vs.render(scan, "map:viridis", window=(50, 60), **options).to_png()
    # The empty name is the transfer function that was given.
    front.ask(transfer="", window=None, moving=False)
    assert widget.transfer == points
    assert widget._picture == vs.render(scan, points, **options).to_png()
    widget.transfer = "map:magma"
    front.rest()
    assert widget._picture == vs.render(scan, "map:magma", **options).to_png()


def test_time_points_have_a_slider(tmp_path: Path) -> None:
    array = samples().transpose(2, 1, 0)
    path = tmp_path / "times.nii"
    nibabel.save(nibabel.Nifti1Image(np.stack([array, array[::-1]], axis=-1), np.eye(4)), path)
    widget = vs.view(path, size=SIZE)
    assert widget._times == 2
    FrontEnd(widget).ask(time=1, moving=False)
    assert np.array_equal(widget.image(), vs.render(path, time=1, size=SIZE, frame="visible", painter="cpu"))
    assert np.array_equal(widget.image(), vs.render(path, **widget.options()))
    with pytest.raises(ValueError, match="time: 2, expected 0 to 1"):
        widget.time = 2
    assert widget.time == 1 and vs.view(samples(), size=16)._times == 1


def test_labels_masks_overlays_and_x_rays_turn_too(scan: Path) -> None:
    labels = (samples() > 40).astype(np.uint8)
    cases: list[dict[str, Any]] = [
        {"labels": labels},
        {"mask": labels, "axes": "zyx"},
        {"overlays": labels.astype(np.float32)},
        {"model": "xray"},
        {"model": "mip"},
        {"iso": 40},
        {"meshes": (np.array([[0, 0, 0], [30, 0, 0], [0, 20, 0]], np.float32), np.array([[0, 1, 2]]))},
    ]
    for options in cases:
        widget = vs.view(samples(), size=32, **options)
        front = FrontEnd(widget)
        for widget._level in ("auto", 1):
            widget._kept[1].clear()
            content, buffers = front.ask(azimuth=10, moving=True)
            assert content == {"moving": True} and 8 <= width(buffers[0]) <= 32
        widget = vs.view(samples(), size=32, **options)
        assert np.array_equal(widget.image(), vs.render(samples(), size=32, frame="visible", painter="cpu", **options))


def test_newer_values_overtake_a_still_picture(scan: Path) -> None:
    widget = vs.view(scan, size=SIZE, **VIEW)
    front = FrontEnd(widget)
    still, stages = widget._still, []

    def interrupted(progress: Any) -> vs.Image:
        def report(stage: str, done: float) -> None:
            if not stages:
                widget._handle_custom_msg({"azimuth": 90, "moving": True}, [])
            stages.append(stage)
            progress(stage, done)

        return still(report)

    widget._still = interrupted  # type: ignore[method-assign]
    widget._drawn = None
    assert front.ask(azimuth=50, moving=False)[0] == {"moving": True}
    assert [content for content, _ in front.heard] == [{"moving": True}] and len(stages) == 1
    assert widget.azimuth == 90


def test_a_widget_is_a_png_without_a_front_end(scan: Path) -> None:
    widget = vs.view(scan, size=SIZE)
    data, _ = widget._repr_mimebundle_()
    assert base64.b64decode(data["image/png"]) == widget.image().to_png()
    assert data["application/vnd.jupyter.widget-view+json"]["model_id"] == widget.model_id


def test_bad_values_are_refused(scan: Path) -> None:
    widget = vs.view(scan, size=16)
    for name, value, message in [
        ("zoom", 0, "zoom"),
        ("azimuth", float("nan"), "azimuth"),
        ("transfer", "ct-bonne", "ct-bone"),
        ("transfer", 5, "transfer"),
        ("window", (1, 0), "width"),
    ]:
        before = getattr(widget, name)
        with pytest.raises(ValueError, match=message):
            setattr(widget, name, value)
        assert getattr(widget, name) == before
    with pytest.raises(traitlets.TraitError, match="elevation"):
        widget.elevation = "up"
    assert "zoom" in FrontEnd(widget).ask(zoom=-1, moving=False)[0]["error"]
    for options, error, message in [
        ({"azimut": 3}, TypeError, "azimuth"),
        ({"region": (0, 0, 8, 8)}, TypeError, "region"),
        ({"direction": (0, 1, 0)}, ValueError, "azimuth and elevation"),
        ({"size": 0}, ValueError, "size"),
        ({"zoom": -1}, ValueError, "zoom"),
    ]:
        with pytest.raises(error, match=message):
            vs.view(scan, **options)
    with pytest.raises(OSError):
        vs.view("none.nii")
    with pytest.raises(TypeError, match="no volume"):
        vs.view(None)


def test_errors_are_shown(scan: Path, tmp_path: Path) -> None:
    path = tmp_path / "gone.nii"
    path.write_bytes(scan.read_bytes())
    widget = vs.view(path, size=16)
    front = FrontEnd(widget)
    path.unlink()
    content, _ = front.ask(transfer="ct-bone", moving=False)
    assert "gone.nii" in content["error"]
    widget.close()
    with pytest.raises(ValueError, match="closed"):
        widget.image()


def test_the_package_needs_no_anywidget() -> None:
    code = "import sys; sys.modules['anywidget'] = None; from voxsplat import *; view('demo:nautilus')"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    line = "ImportError: voxsplat.view needs anywidget: pip install 'voxsplat[notebook]'"
    assert done.stderr.splitlines()[-1] == line


def test_a_program_ends_while_a_picture_is_drawn(scan: Path) -> None:
    code = f"import voxsplat as vs; w = vs.view({str(scan)!r}, size=200); w.azimuth = 5; print(w.azimuth)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False, timeout=300)
    assert (done.returncode, done.stdout, done.stderr) == (0, "5.0\n", "")


def write(path: Path, code: str) -> None:
    """Write a notebook of one cell."""
    import nbformat

    kernel = {"name": "python3", "display_name": "Python 3", "language": "python"}
    cells = [nbformat.v4.new_code_cell(code)]
    nbformat.write(nbformat.v4.new_notebook(cells=cells, metadata={"kernelspec": kernel}), path)


def surroundings(folder: Path) -> dict[str, str]:
    """The environment of programs of Jupyter, with their settings in a folder and the package of the tests."""
    names = ("HOME", "IPYTHONDIR", "JUPYTER_CONFIG_DIR", "JUPYTER_DATA_DIR", "JUPYTER_RUNTIME_DIR")
    own = {name: str(folder / "home") for name in names} | {"PYTHONPATH": str(Path(vs.__file__).parents[1])}
    return os.environ | own


@contextlib.contextmanager
def jupyter(folder: Path) -> Iterator[str]:
    """A JupyterLab on this machine, with files and settings in a folder: yields the address of its notebook."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    options = [f"--ServerApp.root_dir={folder}", f"--ServerApp.port={port}", "--ServerApp.port_retries=0"]
    token = secrets.token_hex()
    options += [f"--IdentityProvider.token={token}", "--LabApp.news_url=None", "--LabApp.extension_manager=readonly"]
    words = [sys.executable, "-m", "jupyterlab", "--no-browser", "--allow-root", *options]
    quiet: dict[str, Any] = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    with subprocess.Popen(words, env=surroundings(folder), **quiet) as server:
        try:
            yield f"http://127.0.0.1:{port}/lab/tree/view.ipynb?token={token}"
        finally:
            server.terminate()


@contextlib.contextmanager
def notebook(folder: Path, code: str) -> Iterator[Any]:
    """A page of Chromium that has run a notebook of one cell."""
    from playwright.sync_api import sync_playwright

    write(folder / "view.ipynb", code)
    chromium = shutil.which("chromium") or shutil.which("google-chrome")
    flags = ["--no-sandbox", "--disable-gpu", "--disable-background-networking", "--disable-component-update"]
    with jupyter(folder) as address, sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=chromium, args=[*flags, "--disable-sync"])
        page = browser.new_page(viewport={"width": 1200, "height": 1000})
        page.set_default_timeout(120_000)
        # The server takes seconds to start.
        for _ in range(100):
            with contextlib.suppress(Exception):
                page.goto(address)
                break
            time.sleep(0.3)
        page.locator(".jp-Cell .cm-content").first.click()
        page.wait_for_selector(".jp-Notebook-ExecutionIndicator[data-status=idle]")
        page.keyboard.press("Shift+Enter")
        page.wait_for_selector(".voxsplat img")
        yield page
        browser.close()


class Page:
    """The widget in a page, with the mouse on it."""

    def __init__(self, page: Any) -> None:
        self.page, self.picture = page, page.locator(".voxsplat img")
        # Widths of the pictures that came.
        page.evaluate("""() => {
            window.widths = [];
            const picture = document.querySelector(".voxsplat img");
            picture.addEventListener("load", () => widths.push(picture.naturalWidth));
        }""")

    def point(self, x: float, y: float) -> None:
        box = self.picture.bounding_box()
        self.page.mouse.move(box["x"] + x, box["y"] + y)

    def rest(self, png: bytes) -> None:
        """Wait until the page shows a picture, byte by byte."""
        self.page.wait_for_function("""async (expected) => {
            const bytes = await (await fetch(document.querySelector(".voxsplat img").src)).arrayBuffer();
            return btoa(String.fromCharCode(...new Uint8Array(bytes))) === expected;
        }""", arg=base64.b64encode(png).decode(), polling=100)


@pytest.mark.slow
def test_volumes_turn_in_a_browser(scan: Path, tmp_path: Path) -> None:
    options: dict[str, Any] = {"size": (200, 160), "frame": "visible", "painter": "cpu", "light": False}

    def png(**look: Any) -> bytes:
        return vs.render(scan, **(options | {"azimuth": 0, "elevation": 0} | look)).to_png()

    code = f"import voxsplat\nwidget = voxsplat.view({str(scan)!r}, size=(200, 160), light=False)\nwidget"
    with notebook(tmp_path, code) as page:
        view = Page(page)
        view.rest(png())
        before = view.picture.screenshot()
        # The width of the picture is half a turn, and matter in front follows the mouse.
        view.point(50, 80)
        page.mouse.down()
        for x in range(60, 101, 10):
            view.point(x, 80)
        page.wait_for_function("widths.some((width) => width < 200)")
        view.rest(png(azimuth=-45))
        view.point(100, 100)
        page.mouse.up()
        view.rest(png(azimuth=-45, elevation=18))
        assert view.picture.screenshot() != before
        page.mouse.wheel(0, -100)
        view.rest(png(azimuth=-45, elevation=18, zoom=1.001**100))
        page.locator(".voxsplat select").select_option("map:viridis")
        view.rest(png(azimuth=-45, elevation=18, zoom=1.001**100, transfer="map:viridis"))
        view.picture.dblclick()
        view.rest(png())
        view.picture.press("ArrowLeft")
        view.rest(png(azimuth=15))
        # The other cell sets values, and reads the ones of the user.
        page.locator(".jp-Cell .cm-content").last.click()
        page.keyboard.type("widget.elevation = widget.azimuth + 5; widget.window = (50, 40)")
        page.keyboard.press("Shift+Enter")
        view.rest(png(azimuth=15, elevation=20, window=(50, 40)))
        page.locator(".voxsplat input").first.press("ArrowRight")
        level = page.locator(".voxsplat input").first.input_value()
        view.rest(png(azimuth=15, elevation=20, window=(float(level), 40)))
        assert page.locator(".voxsplat [role=alert]").inner_text() == ""


@pytest.mark.slow
def test_exports_show_the_picture(scan: Path, tmp_path: Path) -> None:
    write(tmp_path / "view.ipynb", f"import voxsplat\nvoxsplat.view({str(scan)!r}, size=64, light=False)")
    export = [sys.executable, "-m", "nbconvert", "--execute", "--to", "html", "--output", "view.html"]
    for stored in ("True", "False"):
        words = [*export, f"--ExecutePreprocessor.store_widget_state={stored}", tmp_path / "view.ipynb"]
        subprocess.run(words, env=surroundings(tmp_path), check=True, capture_output=True, timeout=600)
        png = vs.render(scan, size=64, light=False, frame="visible", painter="cpu").to_png()
        page = (tmp_path / "view.html").read_text().replace("\\/", "/")
        assert base64.b64encode(png).decode() in page.replace("\n", "")
