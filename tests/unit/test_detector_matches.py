"""Matches that the simulated detector is fitted to."""

import numpy as np
from detector_matches import Matches

from coopsim.geometry.boxes import Boxes3D
from coopsim.types import Detections


def cars(*x_m: float) -> Boxes3D:
    """Return boxes of cars on the x axis."""
    center = np.array([[x, 0.0, 0.8] for x in x_m])
    return Boxes3D(center, np.tile([4.5, 1.8, 1.6], (len(x_m), 1)), np.zeros(len(x_m)))


def test_a_far_false_box_takes_no_object_from_a_near_one() -> None:
    found = Detections(cars(0.1, -30.0), np.array([0.9, 0.3]), np.zeros(2, np.int64))
    matches = Matches()
    # The smallest sum of distances would pair the first box with the second object, 9.9 m away.
    matches.add(0, 0, np.array([1, 2]), cars(0.0, 10.0), np.array([500, 300]), found)
    matches.close()
    assert matches.objects["found"].tolist() == [True, False]
    assert matches.false["x"].tolist() == [-30.0]
