"""Volumes of other packages: each has its axes, spacing and place."""

from __future__ import annotations

import warnings
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from threading import Thread
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import voxsplat as vs
from conftest import LPS, RAS, samples

LOOK: dict[str, Any] = {"size": (72, 56), "transfer": "ct-bone", "azimuth": 35, "elevation": 25}


def picture(volume: Any, **options: Any) -> np.ndarray:
    return np.asarray(vs.render(volume, **(LOOK | options)))


@pytest.fixture(scope="module")
def expected(scan: Path) -> np.ndarray:
    drawn = picture(scan)
    assert drawn[..., 3].max() > 0.5
    # A lopsided body: no mirrored or turned lattice makes the same picture.
    assert not np.allclose(drawn, drawn[:, ::-1], atol=0.05)
    return drawn


def test_one_scan_by_many_roads_is_one_picture(scan: Path, expected: np.ndarray) -> None:
    import dask.array
    import nibabel
    import pyvista
    import SimpleITK
    import xarray
    import zarr

    image = nibabel.load(scan)
    assert np.array_equal(picture(image), expected)
    assert np.array_equal(picture(str(scan)), expected)
    placed = {"affine": LPS, "space": "LPS"}
    array = samples()
    assert np.array_equal(picture(array, **placed), expected)
    assert np.array_equal(picture(np.asanyarray(image.dataobj), axes="xyz", affine=RAS), expected)
    assert np.array_equal(picture(dask.array.from_array(array, chunks=(7, 30, 11)), **placed), expected)
    store = zarr.create_array(store={}, shape=array.shape, chunks=(8, 8, 8), dtype=array.dtype)
    store[...] = array
    assert np.array_equal(picture(store, **placed), expected)
    assert np.array_equal(picture(xarray.DataArray(array, dims=("z", "y", "x")), **placed), expected)
    turned = xarray.DataArray(array, dims=("z", "y", "x")).transpose("x", "z", "y")
    assert np.array_equal(picture(turned, **placed), expected)
    handler = partial(SimpleHTTPRequestHandler, directory=str(scan.parent))
    with ThreadingHTTPServer(("127.0.0.1", 0), handler) as server:
        Thread(target=server.serve_forever, daemon=True).start()
        url = f"http://user:secret@127.0.0.1:{server.server_port}/"
        assert np.array_equal(picture(f"{url}{scan.name}?token=secret"), expected)
        assert vs.info(f"{url}{scan.name}?token=secret") == vs.info(scan)
        with pytest.raises(OSError, match="HTTP 404 Not Found") as missing:
            vs.info(f"{url}missing.nrrd?token=secret")
        with pytest.raises(ValueError, match="over the limit of 10 bytes: .* fetch_limit=") as large:
            vs.Volume(f"{url}{scan.name}?token=secret", fetch_limit=10).info()
        assert not any("secret" in str(raised.value) for raised in (missing, large))
        server.shutdown()
    # These packages hold directions apart from the spacing: the last digits of the affine may differ.
    grid = pyvista.ImageData(dimensions=(40, 30, 20), spacing=(1, 1.25, 2), origin=tuple(LPS[:3, 3]))
    grid.direction_matrix = LPS[:3, :3] / np.array([1, 1.25, 2])
    grid["values"] = array.ravel()
    for close in (SimpleITK.ReadImage(str(scan)), grid):
        assert np.abs(picture(close) - expected).max() < 1e-3


