"""Pictures: the same as the command's, as arrays, with errors of Python."""

from __future__ import annotations

import ast
import base64
import io
import json
import re
import warnings
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import nibabel
import numpy as np
import PIL.Image
import pytest
import voxsplat as vs
import xarray
from conftest import REPOSITORY, command, samples


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({}, ""),
        ({"size": (120, 90), "azimuth": -30, "elevation": 15, "projection": "perspective", "fov": 40}, "--size 120x90 "
         "--azimuth -30 --elevation 15 --projection perspective --fov 40"),
        ({"shading": "post", "painter": "cpu", "light": "headlight", "size": 64},
         "--shading post --painter cpu --light headlight --size 64"),
        ({"iso": [20, (60, "red", 0.4), "70:blue"], "size": 64}, "--iso 20 --iso 60:red:0.4 --iso 70:blue --size 64"),
        ({"iso": 30.5, "transfer": "viridis", "size": 64}, "--iso 30.5 --transfer viridis --size 64"),
        ({"transfer": "viridis", "size": 80, "sharpness": 1, "shading": "post", "clip": "R", "background": "white"},
         "--transfer viridis --size 80 --sharpness 1 --shading post --clip R --background white"),
        ({"transfer": "map:magma", "size": 80, "model": "mip", "attenuation": 2, "frame": "view", "direction": (1, 2, -1)},
         "--transfer map:magma --size 80 --model mip --attenuation 2 --frame view --direction 1,2,-1"),
        ({"window": (40, 60), "size": 80, "light": [(40, 30), "headlight:0.5"], "shadows": True, "occlusion": 4,
          "light_size": 5, "material": (0.3, 0.6, 0.2, 20), "kernel": "gaussian:0.8,2", "termination": 0},
         "--window 40,60 --size 80 --light 40,30 --light headlight:0.5 --shadows on --occlusion 4 --light-size 5 "
         "--material 0.3,0.6,0.2,20 --kernel gaussian:0.8,2 --tune termination=0"),
        ({"size": 80, "light": "studio", "roll": 20, "sheet_thickness": 0.5, "spacing": (3, 1, 1), "zoom": 1.5,
          "clip": ["voxels:5:,:,:", "0,0,1"]}, "--size 80 --light studio --roll 20 --tune sheet-thickness=0.5 "
         "--spacing 1,1,3 --zoom 1.5 --clip voxels:5:,:,: --clip 0,0,1"),
    ],
)
def test_the_package_and_the_command_write_the_same_png(
    scan: Path, tmp_path: Path, options: dict[str, Any], words: str
) -> None:
    command("render", scan, "-o", tmp_path / "command.png", *words.split())
    vs.render(scan, **options).save(tmp_path / "package.png")
    assert (tmp_path / "package.png").read_bytes() == (tmp_path / "command.png").read_bytes()


def test_built_in_volumes_and_labels_are_the_command_s_too(tmp_path: Path) -> None:
    labels = np.zeros((12, 12, 12), np.uint8)
    labels[2:6, 2:9, 3:8], labels[7:10, 4:11, 2:10] = 1, 2
    np.save(tmp_path / "labels.npy", labels)
    for volume in ["demo:nautilus:24", tmp_path / "labels.npy"]:
        command("render", volume, "-o", tmp_path / "command.png", "--size", 64)
        image = vs.render(volume, size=64)
        assert image.to_png() == (tmp_path / "command.png").read_bytes()
    assert any("labels" in choice for choice in image.choices)
    assert np.array_equal(vs.render(labels, size=64), image)


def test_a_single_picture_is_as_large_as_its_view_permits() -> None:
    bar = np.zeros((24, 24, 24), np.uint8)
    bar[11, 2:22, 11:13] = 255
    options = {"transfer": "grayscale", "light": False, "size": 32, "azimuth": 0}
    alone, steady, framed = (np.asarray(vs.render(bar, **options | more)) for more in [{}, {"frame": "visible"}, {"frame": "view"}])
    covered = [(image[..., 3] > 0.1).sum() for image in (alone, steady)]
    assert np.array_equal(alone, framed)
    assert covered[0] > 8 * covered[1]
    # A scene is for a series.
    with vs.Renderer() as renderer:
        scene = renderer.prepare(bar, "grayscale", light=False)
        assert np.array_equal(renderer.render(scene, size=32, azimuth=0), steady)
    placed = options | {"target": (12, 12, 12)}
    assert np.array_equal(vs.render(bar, **placed), vs.render(bar, **placed, frame="volume"))


