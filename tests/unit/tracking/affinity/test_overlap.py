"""Affinities of boxes: values worked out by hand, and what holds for any boxes."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.distance import cdist
from scipy.stats import chi2

from coopsim.errors import InvalidValueError
from coopsim.geometry.boxes import Boxes3D
from coopsim.geometry.iou import giou_3d
from coopsim.geometry.se3 import SE3
from coopsim.tracking.affinity.overlap import center_distance_bev, fgam, mahalanobis, xiou

CAR = [0.0, 0, 0, 4, 2, 1.5, 0]
SYMMETRIC = (xiou, center_distance_bev, fgam)

metres = st.floats(-15, 15)
size = st.floats(0.1, 12)
box = st.tuples(metres, metres, metres, size, size, size, st.floats(-7, 7)).map(np.array)
boxes = st.lists(box, min_size=1, max_size=4).map(np.stack)


def car(**changes: float) -> np.ndarray:
    order = ("x", "y", "z", "l", "w", "h", "yaw")
    return np.array([[changes.get(name, value) for name, value in zip(order, CAR, strict=True)]])


def some_covariance(count: int, seed: int = 0) -> np.ndarray:
    root = np.random.default_rng(seed).normal(size=(count, 7, 7))
    return root @ root.transpose(0, 2, 1) + 0.1 * np.eye(7)


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


def test_distance_by_hand() -> None:
    np.testing.assert_allclose(center_distance_bev(car(), car(x=3, y=-4, z=7)), [[-5.0]])


def test_mahalanobis_by_hand() -> None:
    covariance = np.diag([4.0, 1, 1, 1, 1, 1, 0.25])[None]
    found = np.concatenate([car(x=4), car(x=2, y=3, h=2.5), car(yaw=np.pi), car(yaw=np.pi - 0.5)])
    np.testing.assert_allclose(mahalanobis(car(), covariance, found), [[-4, -11, 0, -1]], atol=1e-12)
    np.testing.assert_allclose(mahalanobis(car(), covariance, found, planar=True), [[-4, -10, 0, 0]], atol=1e-12)


def test_mahalanobis_agrees_with_scipy() -> None:
    rng = np.random.default_rng(1)
    tracks, found, covariance = rng.normal(size=(6, 7)), rng.normal(size=(9, 7)), some_covariance(6)
    found[:, 6] = tracks[0, 6] = 0.3  # equal headings of the first track and all found
    result = mahalanobis(tracks, covariance, found)
    expected = -(cdist(tracks[:1], found, "mahalanobis", VI=np.linalg.inv(covariance[0])) ** 2)
    np.testing.assert_allclose(result[:1], expected, rtol=1e-9)
    planar = mahalanobis(tracks, covariance, found, planar=True)
    assert (planar >= result - 1e-9).all()  # less evidence, less distance


def test_a_chi_squared_gate_lets_its_share_of_true_pairs_through() -> None:
    rng = np.random.default_rng(2)
    covariance = some_covariance(1, seed=3) * 0.01  # headings that differ by far less than half a turn
    found = rng.multivariate_normal(np.zeros(7), covariance[0], 4000)
    for planar, freedom in ((False, 7), (True, 2)):
        inside = mahalanobis(np.zeros((1, 7)), covariance, found, planar=planar) >= -chi2.ppf(0.99, freedom)
        assert abs(inside.mean() - 0.99) < 0.006


def test_mahalanobis_needs_positive_definite_covariances() -> None:
    with pytest.raises(InvalidValueError, match="positive definite"):
        mahalanobis(car(), np.zeros((1, 7, 7)), car())
    with pytest.raises(InvalidValueError, match=r"track covariance must have shape \(1, 7, 7\)"):
        mahalanobis(car(), some_covariance(2), car())


@pytest.mark.parametrize("count", [0, 2])
def test_no_boxes_give_empty_matrices(count: int) -> None:
    many, none = np.repeat(car(), count, axis=0), np.zeros((0, 7))
    for affinity in SYMMETRIC:
        assert affinity(many, none).shape == (count, 0)
        assert affinity(none, many).shape == (0, count)
    assert mahalanobis(many, some_covariance(count), none).shape == (count, 0)
    assert mahalanobis(none, some_covariance(0), many, planar=True).shape == (0, count)


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


@given(boxes, boxes, metres, metres, st.floats(-7, 7), st.booleans())
def test_mahalanobis_turns_with_the_world(
    a: np.ndarray, b: np.ndarray, x: float, y: float, turn: float, planar: bool
) -> None:
    covariance, move = some_covariance(len(a)), SE3.from_xyz_yaw([x, y, 0], turn)
    b[:, 6] = a[0, 6] + 0.1  # no difference near a quarter turn, where the sign of the shorter way is rounding
    a[:, 6] = a[0, 6]
    spin = np.eye(7)
    spin[:3, :3] = move.rotation
    p, q = (Boxes3D.from_array(rows).transform(move).array for rows in (a, b))
    turned = mahalanobis(p, spin @ covariance @ spin.T, q, planar=planar)
    np.testing.assert_allclose(turned, mahalanobis(a, covariance, b, planar=planar), rtol=1e-5, atol=1e-6)
