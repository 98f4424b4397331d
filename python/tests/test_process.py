"""Threads, signals, forks and the cost of an import."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import time
from typing import Any

import numpy as np
import pytest
import voxsplat as vs
from conftest import samples


def python(code: str, **options: Any) -> subprocess.CompletedProcess[str]:
    return subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False, timeout=60, **options)


def test_an_import_is_quick_and_opens_no_device() -> None:
    code = """
import os, time
import numpy
started = time.perf_counter()
import voxsplat
took = time.perf_counter() - started
maps = open("/proc/self/maps").read()
assert "libvulkan" not in maps, "a driver was loaded"
print(took, len(os.listdir("/proc/self/task")))
"""
    runs = [python(code) for _ in range(5)]
    assert all(run.returncode == 0 for run in runs), runs[0].stderr
    took = min(float(run.stdout.split()[0]) for run in runs)
    # Beside 0.1 s of NumPy, for 0.15 s together. The best of five, because the machine may be busy.
    assert took < 0.05


def test_without_a_driver_the_first_picture_says_what_to_install() -> None:
    code = """
import numpy, voxsplat
try:
    voxsplat.render(numpy.random.rand(4, 4, 4), size=8)
except voxsplat.DeviceError as error:
    print(error)
"""
    done = python(code, env={**os.environ, "VK_DRIVER_FILES": "/none.json", "VK_ICD_FILENAMES": "/none.json"})
    assert "apt-get install mesa-vulkan-drivers" in done.stdout, done.stdout + done.stderr
    assert done.stdout.count("\n") == 1


LONG = """
import threading, time, numpy, voxsplat
volume = numpy.random.default_rng(1).random((160, 160, 160), dtype=numpy.float32)
options = dict(size=(3000, 3000), transfer="grayscale", shading="post", painter="quads", light=False)
"""


def test_ctrl_c_ends_a_long_picture_within_a_second() -> None:
    # A shell that runs the tests in the background has interrupts ignored.
    code = LONG + """
import signal
signal.signal(signal.SIGINT, signal.default_int_handler)
try:
    print("drawing", flush=True)
    voxsplat.render(volume, **options)
    print("done", flush=True)
except KeyboardInterrupt:
    print("interrupted", flush=True)
"""
    process = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    assert process.stdout.readline() == "drawing\n"
    time.sleep(2)
    sent = time.perf_counter()
    process.send_signal(signal.SIGINT)
    assert process.stdout.readline() == "interrupted\n"
    assert time.perf_counter() - sent < 1
    # The work ends at its next report, and then the process.
    assert process.wait(40) == 0


def test_others_run_while_a_picture_is_drawn() -> None:
    volume = np.random.default_rng(1).random((96, 96, 96), dtype=np.float32)
    waits: list[float] = []
    done = threading.Event()

    def tick() -> None:
        last = time.perf_counter()
        while not done.is_set():
            time.sleep(0.005)
            now = time.perf_counter()
            waits.append(now - last)
            last = now

    thread = threading.Thread(target=tick)
    thread.start()
    started = time.perf_counter()
    vs.render(volume, "grayscale", size=800, shading="post")
    took = time.perf_counter() - started
    done.set()
    thread.join()
    # With the lock of the interpreter held, the longest wait would be nearly all of it.
    assert max(waits) < 0.5 * took
    assert len(waits) > 5


def test_threads_draw_with_a_renderer_each() -> None:
    options = {"size": 48, "frame": "visible"}
    expected = [np.asarray(vs.render(samples(), "ct-bone", azimuth=40 * number, **options)) for number in range(4)]
    drawn: dict[int, np.ndarray] = {}

    def draw(number: int) -> None:
        with vs.Renderer() as renderer:
            scene = renderer.prepare(samples(), "ct-bone", view=vs.View(azimuth=40 * number))
            for _ in range(3):
                drawn[number] = np.asarray(renderer.render(scene, size=48))

    threads = [threading.Thread(target=draw, args=(number,)) for number in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert all(np.array_equal(drawn[number], expected[number]) for number in range(4))


def test_threads_share_a_renderer_in_turn() -> None:
    drawn: list[np.ndarray] = []
    with vs.Renderer() as renderer:
        scene = renderer.prepare(samples(), "ct-bone")
        work = [threading.Thread(target=lambda: drawn.append(np.asarray(renderer.render(scene, size=48)))) for _ in "1234"]
        for thread in work:
            thread.start()
        for thread in work:
            thread.join()
    assert len(drawn) == 4
    assert all(np.array_equal(picture, drawn[0]) for picture in drawn)


@pytest.mark.skipif(not hasattr(os, "fork"), reason="there is no fork here")
def test_a_fork_after_a_picture_is_an_error_and_no_hang() -> None:
    code = """
import os, sys, warnings, numpy, voxsplat
warnings.simplefilter("ignore")
renderer = voxsplat.Renderer()
scene = renderer.prepare(numpy.random.rand(8, 8, 8))
voxsplat.render(numpy.random.rand(8, 8, 8), size=8)
for work in (lambda: voxsplat.render(numpy.random.rand(8, 8, 8), size=8), lambda: renderer.render(scene, size=8),
             lambda: voxsplat.info(numpy.zeros((3, 3, 3))), renderer.close):
    child = os.fork()
    if child == 0:
        try:
            work()
        except voxsplat.DeviceError as error:
            print(error, flush=True)
        # As multiprocessing ends its processes: the exit handlers of Mesa's driver do not survive a fork.
        os._exit(0)
    assert os.waitpid(child, 0)[1] == 0
"""
    done = python(code)
    assert done.returncode == 0, done.stderr
    assert done.stdout.count('multiprocessing.get_context("spawn")') == 3