def test_a_picture_is_an_array_and_a_png() -> None:
    image = vs.render(samples(), size=(60, 40))
    array = np.asarray(image)
    assert array.shape == image.shape == (40, 60, 4)
    assert array.dtype == np.float32
    assert image.size == (60, 40)
    assert not array.flags.writeable
    assert array is np.asarray(image)
    assert np.array(image).flags.writeable
    assert np.asarray(image, dtype=np.float64).dtype == np.float64
    # Premultiplied: no channel exceeds alpha for colours of at most 1.
    assert array[..., 3].max() > 0.5
    assert (array[..., :3].max(axis=-1) <= array[..., 3] + 1e-5).all()
    over = np.round(255 * np.clip(array[..., :3].astype(float) + (1 - array[..., 3:].astype(float)), 0, 1))
    assert np.array_equal(image.rgba8("white")[..., :3], over)
    png = image._repr_png_()
    assert png.startswith(b"\x89PNG")
    assert png == image.to_png()
    assert image.to_png("transparent") != png
    assert image.stats["size"] == [60, 40]
    assert image.stats["voxels"] == samples().size
    assert any(choice.startswith("azimuth 30") for choice in image.choices)


def test_files_appear_whole_or_not_at_all(tmp_path: Path) -> None:
    image = vs.render(samples(), size=32)
    image.save(tmp_path / "a.exr")
    with pytest.raises(ValueError, match="written as .png or .exr"):
        image.save(tmp_path / "a.jpg")
    with pytest.raises(FileNotFoundError):
        image.save(tmp_path / "no" / "a.png")
    assert [path.name for path in tmp_path.iterdir()] == ["a.exr"]
    command("compare", tmp_path / "a.exr", tmp_path / "a.exr")


def test_scenes_serve_many_views_and_light_stays() -> None:
    first = vs.View(azimuth=10, elevation=20)
    with vs.Renderer() as renderer:
        scene = renderer.prepare(samples(), "ct-bone", view=first, size=(64, 48))
        assert np.array_equal(renderer.render(scene, size=(64, 48)), vs.render(
            samples(), "ct-bone", size=(64, 48), azimuth=10, elevation=20, frame="visible"))
        turned = renderer.render(scene, azimuth=100, size=(64, 48))
        alone = vs.render(samples(), "ct-bone", size=(64, 48), azimuth=100, frame="visible")
        # The light of one picture stands around its own view.
        assert not np.array_equal(turned, alone)
        follows = renderer.prepare(samples(), "ct-bone", light="studio:eye", view=first)
        assert np.array_equal(renderer.render(follows, azimuth=100, size=(64, 48)), vs.render(
            samples(), "ct-bone", size=(64, 48), azimuth=100, light="studio", frame="visible"))
        part = renderer.render(scene, size=(64, 48), region=(10, 5, 30, 20))
        assert np.array_equal(part, np.asarray(renderer.render(scene, size=(64, 48)))[5:25, 10:40])
    with pytest.raises(ValueError, match="the renderer is closed"):
        renderer.render(scene)


def test_a_scene_of_a_device_belongs_to_its_renderer() -> None:
    with vs.Renderer() as first, vs.Renderer() as second:
        scene = first.prepare(samples(), painter="tiles", size=16)
        with pytest.raises(ValueError, match="another"):
            second.render(scene, size=16)
        # The processor's scenes are numbers in memory.
        scene = first.prepare(samples(), painter="cpu", size=16)
        assert np.array_equal(second.render(scene, size=16), first.render(scene, size=16))


