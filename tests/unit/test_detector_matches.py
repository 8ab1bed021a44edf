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


def test_undersides_are_measured_from_the_nearest_other_object() -> None:
    boxes = cars(0.1, 5.0, 12.0, 60.0).array
    boxes[:, 2] += [0.1, 0.5, 0.2, 0.0]
    truth = cars(0.0, 12.0).array
    truth[:, 2] += [0.0, -0.3]
    found = Detections(Boxes3D.from_array(boxes), np.full(4, 0.5), np.zeros(4, np.int64))
    matches = Matches()
    matches.add(0, 0, np.array([1, 2]), Boxes3D.from_array(truth), np.array([500, 300]), found)
    matches.close()
    np.testing.assert_allclose(matches.objects["off"], [0.4, 0.2], err_msg="each beside the other object")
    np.testing.assert_allclose(matches.false["off"], [0.5, np.nan], err_msg="none within 15 m of the last")
