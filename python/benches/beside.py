"""From an array in memory to a PNG: voxsplat beside other packages.

    python python/benches/beside.py            # prints a table; each package draws in a process of its own
    python python/benches/beside.py --size 128 --out /tmp/pictures

The same volume (a shell with waves, u8), transfer function, orthographic view and size for all, without light. Only
napari needs a display, such as the one of `xvfb-run -a python ...`. A frame turns the volume by 10 degrees and writes a
PNG. The packages need not be installed: `-`.
"""

from __future__ import annotations

import argparse
import inspect
import json
import resource
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np

# Value, colour, and opacity of a slab as thick as a voxel.
POINTS = [(40, (0.1, 0.2, 0.6), 0.0), (90, (0.2, 0.6, 0.8), 0.02), (150, (0.95, 0.8, 0.4), 0.05), (230, (1.0, 0.4, 0.2), 0.4)]
PICTURE = (512, 512)


def volume(size: int) -> np.ndarray[Any, Any]:
    """A shell with waves of `size`^3 samples, (z, y, x)."""
    line = np.linspace(-1, 1, size, dtype=np.float32)
    z, y, x = line[:, None, None], line[None, :, None], line[None, None, :]
    radius = np.sqrt(x**2 + y**2 + z**2) + 0.06 * np.sin(9 * x) * np.sin(9 * y) * np.sin(9 * z)
    return (255 * np.exp(-(((radius - 0.7) / 0.16) ** 2))).astype(np.uint8)


def voxsplat(array: Any, names: list[str]) -> Any:
    import voxsplat

    renderer = voxsplat.Renderer()
    scene = renderer.prepare(array, POINTS, light=False, sharpness=0)
    for frame, name in enumerate(names):
        view = voxsplat.View(azimuth=10 * frame, elevation=20, view_height=len(array))
        renderer.render(scene, view, size=PICTURE).save(name)
        yield


def pyvista(array: Any, names: list[str], mapper: str = "smart") -> Any:
    import pyvista
    from vtkmodules.vtkCommonDataModel import vtkPiecewiseFunction
    from vtkmodules.vtkRenderingCore import vtkColorTransferFunction

    grid = pyvista.ImageData(dimensions=array.shape[::-1])
    grid["values"] = array.ravel()
    plotter = pyvista.Plotter(off_screen=True, window_size=PICTURE)
    actor = plotter.add_volume(grid, shade=False, show_scalar_bar=False, mapper=mapper)
    actor.prop.interpolation_type = "linear"
    color, opacity = vtkColorTransferFunction(), vtkPiecewiseFunction()
    for value, rgb, alpha in POINTS:
        color.AddRGBPoint(value, *rgb)
        opacity.AddPoint(value, alpha)
    actor.prop.SetColor(color)
    actor.prop.SetScalarOpacity(opacity)
    plotter.background_color = "black"
    plotter.enable_parallel_projection()
    plotter.view_xz()
    plotter.camera.elevation = 20
    plotter.camera.parallel_scale = len(array) / 2
    plotter.show(auto_close=False)
    for name in names:
        plotter.render()
        plotter.screenshot(name)
        yield
        plotter.camera.Azimuth(10)


def pyvista_fixed_point(array: Any, names: list[str]) -> Any:
    """VTK's ray caster on the processor."""
    yield from pyvista(array, names, mapper="fixed_point")


def vedo(array: Any, names: list[str]) -> Any:
    import vedo

    vedo.settings.use_parallel_projection = True
    shown = vedo.Volume(np.ascontiguousarray(array.transpose(2, 1, 0)))
    shown.color([(value, rgb) for value, rgb, _ in POINTS]).alpha([(value, alpha) for value, _, alpha in POINTS])
    shown.properties.ShadeOff()
    plotter = vedo.Plotter(offscreen=True, size=PICTURE, bg="black")
    plotter.show(shown, viewup="z", azimuth=0, elevation=-70)
    plotter.camera.SetParallelScale(len(array) / 2)
    for name in names:
        plotter.render()
        plotter.screenshot(name)
        yield
        plotter.azimuth(10)


# Its canvas needs a display, such as Xvfb, and a window that is shown: others are black.
def napari(array: Any, names: list[str]) -> Any:
    import napari

    values = np.array([0, *(value for value, _, _ in POINTS), 255])
    colors = np.array([(*rgb, alpha) for _, rgb, alpha in (POINTS[0], *POINTS, POINTS[-1])])
    viewer = napari.Viewer(ndisplay=3)
    colormap = napari.utils.Colormap(colors, controls=values / 255)
    viewer.add_image(array, rendering="translucent", colormap=colormap, contrast_limits=(0, 255))
    viewer.camera.zoom = PICTURE[1] / len(array)
    for frame, name in enumerate(names):
        turn, lift = np.radians((10 * frame, 20))
        ahead = (-np.sin(lift), np.cos(lift) * np.cos(turn), -np.cos(lift) * np.sin(turn))
        viewer.camera.set_view_direction(ahead, (1, 0, 0))
        viewer.screenshot(name, size=PICTURE[::-1], scale=1, flash=False)
        yield