def test_transfer_functions_come_as_points_dictionaries_and_files(tmp_path: Path) -> None:
    points = [(10, "#202040", 0.0), (40, (0.8, 0.5, 0.2), 0.2), (80, "#ffffff", 0.9)]
    table = {"points": [{"value": v, "color": c, "opacity": o} for v, c, o in points]}
    (tmp_path / "t.json").write_text(__import__("json").dumps(table))
    pictures = [np.asarray(vs.render(samples(), t, size=48)) for t in (points, table, tmp_path / "t.json")]
    assert pictures[0].any()
    assert all(np.array_equal(pictures[0], picture) for picture in pictures)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"size": (0, 1)}, "size: 0x1 pixels, expected 1x1"),
        ({"size": (1.5, 2)}, "size: (1.5, 2), expected 2 whole numbers"),
        ({"size": 40000}, "size: 40000x40000 pixels"),
        ({"light": "moon"}, "light: expected off, studio"),
        ({"light": [False, "headlight"]}, "light: off and other lights contradict"),
        ({"model": "mip", "light": "studio"}, "light: only the composite model is lit"),
        ({"sharpness": 3}, "sharpness: 3, expected 0 to 1"),
        ({"azimuth": float("nan")}, "azimuth is NaN"),
        ({"transfer": "ct-bones"}, 'transfer: "ct-bones", expected a file, map:NAME, labels or one of ct-bone'),
        ({"transfer": 3}, "transfer: int, expected a name"),
        ({"spacing": (1, 2)}, "spacing: (1, 2), expected 3 numbers"),
        ({"spacing": (1, 0, 2)}, "expected lengths over 0"),
        ({"affine": np.zeros((4, 4))}, "the grid's axes do not span space"),
        ({"axes": "abc"}, "axes: 'abc', expected an order of the letters"),
        ({"time": 1}, "time: it is for files"),
        ({"clip": "L"}, "clip: L: the file does not state the patient's sides"),
        ({"shading": "mid"}, 'shading: "mid", expected pre'),
        ({"painter": "tiles", "sheet_thickness": 1}, "painter: sheet_thickness is for quads"),
        ({"fov": 20}, "fov: it is for projection"),
        ({"background": "blurple"}, 'background: "blurple", expected'),
        ({"region": (0, 0, 90, 90), "size": 64}, "region"),
        ({"occlusion": True}, "occlusion: True, expected a radius"),
    ],
)
def test_values_out_of_range_are_value_errors_of_one_line(options: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=".") as error:
        vs.render(samples(), **options)
    assert message in str(error.value)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("volume", "kind", "message"),
    [
        (np.ones((3, 3, 3), complex), ValueError, "an array of type complex128 cannot be drawn"),
        (np.array([["a"]]), ValueError, "cannot be drawn"),
        (np.ones(5), ValueError, "an array of shape (5,) has 1 axes, expected three"),
        (np.ones((2, 3, 4, 5)), ValueError, "choose a time point or a channel by an index"),
        (np.ones((0, 3, 4)), ValueError, "has no samples"),
        (np.full((3, 3, 3), np.nan), ValueError, "27 samples are NaN or infinite"),
        (np.ma.masked_less(samples(), 5), ValueError, "the array masks samples"),
        ("nothing.nrrd", FileNotFoundError, "nothing.nrrd"),
        (Path(__file__), ValueError, "test_render.py"),
        ("demo:nothing", ValueError, "nothing"),
    ],
)
def test_volumes_that_cannot_be_drawn_are_errors_of_one_line(volume: Any, kind: type[Exception], message: str) -> None:
    with pytest.raises(kind) as error:
        vs.render(volume, size=16)
    assert message in str(error.value)
    assert "\n" not in str(error.value)


class Nothing:
    pass


