"""Affinities of boxes: values worked out by hand, and what holds for any boxes."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from coopsim.geometry.boxes import Boxes3D
from coopsim.geometry.iou import axial_xiou, center_distance_bev, fgam, giou_3d, xiou
from coopsim.geometry.se3 import SE3

CAR = [0.0, 0, 0, 4, 2, 1.5, 0]
SYMMETRIC = (xiou, axial_xiou, center_distance_bev, fgam)

metres = st.floats(-15, 15)
size = st.floats(0.1, 12)
box = st.tuples(metres, metres, metres, size, size, size, st.floats(-7, 7)).map(np.array)
boxes = st.lists(box, min_size=1, max_size=4).map(np.stack)


def car(**changes: float) -> np.ndarray:
    order = ("x", "y", "z", "l", "w", "h", "yaw")
    return np.array([[changes.get(name, value) for name, value in zip(order, CAR, strict=True)]])


@pytest.mark.parametrize(
    ("other", "expected"),
    [
        (car(), 1.0),
        (car(yaw=np.pi), 0.0),
        (car(l=2, w=4, yaw=np.pi / 2), 0.5),  # the same box, said otherwise
        (car(x=4), 0.5),  # side by side: GIoU 0
        (car(x=2), (1 / 3 + 1) / 2),
        (car(x=8), (-1 / 3 + 1) / 2),  # a third of the enclosing box is empty
    ],
)
def test_xiou_by_hand(other: np.ndarray, expected: float) -> None:
    np.testing.assert_allclose(xiou(car(), other), [[expected]], atol=1e-12)


@pytest.mark.parametrize(
    ("other", "expected"),
    [
        (car(), 1.0),
        (car(z=9, h=4, yaw=1), 1.0),  # heights and headings do not count
        (car(x=1, y=2), 0.5),  # the diagonal is sqrt(20)
        (car(x=4, y=2), 0.0),  # just possible
        (car(x=4.001, y=2), -np.inf),
        (car(x=1, l=0.8, w=0.6), 0.0),  # the smaller box decides
        (car(x=1.001, l=0.8, w=0.6), -np.inf),
        (car(l=0, w=0), -np.inf),
    ],
)
def test_fgam_by_hand(other: np.ndarray, expected: float) -> None:
    np.testing.assert_allclose(fgam(car(), other), [[expected]], atol=1e-12)
    np.testing.assert_allclose(fgam(other, car()), [[expected]], atol=1e-12)


@given(boxes, boxes)
def test_axial_xiou_is_the_larger_of_both_ways_to_face(a: np.ndarray, b: np.ndarray) -> None:
    around = b + np.pi * (np.arange(7) == 6)
    np.testing.assert_allclose(axial_xiou(a, b), np.maximum(xiou(a, b), xiou(a, around)), atol=1e-9)


def test_distance_by_hand() -> None:
    np.testing.assert_allclose(center_distance_bev(car(), car(x=3, y=-4, z=7)), [[-5.0]])


@pytest.mark.parametrize("count", [0, 2])
def test_no_boxes_give_empty_matrices(count: int) -> None:
    many, none = np.repeat(car(), count, axis=0), np.zeros((0, 7))
    for affinity in SYMMETRIC:
        assert affinity(many, none).shape == (count, 0)
        assert affinity(none, many).shape == (0, count)


@given(boxes, boxes)
def test_symmetric_and_bounded(a: np.ndarray, b: np.ndarray) -> None:
    for affinity in SYMMETRIC:
        np.testing.assert_allclose(affinity(a, b), affinity(b, a).T, atol=1e-9)
    assert ((xiou(a, b) >= 0) & (xiou(a, b) <= 1)).all()
    assert (xiou(a, b) <= (giou_3d(a, b) + 1) / 2 + 1e-12).all()
    assert (center_distance_bev(a, b) <= 0).all()
    aligned = fgam(a, b)
    assert (((aligned >= 0) & (aligned <= 1)) | (aligned == -np.inf)).all()


@given(boxes, boxes, metres, metres, metres, st.floats(-7, 7))
def test_moving_and_turning_the_world_changes_nothing(
    a: np.ndarray, b: np.ndarray, x: float, y: float, z: float, turn: float
) -> None:
    move = SE3.from_xyz_yaw([x, y, z], turn)
    p, q = (Boxes3D.from_array(rows).transform(move).array for rows in (a, b))
    np.testing.assert_allclose(xiou(p, q), xiou(a, b), atol=1e-6)
    np.testing.assert_allclose(center_distance_bev(p, q), center_distance_bev(a, b), atol=1e-6)
    # At the limit of what is possible rounding decides; a pair is compared where both say it is possible.
    moved, still = fgam(p, q), fgam(a, b)
    both = np.isfinite(moved) & np.isfinite(still)
    np.testing.assert_allclose(moved[both], still[both], atol=1e-6)
    assert (np.fmax(moved, still)[~both] < 1e-6).all()
