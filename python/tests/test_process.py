"""Threads, signals, forks and the cost of an import."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
from typing import Any

import numpy as np
import pytest
import voxsplat as vs
from conftest import samples


# Seconds after which a test has failed, so that nothing hangs; no test needs a part of it.
LIMIT = 600


def python(code: str, **options: Any) -> subprocess.CompletedProcess[str]:
    return subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False, timeout=LIMIT, **options)


def test_an_import_loads_little_and_opens_no_device() -> None:
    code = """
import os, sys
import voxsplat
assert "numpy" not in sys.modules and "render" in dir(voxsplat)
import numpy
before, tasks = set(sys.modules), len(os.listdir("/proc/self/task"))
voxsplat.render
new = {name for name in set(sys.modules) - before if name.split(".")[0] not in ("numpy", "voxsplat")}
print(sorted(name for name in new if name.split(".")[0] not in sys.stdlib_module_names))
print(len(new), len(os.listdir("/proc/self/task")) - tasks)
assert "libvulkan" not in open("/proc/self/maps").read(), "a driver was loaded"
"""
    done = python(code)
    assert done.returncode == 0, done.stderr
    others, counts = done.stdout.splitlines()
    assert others == "[]"
    modules, threads = map(int, counts.split())
    # Of the standard library: json, dataclasses and a few more.
    assert modules < 30
    assert threads == 0


def test_names_are_imported_when_they_are_used() -> None:
    assert all(getattr(vs, name) is not None for name in vs.__all__)
    assert set(vs.__all__) <= set(dir(vs))
    with pytest.raises(AttributeError, match="has no attribute 'rendr'"):
        vs.rendr


def test_without_a_driver_the_processor_draws_and_a_painter_of_devices_says_what_to_install() -> None:
    code = """
import numpy, voxsplat
image = voxsplat.render(numpy.random.rand(4, 4, 4), size=8)
assert image.stats["painter"]["name"] == "cpu", image.stats
try:
    voxsplat.render(numpy.random.rand(4, 4, 4), size=8, painter="tiles")
except voxsplat.DeviceError as error:
    print(error)
"""
    done = python(code, env={**os.environ, "VK_DRIVER_FILES": "/none.json", "VK_ICD_FILENAMES": "/none.json"})
    assert "apt-get install mesa-vulkan-drivers" in done.stdout, done.stdout + done.stderr
    assert done.stdout.count("\n") == 1


def test_messages_of_drivers_are_left_out_and_others_stay() -> None:
    code = """
import os, sys, threading
import numpy, voxsplat
written, done = [], threading.Event()
def write():
    while not done.wait(0.0005):
        written.append(len(written))
        os.write(2, b"error: line %d\\n" % written[-1])
thread = threading.Thread(target=write)
thread.start()
voxsplat.adapters()
volume = numpy.random.default_rng(1).random((8, 8, 8))
draw = lambda: voxsplat.render(volume, "grayscale", size=8)
others = [threading.Thread(target=draw) for _ in range(3)]
for other in others: other.start()
draw()
for other in others: other.join()
done.set()
thread.join()
print(len(written))
print("the end", file=sys.stderr)
"""
    done = python(code, env={name: value for name, value in os.environ.items() if name != "XDG_RUNTIME_DIR"})
    assert done.returncode == 0, done.stderr
    *lines, last = done.stderr.splitlines()
    # A line that is written at the end of a redirection may overtake the line before it.
    assert sorted(lines) == sorted(f"error: line {number}" for number in range(int(done.stdout)))
    assert last == "the end"


def test_ctrl_c_ends_a_picture_before_it_is_drawn() -> None:
    # A shell that runs the tests in the background has interrupts ignored. Another thread sends the signal, because in
    # a callback it would be an exception of the callback.
    code = """
import os, signal, threading, numpy, voxsplat
signal.signal(signal.SIGINT, signal.default_int_handler)
volume = numpy.random.default_rng(1).random((160, 160, 160), dtype=numpy.float32)
begun, calls = threading.Event(), []
def report(stage, done):
    calls.append((stage, done))
    begun.set()
def interrupt():
    begun.wait()
    os.kill(os.getpid(), signal.SIGINT)
threading.Thread(target=interrupt).start()
try:
    voxsplat.render(volume, size=(3000, 3000), transfer="grayscale", shading="post", painter="quads", light=False,
                    progress=report)
    print("done")
except KeyboardInterrupt:
    print("interrupted", ("rendering", 1.0) in calls)
"""
    done = python(code)
    # The work ends at its next report, and then the process.
    assert (done.stdout, done.returncode) == ("interrupted False\n", 0), done.stderr


def test_others_run_while_a_picture_is_drawn() -> None:
    ran, go, drawing = [False], threading.Event(), [False]

    def other() -> None:
        go.wait()
        ran[0] = drawing[0]

    interval = sys.getswitchinterval()
    with vs.Renderer() as renderer:
        scene = renderer.prepare(samples(), "ct-bone")
        renderer.render(scene, size=16)
        # From now on a thread runs only while another one gives the lock of the interpreter away.
        sys.setswitchinterval(3600)
        try:
            # A machine under load may not start the other thread in time, but not always.
            for _ in range(100):
                go.clear()
                thread = threading.Thread(target=other)
                thread.start()
                drawing[0] = True
                go.set()
                renderer.render(scene, size=16)
                drawing[0] = False
                thread.join()
                if ran[0]:
                    break
        finally:
            sys.setswitchinterval(interval)
    assert ran[0]


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
