"""Plans, bricks and merged pictures."""

from __future__ import annotations

import pickle

import numpy as np
import pytest
import voxsplat as vs
from conftest import samples

SIZE = (120, 96)
# Rays that do not end early: then cuts change only the rounding.
EXACT = {"termination": 0.0}


def difference(image: vs.Image, other: vs.Image) -> float:
    return float(np.abs(np.asarray(image) - np.asarray(other)).max())


def drawn(plan: vs.Plan, array: np.ndarray) -> list[vs.Partial]:
    return [vs.brick(plan, brick, array[brick.held]) for brick in plan.bricks]


@pytest.mark.parametrize(
    "options",
    [
        {"light": False},
        {"light": "headlight"},
        {"light": "headlight", "shading": "post"},
        {"model": "mip"},
        {"light": "headlight", "projection": "perspective"},
    ],
    ids=lambda options: "-".join(map(str, options.values())),
)
@pytest.mark.parametrize("painter", ["tiles", "cpu"])
def test_merged_pictures_are_whole_pictures(options: dict, painter: str) -> None:
    array = samples(np.int16)
    options = options | EXACT | {"painter": painter, "size": SIZE, "spacing": (2, 1.25, 1), "azimuth": 35, "frame": "visible"}
    whole = vs.render(array, **options)
    plan = vs.plan(array, ((6, 14), (9, 9, 12), 2), **options)
    assert len(plan.bricks) == 12
    merged = vs.merge(plan, reversed(drawn(plan, array)))
    assert np.asarray(whole)[..., 3].max() > 0.5
    # A merged projection is classified by the transfer function, a whole one of a device by its table.
    is_by_table = options.get("model") == "mip" and painter == "tiles"
    assert difference(merged, whole) < (5e-4 if is_by_table else 1e-5)


def test_light_that_is_not_given_has_no_shadows() -> None:
    plan = vs.plan(samples(), (1, 1, 2), size=SIZE, transfer="ct-bone")
    assert any("without shadows" in choice for choice in plan.choices)
    assert not plan.casts_shadows and vs.sweep_light(plan, samples()) == []
    with pytest.raises(ValueError, match="shadows: a device draws bricks without them"):
        vs.plan(samples(), (1, 1, 2), size=SIZE, light="studio", painter="tiles")


def test_shadows_fall_from_brick_to_brick() -> None:
    array = np.zeros((60, 40, 44), np.uint8)
    array[40:48, 8:30, 10:34] = 200
    array[6:10, 4:36, 4:40] = 120
    options = EXACT | {"painter": "cpu", "size": SIZE, "light": (0, 80), "shadows": 1.0, "azimuth": 20, "elevation": 50}
    options |= {"transfer": "grayscale", "frame": "visible"}
    plan = vs.plan(array, (2, 1, 2), **options)
    seen: list[str] = []
    light = vs.sweep_light(plan, array, progress=lambda stage, _: seen.append(stage))
    assert plan.casts_shadows and [one.brick for one in light] == [0, 1, 2, 3] and "sweeping light" in seen
    light = pickle.loads(pickle.dumps(light))
    parts = [vs.brick(plan, brick, array[brick.held], light=light[brick.number]) for brick in plan.bricks]
    whole = vs.render(array, **options)
    assert difference(vs.merge(plan, parts), whole) < 1e-5
    assert difference(vs.render(array, **options | {"shadows": 0.0}), whole) > 0.1
    with pytest.raises(ValueError, match="the light that enters brick 0 is missing"):
        vs.brick(plan, 0, array[plan.bricks[0].held])
    with pytest.raises(ValueError, match="it enters brick 1"):
        vs.brick(plan, 0, array[plan.bricks[0].held], light=light[1])
    with pytest.raises(ZeroDivisionError):
        vs.sweep_light(plan, _Failing())
    with pytest.raises(ValueError, match="a slice of"):
        vs.sweep_light(plan, array[:, :, :9])


class _Failing:
    """Samples that cannot be read."""

    def __getitem__(self, _: object) -> np.ndarray:
        raise ZeroDivisionError


