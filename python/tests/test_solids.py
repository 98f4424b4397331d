"""Opaque surfaces in pictures, and depths of matter."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import pyvista
import voxsplat

SIZE = (48, 48)
SQUARE = (
    np.array([[-9, 0, -9], [9, 0, -9], [9, 0, 9], [-9, 0, 9]], dtype=np.float64),
    np.array([[0, 1, 2], [0, 2, 3]]),
)


@pytest.fixture(scope="module")
def ball() -> voxsplat.Volume:
    z, y, x = np.mgrid[-12:13, -12:13, -12:13]
    values = np.clip(8 - np.sqrt(x * x + y * y + z * z), 0, 1).astype(np.float32)
    return voxsplat.Volume(values, origin=(-12, -12, -12))


OPTIONS = {"transfer": [(0, "red", 0), (1, "red", 0.2)], "size": SIZE, "azimuth": 0, "light": "off"}


def test_a_mesh_hides_the_matter_behind_it(ball: voxsplat.Volume, tmp_path: Path) -> None:
    without = np.asarray(voxsplat.render(ball, **OPTIONS))
    picture = np.asarray(voxsplat.render(ball, meshes=(SQUARE, "blue"), **OPTIONS))
    middle = SIZE[1] // 2, SIZE[0] // 2
    # Half of the ball is in front of the square.
    alpha = 1 - np.sqrt(1 - without[*middle, 3])
    assert picture[*middle, 3] == pytest.approx(1)
    assert picture[*middle, 0] == pytest.approx(alpha, abs=0.25)
    assert picture[*middle, 2] > 0.1 > without[*middle, 2]
    file = tmp_path / "square.obj"
    lines = [f"v {x} {y} {z}" for x, y, z in SQUARE[0]] + [f"f {a + 1} {b + 1} {c + 1}" for a, b, c in SQUARE[1]]
    file.write_text("\n".join(lines))
    trimesh = SimpleNamespace(vertices=SQUARE[0], faces=SQUARE[1])
    quad = pyvista.PolyData(SQUARE[0].astype(np.float32), [4, 0, 1, 2, 3])
    for mesh in [(file, "blue"), f"{file}:blue", (trimesh, "blue"), (quad, "blue"), [(SQUARE, "blue")]]:
        assert np.array_equal(np.asarray(voxsplat.render(ball, meshes=mesh, **OPTIONS)), picture)


def test_depths_of_one_picture_hide_the_matter_of_another(ball: voxsplat.Volume) -> None:
    with voxsplat.Renderer() as renderer:
        scene = renderer.prepare(ball, OPTIONS["transfer"], voxsplat.Settings(light="off"), size=SIZE)
        depths = renderer.depths(scene, azimuth=0, size=SIZE)
        assert depths.shape == SIZE[::-1] and depths.dtype == np.float32
        alpha = np.asarray(renderer.render(scene, azimuth=0, size=SIZE))[..., 3]
        assert np.array_equal(np.isfinite(depths), alpha >= 0.5)
        assert -8 < depths[24, 24] < 0
        half = np.asarray(renderer.render(scene, azimuth=0, size=SIZE, depth=depths))[..., 3]
        assert half[alpha >= 0.5] == pytest.approx(0.5, abs=0.02)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"meshes": (SQUARE[0][:, :2], SQUARE[1])}, "vertices of shape"),
        ({"meshes": (SQUARE[0], SQUARE[1] + 1)}, "vertex 4, but only 4"),
        ({"meshes": (SQUARE[0], SQUARE[1] - 1)}, "from 0"),
        ({"meshes": (SQUARE[0] * np.nan, SQUARE[1])}, "not finite"),
        ({"meshes": (SQUARE, "bleu")}, "similar colour exists: blue"),
        ({"meshes": [3]}, "expected a path"),
        ({"depth": np.zeros(4)}, "expected \\(height, width\\)"),
        ({"depth": np.zeros((4, 5))}, "5 x 4 pixels, expected 48 x 48"),
    ],
)
def test_bad_solids_are_refused(ball: voxsplat.Volume, options: dict[str, object], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        voxsplat.render(ball, **OPTIONS, **options)
