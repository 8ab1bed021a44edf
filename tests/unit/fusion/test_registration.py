"""Boxes of two agents are laid on each other by what both see."""

from __future__ import annotations

import warnings

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from coopsim.fusion.registration import Registration, place, register_rows
from coopsim.geometry.assignment import hungarian
from coopsim.geometry.box_matching import Likeness, ScoredBoxes, match_boxes
from coopsim.geometry.boxes import Boxes3D
from coopsim.geometry.iou import giou_bev
from coopsim.geometry.se3 import Floats
from coopsim.types import Detections


def register(own: Detections, other: Detections) -> Registration:
    columns = [column for found in (own, other) for column in (found.boxes.array, found.score, found.label)]
    registration: Registration = register_rows(*columns)[0]
    return registration


def moved_by(registration: Registration, boxes: Boxes3D) -> Boxes3D:
    return Boxes3D.from_array(place(registration, boxes.array))


def cars(seed: int = 0, count: int = 12) -> Detections:
    """Cars some metres apart, in a town of 80 m."""
    rng = np.random.default_rng(seed)
    cells = rng.choice(64, count, replace=False)
    places = np.stack([cells // 8, cells % 8], axis=1) * 10.0 + rng.uniform(-1, 1, (count, 2))
    rows = np.column_stack([places, rng.uniform(0.7, 1.0, count), np.full((count, 3), [4.5, 1.9, 1.6]), cells % 3])
    return Detections(Boxes3D.from_array(rows), rng.uniform(0.3, 0.9, count), np.zeros(count, int))


def moved(found: Detections, shift: Floats, rise: Floats) -> Detections:
    """As an agent says it whose registration is the inverse of this."""
    boxes = moved_by(Registration(found.boxes.center[:, :2].mean(axis=0), shift, rise, 0), found.boxes)
    return Detections(boxes, found.score, found.label)


@given(
    st.tuples(st.floats(-1, 1), st.floats(-1, 1), st.floats(-0.015, 0.015)),
    st.tuples(st.floats(-1, 1), st.floats(-0.05, 0.05), st.floats(-0.05, 0.05)),
)
def test_the_objects_that_both_see_lie_on_each_other(
    shift: tuple[float, float, float], rise: tuple[float, float, float]
) -> None:
    own = cars()
    other = moved(own, np.array(shift), np.array(rise))
    found = register(own, other[np.arange(len(own))[::-1]])
    assert found.common == len(own)
    placed = moved_by(found, other.boxes)
    # Priors hold it back a little.
    assert np.abs(placed.center - own.boxes.center).max() < 0.15
    assert np.abs(placed.yaw - own.boxes.yaw).max() < 0.005


def test_a_pair_that_is_two_objects_turns_nothing() -> None:
    own = cars(1)
    rows = own.boxes.array
    rows[3, :3] += [1.5, -0.5, 2.5]
    found = register(own, Detections(Boxes3D.from_array(rows), own.score, own.label))
    others = np.arange(len(own)) != 3
    assert np.abs(moved_by(found, own.boxes).center - own.boxes.center)[others].max() < 0.15


def test_a_better_score_weighs_more() -> None:
    own = cars(2, count=2)
    rows = own.boxes.array
    rows[0, 0] += 0.3
    rows[1, 0] -= 0.3
    for scores, sign in (((0.9, 0.2), -1), ((0.2, 0.9), 1)):
        assert np.sign(register(own, Detections(Boxes3D.from_array(rows), scores, own.label)).shift[0]) == sign


def test_nothing_in_common_moves_nothing() -> None:
    own, far = cars(), moved(cars(), np.array([500.0, 0.0, 0.0]), np.zeros(3))
    empty = Detections.empty()
    another_class = Detections(own.boxes, own.score, own.label + 1)
    for first, second in ((own, far), (own, empty), (empty, own), (empty, empty), (own, another_class)):
        found = register(first, second)
        assert found.common == 0
        np.testing.assert_allclose(moved_by(found, second.boxes).array, second.boxes.array, atol=1e-9)


@pytest.mark.parametrize("where", [1e6, 1e150, 1e300])
def test_boxes_beyond_reason_raise_nothing_and_spoil_nothing(where: float) -> None:
    own = cars()
    beyond = Detections(Boxes3D.from_array([[where, -where, where, 4.5, 1.9, 1.6, 0]]), [1e30], [0])
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        found = register(*(Detections.concatenate([each, beyond]) for each in (own, own)))
        placed = moved_by(found, own.boxes)
    assert found.common == len(own)
    np.testing.assert_allclose(placed.array, own.boxes.array, atol=1e-9)


@pytest.mark.parametrize("reach_m", [3.0, 20.0, 100.0, 1e4, 1e7])
@pytest.mark.parametrize("classes", [1, 3])
def test_rows_are_matched_as_hungarian_matches_all_pairs_of_a_class(reach_m: float, classes: int) -> None:
    rng = np.random.default_rng(int(reach_m) + classes)
    for _ in range(50):
        own, other = (
            np.column_stack([rng.uniform(-reach_m, reach_m, (n, 2)), rng.normal(size=n), rng.uniform(0.3, 9, (n, 4))])
            for n in rng.integers(0, 25, 2)
        )
        same = rng.integers(0, min(len(own), len(other)) + 1)  # objects that both see
        other[:same] = own[:same] + rng.normal(0, 1, (same, 7)) * [0.6, 0.6, 1, 0.05, 0.05, 0.05, 0.2]
        label, other_label = rng.integers(0, classes, len(own)), rng.integers(0, classes, len(other))
        score, other_score = rng.random(len(own)), rng.random(len(other))
        affinity = np.where(label[:, None] == other_label, giou_bev(own, other), -np.inf)
        own_row, giou = match_boxes(
            ScoredBoxes(own, score, label), ScoredBoxes(other, other_score, other_label), Likeness(False, 0.0)
        )
        for gate in (-1.0, -0.2, 0.14):
            rows, columns = hungarian(affinity, gate)
            assert np.flatnonzero(giou >= gate).tolist() == sorted(columns.tolist())
            assert own_row[columns].tolist() == rows.tolist()