@pytest.mark.parametrize(
    ("volume", "message"),
    [
        (None, "NoneType is no volume, expected an array of axes (z, y, x)"),
        (5, "int is no volume"),
        ({}, "dict is no volume, expected one of its arrays, such as volume[NAME]"),
        (xarray.Dataset({"a": (("z", "y", "x"), samples())}), "Dataset is no volume, expected one of its arrays"),
        ({1, 2}, "set is no volume"),
        (b"scan.nii", "bytes is no volume"),
        (Nothing(), "Nothing is no volume"),
        (len, "is no volume"),
        ("", "'' is no volume, expected the path of a file"),
        (" ", "' ' is no volume"),
    ],
)
def test_other_objects_are_type_errors_that_list_the_volumes(volume: Any, message: str) -> None:
    for draw in (vs.render, vs.info, vs.Volume, lambda volume: vs.plan(volume, (1, 1, 1))):
        with pytest.raises(TypeError) as error:
            draw(volume)
        assert message in str(error.value)
        assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("word", "hint"),
    [
        ("asimuth", "; a similar option exists: azimuth"),
        ("elevaton", "; a similar option exists: elevation"),
        ("backgrund", "; a similar option exists: background"),
        ("trasfer", "; a similar option exists: transfer"),
        ("spacings", "; a similar option exists: spacing"),
        ("cmap", ': transfer="map:NAME"'),
        ("clim", ": window=(LEVEL, WIDTH), from LEVEL - WIDTH/2 to LEVEL + WIDTH/2"),
        ("vmin", ": window=(LEVEL, WIDTH)"),
        ("vmax", ": window=(LEVEL, WIDTH)"),
        ("elev", ": elevation=DEGREES"),
        ("azim", ": azimuth=DEGREES"),
        ("opacity", ": transfer=PRESET"),
        ("cpos", ": azimuth= and elevation="),
        ("camera_position", ": azimuth= and elevation="),
        ("window_size", ": size=(WIDTH, HEIGHT)"),
        ("Specular_Power", ": material="),
        ("screenshot", ": image.save(FILE)"),
        ("wobble", ""),
    ],
)
def test_options_that_do_not_exist_are_type_errors_with_a_hint(word: str, hint: str) -> None:
    with pytest.raises(TypeError) as error:
        vs.render(samples(), **{word: 3})
    assert str(error.value).startswith(f"{word!r} is no option of render, View, Settings or Volume{hint}")
    assert hint or str(error.value).endswith("Volume")


def test_every_interface_has_the_hints() -> None:
    volume = vs.Volume(samples())
    with vs.Renderer() as renderer:
        scene = renderer.prepare(volume, size=16)
        for call, message in [
            (lambda: vs.View(elev=3), "'elev' is no option of View: elevation=DEGREES"),
            (lambda: vs.View(cmap="gray"), "'cmap' is no option of View"),
            (lambda: vs.Settings(cmap="gray"), "'cmap' is no option of Settings: transfer="),
            (lambda: renderer.render(scene, elev=3), "'elev' is no option of View: elevation="),
            (lambda: renderer.prepare(volume, cmap="gray"), "'cmap' is no option of Settings or Volume: transfer="),
            (lambda: vs.Volume(samples(), voxel_size=3), "'voxel_size' is no option of Volume: spacing="),
            (lambda: vs.info(volume, afine=3), "'afine' is no option of Volume; a similar option exists: affine"),
            (lambda: vs.plan(volume, (1, 1, 2), elev=3), "'elev' is no option of plan, View, Settings or Volume: elevation="),
            (lambda: vs.render(samples(), executor=ThreadPoolExecutor(1), memry=3), "similar option exists: memory"),
        ]:
            with pytest.raises(TypeError) as error:
                call()
            assert message in str(error.value)


def test_an_empty_mask_is_an_empty_picture_with_a_warning(scan: Path, tmp_path: Path) -> None:
    volume, clear = nibabel.load(scan), np.zeros((40, 30, 20), np.uint8)
    other = nibabel.Nifti1Image(clear[::2, ::2, ::2].copy(), volume.affine @ np.diag([2, 2, 2, 1]))
    for mask in (clear, clear > 0, nibabel.Nifti1Image(clear, volume.affine), other):
        with pytest.warns(vs.VolumeWarning, match="the volume is invisible because the mask is empty") as warned:
            image = vs.render(volume, mask=mask, size=32)
        assert [warning.filename for warning in warned] == [__file__]
        assert not np.asarray(image).any()
    nibabel.save(other, tmp_path / "mask.nii")
    said = command("render", scan, "-o", tmp_path / "a.png", "--mask", tmp_path / "mask.nii", "--size", 32)
    assert "note: the volume is invisible because the mask is empty: all its values are 0\n" in said
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        vs.render(volume, mask=clear + 1, size=32)