def yt(array: Any, names: list[str]) -> Any:
    import yt

    yt.set_log_level("error")
    data = {("stream", "value"): array.transpose(2, 1, 0).astype(float)}
    scene = yt.create_scene(yt.load_uniform_grid(data, data["stream", "value"].shape), ("stream", "value"), "plane-parallel")
    function = yt.ColorTransferFunction((0, 255), grey_opacity=True)
    values, colors, opacities = zip(*POINTS, strict=True)
    # Per length of the box, which is 1.
    extinction = -np.log1p(-np.interp(function.alpha.x, values, opacities)) * len(array)
    function.alpha.y = extinction
    for channel, of_points in zip((function.red, function.green, function.blue), zip(*colors, strict=True), strict=True):
        channel.y = np.interp(channel.x, values, of_points) * extinction
    scene[0].set_log(False)
    scene[0].transfer_function = function
    scene.camera.resolution = PICTURE
    scene.camera.width = 1
    for frame, name in enumerate(names):
        turn, lift = np.radians((10 * frame, 20))
        ahead = (-np.cos(lift) * np.sin(turn), np.cos(lift) * np.cos(turn), -np.sin(lift))
        scene.camera.switch_orientation(ahead, (0, 0, 1))
        scene.save(name, sigma_clip=None)
        yield


PACKAGES = (voxsplat, pyvista, pyvista_fixed_point, vedo, napari, yt)


def measure(package: Any, size: int, frames: int, out: Path) -> dict[str, Any]:
    array = volume(size)
    names = [str(out / f"{package.__name__}-{frame}.png") for frame in range(frames + 1)]
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    times, last = [], time.perf_counter()
    try:
        for _ in package(array, names):
            now = time.perf_counter()
            times.append(now - last)
            last = now
    except ImportError:
        return {"package": package.__name__}
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    name = package.__name__.split("_")[0]
    code = inspect.getsource(globals()[name]).splitlines()[1:]
    code = [line for line in code if line.strip() and line.strip() != "yield"]
    return {
        "package": package.__name__,
        "version": sys.modules[name].__version__,
        "first": times[0],
        "next": statistics.median(times[1:]),
        "memory": (peak - before) / 1024,
        "lines": len(code),
    }


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--size", type=int, default=256)
    parser.add_argument("--frames", type=int, default=8)
    parser.add_argument("--runs", type=int, default=3)
    parser.add_argument("--out", type=Path)
    parser.add_argument("--one", help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    out = arguments.out or Path(tempfile.mkdtemp())
    out.mkdir(parents=True, exist_ok=True)
    if arguments.one:
        package = next(package for package in PACKAGES if package.__name__ == arguments.one)
        print(json.dumps(measure(package, arguments.size, arguments.frames, out)))
        return
    runs: dict[str, list[dict[str, Any]]] = {package.__name__: [] for package in PACKAGES}
    # In alternation, so that a busy machine is busy for all.
    for _ in range(arguments.runs):
        for name in runs:
            words = [sys.executable, __file__, "--one", name, "--size", arguments.size, "--frames", arguments.frames]
            done = subprocess.run([*map(str, words), "--out", str(out)], capture_output=True, text=True, check=False)
            lines = [line for line in done.stdout.splitlines() if line.startswith("{")]
            runs[name].append(json.loads(lines[-1]) if lines else {"package": name, "fault": done.stderr[-200:]})
    print(f"{arguments.size}^3 u8, {PICTURE[0]} x {PICTURE[1]} pixels, medians of {arguments.runs} processes\n")
    print("| package | first picture with import, s | next picture, s | memory above the array, MiB | lines |")
    print("|---|---|---|---|---|")
    for name, made in runs.items():
        if "first" not in made[0]:
            print(f"| {name} | - | - | - | - |", made[0].get("fault", ""))
            continue
        first, following, memory = (statistics.median(run[key] for run in made) for key in ("first", "next", "memory"))
        print(f"| {name} {made[0]['version']} | {first:.2f} | {following:.3f} | {memory:.0f} | {made[0]['lines']} |")


if __name__ == "__main__":
    main()
