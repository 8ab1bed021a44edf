"""A track is false where nothing is: neither on a body nor beside one, however long and turned that is."""

from __future__ import annotations

import math

import numpy as np
import pytest

from coopsim.viz.false_tracks import is_false

TRUCK = [10.0, 5.0, 12.0, 2.5, math.pi / 2]


@pytest.mark.parametrize(
    ("x", "y", "false"),
    [
        (10.0, 5.0, False),
        (10.0, 10.9, False),  # at an end of the truck, which stands along y
        (10.0, 12.9, False),
        (10.0, 13.1, True),
        (13.2, 5.0, False),
        (13.4, 5.0, True),
        (16.0, 5.0, True),  # within half its length, but across it
    ],
)
def test_a_track_on_or_beside_a_body_is_true(x: float, y: float, false: bool) -> None:
    bodies = np.array([TRUCK, [np.nan] * 5])
    assert is_false(np.array([[x, y, 4.0, 2.0, 0.3]]), bodies).tolist() == [false]


def test_without_bodies_all_are_false_and_without_tracks_there_is_none() -> None:
    nothing = np.zeros((0, 5))
    assert is_false(np.array([TRUCK]), nothing).tolist() == [True]
    assert is_false(nothing, np.array([TRUCK])).shape == (0,)