def test_a_volume_without_labels_is_an_empty_picture_with_a_warning(tmp_path: Path) -> None:
    clear = np.zeros((6, 7, 8), np.uint8)
    for volume, options in [(clear, {}), (clear > 0, {}), (clear.astype("i4"), {}), (clear, {"transfer": "labels"})]:
        with pytest.warns(vs.VolumeWarning, match="no label is visible because all labels are 0"):
            image = vs.render(volume, size=32, **options)
        assert not np.asarray(image).any()
    with pytest.warns(vs.VolumeWarning, match="no label is visible"):
        image = vs.render(samples(), labels=np.zeros_like(samples()), size=32)
    assert np.asarray(image).any()
    np.save(tmp_path / "a.npy", clear)
    said = command("render", tmp_path / "a.npy", "-o", tmp_path / "a.png", "--size", 32)
    assert "because all its values are 0, as in an empty mask" in said
    assert "note: no label is visible because all labels are 0\n" in said
    # Numbers that are no labels, and a preset that was requested, have nothing to adapt to.
    for volume, options in [(clear.astype("f4"), {}), (clear, {"transfer": "grayscale"})]:
        with pytest.raises(ValueError, match="all values are 0"):
            vs.render(volume, size=32, **options)


def test_pictures_that_no_memory_holds_are_memory_errors() -> None:
    # A view of one sample as 2^45: the copy is refused before any of it is made.
    vast = np.broadcast_to(np.float64(1), (65535, 65535, 8192))
    with pytest.raises(MemoryError, match="no memory for the samples of a volume"):
        vs.render(vast, "ct-bone", size=16)


def test_progress_is_called_and_ends_the_work() -> None:
    calls: list[tuple[str, float]] = []
    volume = np.random.default_rng(1).random((64, 64, 64), dtype=np.float32)
    vs.render(volume, size=32, progress=lambda stage, done: calls.append((stage, done)))
    assert calls
    assert calls[-1] == ("rendering", 1.0)
    assert all(0 <= done <= 1 for _, done in calls)

    def refuse(_: str, __: float) -> None:
        raise LookupError("enough")

    with pytest.raises(LookupError, match="enough"):
        vs.render(volume, size=32, progress=refuse)
    # The device serves the next picture.
    assert np.asarray(vs.render(volume, size=32)).any()


def test_progress_shows_a_bar(capsys: pytest.CaptureFixture[str]) -> None:
    vs.render(samples(), size=32, progress=True)
    assert "rendering" in capsys.readouterr().err


def test_what_there_is_is_listed() -> None:
    assert "bone" in vs.presets()["ct-bone"]
    assert "viridis" in vs.colour_maps()
    assert {"name", "backend", "kind", "driver"} <= vs.adapters()[0].keys()
    facts = vs.info(samples(), spacing=(2, 1, 1), units={"length": "mm", "value": "HU"}, modality="CT")
    assert facts["shape"] == [20, 30, 40]
    assert facts["spacing"] == [2, 1, 1]
    assert facts["transfer"] == "ct-bone"
    assert not facts["is_guess"]
    assert facts["max"] == samples().max()


