"""Sections beside a picture and in it: the command's, with errors of Python."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import PIL.Image
import pytest
import voxsplat as vs
from conftest import command, samples


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"size": 300}, "--size 300"),
        ({"size": (400, 200), "planes": "axial", "at": (0, 0, 20), "window": (40, 80), "title": "A scan"},
         "--size 400x200 --planes axial --at 0,0,20 --window 40,80 --title A_scan"),
        ({"size": 300, "planes": ["axial:20", "coronal"], "transfer": "map:magma", "background": "white"},
         "--size 300 --planes axial:20,coronal --transfer map:magma --background white"),
    ],
)
def test_slices_are_the_command_s(scan: Path, tmp_path: Path, options: dict[str, Any], words: str) -> None:
    command("slice", scan, "-o", tmp_path / "command.png", *(word.replace("_", " ") for word in words.split()))
    figure = vs.slices(scan, **options)
    expected = np.asarray(PIL.Image.open(tmp_path / "command.png").convert("RGB"))
    assert np.array_equal(figure.rgba8()[..., :3], expected)


def test_planes_in_a_picture_are_the_command_s(scan: Path, tmp_path: Path) -> None:
    command("render", scan, "-o", tmp_path / "command.png", *"--size 90 --plane coronal --plane axial:20".split())
    vs.render(scan, size=90, planes=["coronal", "axial:20"]).save(tmp_path / "package.png")
    assert (tmp_path / "package.png").read_bytes() == (tmp_path / "command.png").read_bytes()
    one = vs.render(scan, size=64, planes="coronal")
    assert not np.array_equal(np.asarray(one), np.asarray(vs.render(scan, size=64)))


@pytest.mark.parametrize(
    ("options", "reason"),
    [
        ({"planes": "upper"}, "plane: 'upper'|plane: \"upper\", expected axial"),
        ({"planes": "axial:900"}, "planes: xy at .* misses the volume"),
        ({"at": (900, 0, 0)}, "at: .* misses the volume"),
        ({"at": (1, 2)}, r"at: \(1, 2\), expected three finite numbers"),
        ({"at": (1, 2, float("nan"))}, "expected three finite numbers"),
        ({"size": 200}, "4 panels of"),
        ({"title": "w" * 300}, "title: it is too long"),
    ],
)
def test_figures_that_cannot_be_drawn_are_value_errors(options: dict[str, Any], reason: str) -> None:
    with pytest.raises(ValueError, match=reason):
        vs.slices(samples(), **({"size": 300} | options))


def test_other_options_are_type_errors() -> None:
    with pytest.raises(TypeError, match="'plane' is no option of slices"):
        vs.slices(samples(), plane="axial")
    with pytest.raises(TypeError, match="voxsplat.slices draws sections"):
        vs.render(samples(), slices=True)