def test_an_affine_leads_to_ras_unless_space_says_otherwise(scan: Path, expected: np.ndarray) -> None:
    import nibabel
    import pyvista
    import SimpleITK

    image = nibabel.load(scan)
    given = {"axes": "xyz", "affine": image.affine}
    facts = vs.info(image)
    assert facts["oriented"]
    # The world is LPS.
    assert np.array_equal(facts["affine"], LPS)
    for space, affine in [(None, RAS), ("RAS", RAS), ("LPS", LPS)]:
        told = vs.info(image.get_fdata(), axes="xyz", affine=affine, space=space)
        assert (told["affine"], told["oriented"]) == (facts["affine"], True)
    plain = vs.info(image.get_fdata(), axes="xyz", affine=RAS, space="world")
    assert (plain["affine"], plain["oriented"]) == (RAS.tolist(), False)
    assert np.array_equal(picture(np.asanyarray(image.dataobj), **given), expected)
    assert np.array_equal(picture(np.asanyarray(image.dataobj), clip="R", **given), picture(scan, clip="R"))
    # The front of a patient, unless the view is given.
    front = {"azimuth": None, "elevation": None}
    assert np.array_equal(picture(np.asanyarray(image.dataobj), **given, **front), picture(scan, **front))
    # Images that state a space are not turned twice.
    assert vs.info(image, space="RAS")["affine"] == facts["affine"]
    itk = SimpleITK.ReadImage(str(scan))
    assert vs.info(itk, space="LPS")["affine"] == vs.info(itk)["affine"]
    for data, space in [(image, "LPS"), (itk, "RAS"), (itk, "world")]:
        with pytest.raises(ValueError, match=f"space: '{space}', but places of the image are in"):
            vs.info(data, space=space)
    with pytest.raises(ValueError, match="space: 'MNI', expected 'RAS', 'LPS' or 'world'"):
        vs.info(samples(), affine=LPS, space="MNI")
    # Places without a space lie in the world as they are.
    grid = pyvista.ImageData(dimensions=(40, 30, 20), origin=(1, 2, 3))
    grid["values"] = samples().ravel()
    assert not vs.info(grid)["oriented"]
    assert [row[3] for row in vs.info(grid, space="RAS")["affine"]] == [-1, -2, 3, 1]