def test_overlays_are_those_of_the_command(scan: Path, tmp_path: Path) -> None:
    affine = nibabel.load(scan).affine @ np.diag([2, 2, 2, 1])
    x, y, z = np.meshgrid(*(np.linspace(-1, 1, n) for n in (20, 15, 10)), indexing="ij")
    scores = (7 * np.sin(3 * x + y) * np.exp(-2 * (y**2 + z**2))).astype(np.float32)
    image = nibabel.Nifti1Image(scores, affine)
    image.header["intent_code"] = 5
    path = tmp_path / "z.nii"
    nibabel.save(image, path)

    def pixels(png: bytes) -> bytes:
        # After the notes, which name files.
        return png[png.index(b"IDAT") :]

    for overlays, words in [
        (path, [f"{path}"]),
        ((path, "hot", (2, None)), [f"{path}:hot@2.."]),
        ([(path, None, (2.5, 6)), (path, "lime")], [f"{path}@2.5..6", f"{path}:lime"]),
    ]:
        drawn = vs.render(scan, overlays=overlays, size=64)
        options = [option for word in words for option in ("--overlay", word)]
        command("render", scan, *options, "--size", "64", "-o", tmp_path / "a.png")
        assert pixels(drawn.to_png()) == pixels((tmp_path / "a.png").read_bytes())
    assert any("two-sided@2.3.." in choice for choice in vs.render(scan, overlays=image, size=16).choices)
    # A bare array has the axes and the samples of the volume.
    array = np.zeros((20, 30, 40), np.float32)
    array[8:12] = 5
    drawn = np.asarray(vs.render(samples(), overlays=[(array, "#ff0000", (1, 5))], size=32))
    assert drawn[..., 0].sum() > 1.2 * drawn[..., 2].sum()
    with pytest.raises(ValueError, match=r"overlay: @5.0..2.0, expected LO under HI"):
        vs.render(scan, overlays=(image, "hot", (5, 2)), size=16)
    with pytest.raises(ValueError, match="item 1 is None"):
        vs.render(scan, overlays=[image, None], size=16)
    with pytest.raises(ValueError, match="in bricks"):
        vs.render(samples(), overlays=array, executor=object())


def test_labels_and_masks_are_those_of_the_command(scan: Path, tmp_path: Path) -> None:
    volume = nibabel.load(scan)
    # A label over the right half, another in a corner.
    labels = np.zeros((40, 30, 20), np.uint8)
    labels[20:, 10:20, 5:15], labels[:10, :10, :10] = 3, 7
    path = tmp_path / "labels.nii"
    nibabel.save(nibabel.Nifti1Image(labels, volume.affine), path)
    options = ["--label", "3:red", "--label", "7:0.25", "--size", "80"]
    command("render", scan, "-o", tmp_path / "labels.png", "--labels", path, *options)
    looks = {"label": {3: "red", 7: 0.25}, "size": 80}

    def pixels(png: bytes) -> bytes:
        # After the notes, which name files.
        return png[png.index(b"IDAT") :]

    # A bare array has the axes of the volume.
    for given in (nibabel.load(path), str(path), labels):
        assert pixels(vs.render(volume, labels=given, **looks).to_png()) == pixels((tmp_path / "labels.png").read_bytes())
    command("render", scan, "-o", tmp_path / "mask.png", "--mask", path, "--size", "80")
    image = vs.render(volume, mask=labels > 0, size=80)
    assert pixels(image.to_png()) == pixels((tmp_path / "mask.png").read_bytes())
    for faults in ({"labels": labels[1:]}, {"mask": labels[1:]}, {"labels": labels, "label": "3"}):
        with pytest.raises(ValueError, match=list(faults)[-1]):
            vs.render(volume, **faults)
    with pytest.raises(ValueError, match="in bricks"):
        vs.render(volume, labels=labels, executor=object())


def test_adapters_are_chosen_by_index() -> None:
    array = samples(np.uint8)
    name = vs.adapters()[0]["name"]
    assert vs.render(array, size=8, adapter="#0").stats["adapter"]["name"] == name
    with pytest.raises(vs.DeviceError, match=f'none is "#9"; there are: #0 {re.escape(name)}'):
        vs.render(array, size=8, adapter="#9")


def test_the_notebook_shows_what_its_cells_draw() -> None:
    notebook = json.loads((REPOSITORY / "python/examples/first-pictures.ipynb").read_text())
    names: dict[str, Any] = {}
    shown = 0
    for cell in notebook["cells"]:
        *statements, last = ast.parse("".join(cell["source"])).body
        exec(compile(ast.Module(statements, []), "cell", "exec"), names)
        assert isinstance(last, ast.Expr)
        image = eval(compile(ast.Expression(last.value), "cell", "eval"), names)
        outputs = (output.get("data", {}) for output in cell["outputs"])
        kept = next(data["image/png"] for data in outputs if "image/png" in data)
        drawn, kept = (np.asarray(PIL.Image.open(io.BytesIO(png)), float) for png in (image._repr_png_(), base64.b64decode(kept)))
        assert np.abs(drawn - kept).mean() < 1
        shown += 1
    assert shown == 3
