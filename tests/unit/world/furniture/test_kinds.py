"""Models of furniture are closed where they say so, stand on the ground, and fit the ground that is kept for them."""

import numpy as np
import pytest

from coopsim.sensors.scene import is_closed
from coopsim.world.furniture.kinds import KINDS, Kind, model
from coopsim.world.furniture.solids import Piece

LEAFY = ("tree", "bush", "hedge", "planter")


def usual(name: str, kind: Kind, variant: int = 0) -> Piece:
    lengths = (kind.step_m,) if kind.along else ()
    return model(name, (*lengths, *(size.usual for size in kind.sizes.values())), variant)


@pytest.mark.parametrize("name", KINDS)
def test_models_are_closed_and_stand_on_the_ground(name: str) -> None:
    kind = KINDS[name]
    for variant in range(12):
        shapes = usual(name, kind, variant)
        assert sum(len(shape.faces) for shape in shapes) <= 200
        assert 0.0 <= min(shape.vertices[:, 2].min() for shape in shapes) < (0.25 if name in LEAFY else 0.1)
        for shape in shapes:
            assert shape.faces.max() == len(shape.vertices) - 1 and shape.faces.min() == 0
            assert shape.closed == is_closed(shape.vertices, shape.faces)
            assert 0 <= shape.opacity <= 1 and shape.boxes.shape[1] == 7


@pytest.mark.parametrize("name", [name for name in KINDS if name not in LEAFY])
def test_models_stay_on_their_ground_below_heads_and_reach_their_height(name: str) -> None:
    kind = KINDS[name]
    for variant in range(12):
        points = np.concatenate([shape.vertices for shape in usual(name, kind, variant)])
        low = points[points[:, 2] < 2.0]
        length = kind.step_m if kind.along else kind.ground_m[0]
        assert np.abs(low[:, 0]).max() <= max(length, kind.ground_m[1] if name == "heap" else 0) / 2 + 0.05
        assert np.abs(low[:, 1]).max() <= kind.ground_m[1] / 2 + 0.05
        if "height_m" in kind.sizes:
            assert points[:, 2].max() == pytest.approx(kind.sizes["height_m"].usual, abs=0.06)


def test_boxes_hide_no_more_than_the_model() -> None:
    boxes = 0
    for name, kind in KINDS.items():
        for shape in usual(name, kind):
            low, high = shape.vertices.min(axis=0) - 0.02, shape.vertices.max(axis=0) + 0.02
            boxes += len(shape.boxes)
            for box in shape.boxes:
                assert box[6] == 0
                assert (box[:3] - box[3:6] / 2 >= low).all() and (box[:3] + box[3:6] / 2 <= high).all(), name
    assert boxes > len(KINDS) / 2


def test_sizes_are_followed() -> None:
    tree = np.concatenate([shape.vertices for shape in model("tree", (12.0, 6.0, 4.0), 1)])
    assert tree[:, 2].max() == pytest.approx(12.0, abs=0.5) and np.abs(tree[:, :2]).max() == pytest.approx(3.0, abs=0.5)
    hedge = model("hedge", (4.0, 2.0, 1.0), 1)[0].vertices
    assert hedge[:, 2].max() == pytest.approx(2.0, abs=0.25) and np.abs(hedge[:, 1]).max() < 0.75