def doubts(volume: Any, **options: Any) -> list[str]:
    """The warnings about the axes of a volume."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        vs.Volume(volume, **options)
    assert all(one.category is vs.VolumeWarning and one.filename == __file__ for one in caught)
    return [str(one.message) for one in caught]


def test_bare_arrays_with_x_first_give_one_warning(scan: Path, tmp_path: Path) -> None:
    import nibabel

    image = nibabel.load(scan)
    flat = samples().flatten()
    series = nibabel.Nifti1Image(np.asfortranarray(np.stack([samples().T] * 2, -1)), RAS)
    nibabel.save(series, tmp_path / "series.nii")
    np.save(tmp_path / "a.npy", np.asfortranarray(samples().T))
    for array in (
        image.get_fdata(),
        image.get_fdata(dtype=np.float32),
        np.asanyarray(image.dataobj),
        image.get_fdata()[5:-5, :, 3:],
        nibabel.load(tmp_path / "series.nii").get_fdata()[..., 1],
        flat.reshape((40, 30, 20), order="F"),
        np.load(tmp_path / "a.npy", mmap_mode="r"),
    ):
        (message,) = doubts(array)
        assert f"an array of shape {array.shape} is drawn with axes (z, y, x)" in message
        assert 'give axes="xyz" or axes="zyx", or pass the image itself' in message
        assert "\n" not in message
        # A spacing or an affine does not tell the axes of the array.
        assert len(doubts(array, spacing=(1, 1, 2))) == len(doubts(array, affine=RAS)) == 1
        assert doubts(array, axes="xyz") == doubts(array, axes="zyx") == []
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        vs.render(image.get_fdata(), mask=image.get_fdata() > 0, size=16)
    assert [one.filename for one in caught] == [__file__]


def test_other_arrays_give_no_warning(scan: Path) -> None:
    import dask.array
    import nibabel
    import SimpleITK
    import xarray

    image, array = nibabel.load(scan), samples()
    for volume in (
        array,
        array > 30,
        array[::2, ::-1, 3:],
        array.astype("f8"),
        # Transposed by the caller.
        image.get_fdata().T,
        image.get_fdata().T.copy(),
        np.ascontiguousarray(array.T).T,
        np.ascontiguousarray(array.transpose(1, 2, 0)).transpose(2, 0, 1),
        np.moveaxis(np.ascontiguousarray(np.moveaxis(array, 0, -1)), -1, 0),
        np.broadcast_to(np.int16(3), array.shape),
        # A slice, a row, a voxel.
        image.get_fdata()[..., 9],
        np.asfortranarray(array[:, :1, :1]),
        np.zeros((1, 1, 1), order="F"),
        image,
        SimpleITK.GetArrayFromImage(SimpleITK.ReadImage(str(scan))),
        SimpleITK.ReadImage(str(scan)),
        xarray.DataArray(np.asfortranarray(array), dims=("z", "y", "x")),
        dask.array.from_array(array),
        array.tolist(),
        scan,
    ):
        assert doubts(volume) == []


def test_files_of_numpy_take_the_order_of_their_axes(tmp_path: Path) -> None:
    array = samples()
    np.savez_compressed(tmp_path / "a.npz", scan=array.T, spacing=[1.0, 1.0, 1.0])
    expected = picture(array)
    assert np.array_equal(picture(tmp_path / "a.npz", axes="xyz"), expected)
    assert np.array_equal(picture(f"{tmp_path / 'a.npz'}:scan", axes="xyz"), expected)
    array.T.copy().tofile(tmp_path / "a.raw")
    facts = {"dims": array.shape[::-1], "dtype": array.dtype}
    assert np.array_equal(picture(tmp_path / "a.raw", axes="xyz", **facts), expected)
    with pytest.raises(ValueError, match="axes: \"yxz\", expected zyx or xyz"):
        picture(tmp_path / "a.npz", axes="yxz")


def test_images_of_nibabel_with_factors_are_scaled(tmp_path: Path) -> None:
    import nibabel

    fixtures = Path(__file__).parents[2] / "tests" / "data" / "volumes"
    for name in ("scaled-i16+orig.HEAD", "raw-u16.PAR"):
        info = vs.Volume(nibabel.load(fixtures / name)).info()
        of_file = vs.Volume(fixtures / name).info()
        assert info["affine"] == pytest.approx(np.array(of_file["affine"]))
        assert (info["min"], info["max"]) == pytest.approx((of_file["min"], of_file["max"]))


def test_choices_for_nibabel_and_simpleitk_are_those_for_the_file(scan: Path) -> None:
    import nibabel
    import SimpleITK

    choices = vs.render(scan, size=32).choices
    assert vs.render(nibabel.load(scan), size=32).choices == choices
    assert vs.render(SimpleITK.ReadImage(str(scan)), size=32).choices == choices


def test_slopes_of_nibabel_map_values(tmp_path: Path) -> None:
    import nibabel

    image = nibabel.Nifti1Image(samples().transpose(2, 1, 0), RAS)
    image.header.set_slope_inter(2.5, -30)
    nibabel.save(image, tmp_path / "slope.nii.gz")
    loaded = nibabel.load(tmp_path / "slope.nii.gz")
    facts = vs.info(loaded)
    assert facts["min"] == pytest.approx(2.5 * samples().min() - 30)
    assert facts["sample_type"] == "i16"
    assert np.array_equal(picture(loaded), picture(tmp_path / "slope.nii.gz"))


@pytest.mark.parametrize(
    "dtype", ["u1", "i1", "u2", "i2", "u4", "i4", "u8", "i8", "f2", "f4", "f8", ">i2", ">f4", "longdouble"]
)
def test_every_type_is_drawn_alike(dtype: str) -> None:
    look = {"transfer": [(0, "#000000", 0), (80, "#ffc080", 0.6)], "light": False, "sharpness": 0}
    drawn = picture(samples("f4"), **look)
    assert np.abs(picture(samples(np.dtype(dtype)), **look) - drawn).max() < 1e-6
    assert vs.info(samples(np.dtype(dtype)))["max"] == samples().max()


def test_masks_are_drawn() -> None:
    mask = samples() > 30
    assert vs.info(mask)["sample_type"] == "u8"
    assert np.array_equal(vs.render(mask, size=32), vs.render(mask.astype(np.uint8), size=32))


def test_info_says_what_a_picture_makes_of_the_values() -> None:
    mask = (samples() > 40).astype(np.uint8)
    facts = vs.info(mask)
    assert (facts["transfer"], facts["is_guess"]) == ("labels", False)
    assert any(facts["reason"] in choice for choice in vs.render(mask, size=8).choices)
    facts = vs.info(samples(), modality="CT")
    assert any(f"preset {facts['transfer']}" in choice for choice in vs.render(samples(), size=8, modality="CT").choices)
    assert vs.info("demo:sphere:8")["transfer"] is None


@pytest.mark.parametrize(
    "options, message",
    [
        ({"azimuth": "x"}, r"azimuth: 'x', expected float \| None"),
        ({"shading": None}, "shading: None, expected str"),
        ({"light": 3}, "light: 3, expected a text, .azimuth, elevation."),
        ({"clip": 3}, "clip: 3, expected a text or a list of texts"),
        ({"window": 3}, "window: 3, expected 2 numbers"),
        ({"material": "x"}, "material: 'x', expected 4 numbers"),
    ],
)
def test_errors_of_types_name_the_option(options: dict[str, Any], message: str) -> None:
    with pytest.raises((TypeError, ValueError), match=message):
        vs.render(samples(), size=8, **options)


def test_memory_may_lie_in_any_order() -> None:
    # More than a block along each axis, and no multiple of one.
    array = np.random.default_rng(3).integers(0, 100, (37, 70, 41), dtype=np.uint16)
    drawn = picture(array)
    wide = np.zeros((74, 70, 123), np.uint16)
    wide[::2, :, ::3] = array
    unaligned = np.zeros(2 * array.size + 1, np.uint8)[1:].view(np.uint16).reshape(array.shape)
    unaligned[...] = array
    for same in (
        np.asfortranarray(array),
        wide[::2, :, ::3],
        array[::-1, ::-1, ::-1].copy()[::-1, ::-1, ::-1],
        array.transpose(1, 2, 0).copy().transpose(2, 0, 1),
        array.transpose(2, 0, 1).copy().transpose(1, 2, 0),
        unaligned,
    ):
        assert not same.flags.c_contiguous or not same.flags.aligned
        assert np.array_equal(picture(same), drawn)
    locked = array.copy()
    locked.setflags(write=False)
    assert np.array_equal(picture(locked), drawn)


def test_spacing_is_in_the_order_of_the_shape() -> None:
    array = samples()
    lengths = (2.0, 1.25, 1.0)
    drawn = picture(array, affine=np.diag([1, 1.25, 2, 1]), space="world")
    assert np.array_equal(picture(array, spacing=lengths), drawn)
    assert np.array_equal(picture(array.transpose(2, 1, 0), axes="xyz", spacing=lengths[::-1]), drawn)
    assert vs.info(array, spacing=lengths)["spacing"] == list(lengths)


def test_xarray_states_names_coordinates_and_units() -> None:
    import xarray

    array = samples()
    data = xarray.DataArray(
        array[:, np.newaxis],
        dims=("depth", "time", "lat", "lon"),
        coords={
            "depth": ("depth", 5 + 2.0 * np.arange(20), {"units": "m"}),
            "lat": ("lat", 1.25 * np.arange(30), {"units": "m"}),
            "lon": ("lon", -7 + 1.0 * np.arange(40), {"units": "m"}),
        },
        attrs={"units": "HU"},
    )
    facts = vs.info(data)
    assert facts["spacing"] == [2, 1.25, 1]
    assert [row[3] for row in facts["affine"][:3]] == [-7, 0, 5]
    assert (facts["length_unit"], facts["value_unit"], facts["transfer"]) == ("m", "HU", "ct-bone")
    assert np.array_equal(picture(data), picture(array, spacing=(2, 1.25, 1), units={"value": "HU"}))
    # Coordinates that fall are a mirrored lattice: the same world, the same picture.
    assert np.abs(picture(data.isel(lat=slice(None, None, -1))) - picture(data)).max() < 1e-3
    with pytest.raises(ValueError, match="dimension 'time' has 2 values: choose one, such as by .isel"):
        vs.render(xarray.concat([data, data], "time"))
    with pytest.raises(ValueError, match="coordinate 'lat' is not equally spaced"):
        vs.render(data.assign_coords(lat=np.arange(30.0) ** 2))


def test_dlpack_is_read() -> None:
    class Tensor:
        def __init__(self, array: np.ndarray) -> None:
            self.array = array

        def __dlpack__(self, **options: Any) -> Any:
            return self.array.__dlpack__(**options)

        def __dlpack_device__(self) -> tuple[int, int]:
            return 1, 0

    class Remote(Tensor):
        def __dlpack_device__(self) -> tuple[int, int]:
            return 2, 0

    array = samples().copy()
    assert np.array_equal(picture(Tensor(array)), picture(array))
    with pytest.raises(ValueError, match="the array is on a device: copy it to the host first"):
        picture(Remote(array))


def test_pyvista_draws_cells_and_names_its_faults() -> None:
    import pyvista

    cells = pyvista.ImageData(dimensions=(41, 31, 21), spacing=(1, 1.25, 2), origin=(-0.5, -0.625, -1))
    with pytest.raises(ValueError, match="no active scalars"):
        picture(cells)
    cells.cell_data["values"] = samples().ravel()
    assert np.array_equal(picture(cells), picture(samples(), spacing=(2, 1.25, 1)))


def test_simpleitk_names_its_faults() -> None:
    import SimpleITK

    with pytest.raises(ValueError, match="an image of vectors"):
        picture(SimpleITK.GetImageFromArray(np.zeros((4, 4, 4, 3), np.uint8), isVector=True))
    with pytest.raises(ValueError, match="an image of 2 dimensions"):
        picture(SimpleITK.GetImageFromArray(np.zeros((4, 4), np.uint8)))


def test_a_flat_array_is_a_slice() -> None:
    assert vs.info(samples()[9], spacing=(1, 2, 3))["shape"] == [1, 30, 40]


def test_a_volume_is_converted_once() -> None:
    volume = vs.Volume(samples(), spacing=(2, 1.25, 1))
    assert np.array_equal(picture(volume), picture(samples(), spacing=(2, 1.25, 1)))
    with pytest.raises(ValueError, match="spacing: the volume is a voxsplat.Volume already"):
        picture(volume, spacing=(1, 1, 1))


def test_nan_is_replaced_if_a_number_is_given() -> None:
    array = samples("f4")
    holes = array.copy()
    holes[array == 0] = np.nan
    assert np.array_equal(picture(holes, replace_nan=0), picture(array))


def viewer_of(layer_options: dict[str, Any]) -> Any:
    from napari.components import ViewerModel

    viewer = ViewerModel()
    viewer.add_image(samples("f4"), scale=(2, 1.25, 1), translate=(5, -3, 2), **layer_options)
    viewer.dims.ndisplay = 3
    return viewer


class Image(SimpleNamespace):
    """The attributes of a layer of napari."""

    def data_to_world(self, index: Any) -> Any:
        return np.array(self.scale) * index + self.translate

    def world_to_data(self, point: Any) -> Any:
        return (np.array(point) - self.translate) / self.scale

    def map(self, values: np.ndarray) -> np.ndarray:
        return np.repeat(values[:, np.newaxis], 4, axis=1)


def stand_in() -> Any:
    """The attributes of a viewer of napari whose canvas shows the front of a layer, with those of `viewer_of`."""
    place = {"scale": (2, 1.25, 1), "translate": (5, -3, 2)}
    layer = Image(data=samples("f4"), visible=True, contrast_limits=(5, 90), gamma=1, rendering="mip", opacity=1, **place)
    layer.colormap = layer
    middle = tuple(layer.data_to_world((np.array(layer.data.shape) - 1) / 2))
    camera = {"view_direction": (-1, 0, 0), "up_direction": (0, -1, 0), "center": middle, "zoom": 13.5, "perspective": 0}
    layers = type("Layers", (list,), {"selection": SimpleNamespace(active=None)})([layer])
    dims = SimpleNamespace(displayed=(0, 1, 2), ndim=3, point=(0, 0, 0))
    return SimpleNamespace(layers=layers, camera=SimpleNamespace(handedness="right", **camera), dims=dims)


def front_of(viewer: Any) -> np.ndarray:
    """The picture of the front of a viewer, after checks of its size and its place."""
    image = vs.from_napari(viewer, size=(80, 60))
    array = np.asarray(image)
    # napari's front looks along -z, with y down and x to the right: the maximum along z.
    front = samples("f4").max(axis=0)
    shown = array[..., 3] > 0.5
    rows, columns = np.flatnonzero(shown.any(axis=1)), np.flatnonzero(shown.any(axis=0))
    scale = viewer.camera.zoom * 60 / 600
    inside = front > 5
    height = 1.25 * np.ptp(np.flatnonzero(inside.any(axis=1)))
    width = np.ptp(np.flatnonzero(inside.any(axis=0)))
    assert np.ptp(rows) == pytest.approx(height * scale, abs=2 * scale)
    assert np.ptp(columns) == pytest.approx(width * scale, abs=2 * scale)
    # The brightest voxel lies where napari draws it.
    row, column = np.unravel_index(front.argmax(), front.shape)
    center = np.array(viewer.camera.center)
    at = (30 + (1.25 * row - 3 - center[1]) * scale, 40 + (column + 2 - center[2]) * scale)
    drawn = np.unravel_index(array[..., :3].sum(axis=-1).argmax(), shown.shape)
    assert np.abs(np.array(drawn) - at).max() < 3
    assert "mip" in str(image.stats["model"])
    return array


def test_a_viewer_is_drawn_as_it_stands() -> None:
    viewer = stand_in()
    array = front_of(viewer)
    # Mirrored axes mirror the picture.
    viewer.camera.handedness = "left"
    assert np.abs(np.asarray(vs.from_napari(viewer, size=(80, 60)))[:, ::-1] - array).max() < 0.02
    viewer.layers[0].rendering, viewer.layers[0].iso_threshold = "iso", 40
    assert np.asarray(vs.from_napari(viewer, size=40))[..., 3].max() > 0.5
    viewer.dims.displayed = (1, 2)
    with pytest.raises(ValueError, match="ndisplay = 3"):
        vs.from_napari(viewer)
    viewer.dims.displayed, viewer.layers[0].visible = (0, 1, 2), False
    with pytest.raises(ValueError, match="no visible layer"):
        vs.from_napari(viewer)


@pytest.mark.slow
def test_a_napari_viewer_is_drawn_as_it_stands() -> None:
    viewer = viewer_of({"colormap": "magma", "rendering": "mip", "contrast_limits": (5, 90)})
    array = front_of(viewer)
    # Mirrored axes mirror the picture.
    viewer.camera.orientation = ("towards", "down", "left")
    mirrored = np.asarray(vs.from_napari(viewer, size=(80, 60)))
    assert np.abs(mirrored[:, ::-1] - array).max() < 0.02
    viewer.camera.orientation = ("towards", "down", "right")
    viewer.camera.angles = (10, 30, 70)
    viewer.layers[0].rendering = "translucent"
    turned = np.asarray(vs.from_napari(viewer, size=(80, 60), light="studio"))
    assert turned[..., 3].max() > 0.3


@pytest.mark.slow
def test_napari_s_other_states_are_drawn_or_refused() -> None:
    viewer = viewer_of({"rendering": "iso", "iso_threshold": 40})
    viewer.add_labels((samples() > 40).astype(np.int32), name="labels")
    iso = vs.from_napari(viewer, size=40)
    assert any("labels" in choice for choice in iso.choices)
    viewer.layers.selection.active = viewer.layers[0]
    assert np.asarray(vs.from_napari(viewer, size=40))[..., 3].max() > 0.5
    viewer.dims.ndisplay = 2
    with pytest.raises(ValueError, match="ndisplay = 3"):
        vs.from_napari(viewer)
    viewer.layers.clear()
    with pytest.raises(ValueError, match="no visible layer"):
        vs.from_napari(viewer)
    series = viewer_of({})
    series.layers.clear()
    series.add_image(np.stack([samples("f4") * 0, samples("f4")]), name="series")
    series.dims.ndisplay = 3
    series.dims.set_point(0, 1)
    assert np.asarray(vs.from_napari(series, size=40)).any()
    series.dims.set_point(0, 0)
    assert not np.asarray(vs.from_napari(series, size=40, transfer=[(1, "#ffffff", 0), (2, "#ffffff", 1)])).any()
