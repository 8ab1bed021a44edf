"""What a network is told of a box, on examples by hand."""

from __future__ import annotations

import numpy as np

from coopsim.nn.covariance.box_numbers import NUMBERS, box_numbers

BOX = np.array([[10.0, 0.0, 1.0, 4.0, 2.0, 1.5, 0.5]])
ONE, FIRST = np.array([0.7]), np.array([0])


def test_a_box_as_receiver_and_sender_see_it() -> None:
    # The sensor stands 4 m to the left of the box and looks along -y, at it.
    (row,) = box_numbers(BOX, ONE, FIRST, np.array([[10.0, 4.0, 0.5, -np.pi / 2]]))
    assert len(row) == NUMBERS
    np.testing.assert_allclose(row[:7], [10, 0, 1, 0.5, 4, 2, 1.5])
    np.testing.assert_allclose(row[7:13], [10, 10, 4, 0.5, -np.pi / 2, np.hypot(10, 4)])
    np.testing.assert_allclose(row[13:], [4, 0, 0.5, 0.5 + np.pi / 2, 4, 0.7], atol=1e-12)


def test_a_box_of_the_receiver_is_the_same_twice() -> None:
    (row,) = box_numbers(BOX, ONE, FIRST, np.zeros((1, 4)))
    assert not row[8:13].any()
    np.testing.assert_allclose(row[13:18], row[[0, 1, 2, 3, 7]])


def test_a_sensor_of_unknown_place_is_in_the_middle_of_what_it_sees_clearly() -> None:
    boxes = np.repeat(BOX, 3, axis=0)
    boxes[:, 0] = [0.0, 20.0, 500.0]
    found = box_numbers(boxes, np.array([0.9, 0.9, 0.1]), np.array([0, 0, 1]), np.full((2, 4), np.nan))
    np.testing.assert_allclose(found[:, 8], [10, 10, 500])
    np.testing.assert_allclose(found[:, 13], [-10, 10, 0])


def test_numbers_stay_finite_as_float32() -> None:
    found = box_numbers(BOX, np.array([1e300]), FIRST, np.zeros((1, 4))).astype(np.float32)
    assert np.isfinite(found).all()


def test_nothing_has_no_numbers() -> None:
    none = np.zeros((0, 7))
    assert box_numbers(none, none[:, 0], np.zeros(0, dtype=int), np.full((2, 4), np.nan)).shape == (0, NUMBERS)