def test_plans_and_parts_travel() -> None:
    array = samples()
    plan = vs.plan(array, (2, 1, 2), size=SIZE, light=False)
    parts = drawn(plan, array)
    travelled = pickle.loads(pickle.dumps(plan))
    assert vs.Plan.from_json(plan.to_json()).to_json() == plan.to_json() == travelled.to_json()
    assert [brick.held for brick in travelled.bricks] == [brick.held for brick in plan.bricks]
    picture = np.asarray(vs.merge(plan, parts))
    assert (np.asarray(vs.merge(travelled, pickle.loads(pickle.dumps(parts)))) == picture).all()
    # Any tree will do.
    left, right = parts[0].over(parts[1]), parts[2].over(parts[3])
    assert (np.abs(np.asarray(vs.merge(plan, [right, left])) - picture) < 1e-6).all()
    assert left.bricks == range(0, 2)


def test_overviews_plan_what_the_volume_shows() -> None:
    array = np.repeat(np.repeat(np.repeat(samples(np.uint8), 2, 0), 2, 1), 2, 2)
    affine = np.diag([1.0, 1.0, 1.0, 1.0])
    coarse = np.diag([2.0, 2.0, 2.0, 1.0])
    coarse[:3, 3] = 0.5
    options = {"painter": "tiles", "size": SIZE, "light": False, "view_height": 60.0, "termination": 0.0}
    # The affine of the volume leads to the space of the overview.
    for space in ("world", None, "LPS"):
        overview = vs.Volume(samples(np.uint8), affine=coarse, space=space)
        given = {"space": space} if space == "LPS" else {}
        plan = vs.plan(overview, (2, 2, 1), shape=array.shape, affine=affine, **given, **options)
        merged = vs.merge(plan, drawn(plan, array))
        whole = vs.render(array, affine=affine, space=space, **options)
        assert difference(merged, whole) < 1e-5


def test_labels_are_refused_when_they_are_planned() -> None:
    mask = (samples() > 40).astype(np.uint8)
    with pytest.raises(ValueError, match="transfer: labels and channels are drawn in bricks by the command alone"):
        vs.plan(mask, (1, 1, 2), size=SIZE)
    plan = vs.plan(mask, (1, 1, 2), size=SIZE, transfer="grayscale")
    assert len(drawn(plan, mask)) == 2


def test_what_does_not_fit_is_refused() -> None:
    array = samples()
    plan, other = (vs.plan(array, (1, 1, 3), size=SIZE, light=False, azimuth=turn) for turn in (0, 10))
    parts = drawn(plan, array)
    for wrong, reason in [
        (parts[:2], "missing"),
        (parts[1:], "brick 0 is missing"),
        ([*parts, parts[1]], "brick 1 is there twice"),
        ([vs.brick(other, 0, array[other.bricks[0].held]), *parts[1:]], "brick 0 belongs to another plan"),
        ([], "missing"),
    ]:
        with pytest.raises(ValueError, match=reason):
            vs.merge(plan, wrong)
    with pytest.raises(ValueError, match="a slice of"):
        vs.brick(plan, 0, array[:5])
    with pytest.raises(ValueError, match="expected 0 to 2"):
        vs.brick(plan, 3, array)
    with pytest.raises(ValueError, match="no partial picture|cannot be decoded"):
        vs.Partial.from_bytes(b"nothing")
    with pytest.raises(ValueError, match="plan"):
        vs.Plan.from_json("{}")
    for grid in [(1, 1), (0, 1, 1), (1, 1, 41), ((5, 5), 1, 1)]:
        with pytest.raises(ValueError, match="grid"):
            vs.plan(array, grid, size=SIZE)
    with pytest.raises(ValueError, match="affine"):
        vs.plan(array, (1, 1, 1), shape=(40, 60, 80))
    with pytest.raises(ValueError, match="box"):
        vs.plan(array, (1, 1, 1), shape=(40, 60, 80), affine=np.eye(4), clip="voxels:0:5,:,:")
