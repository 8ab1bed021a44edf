"""Trackers side by side behave as one, and each keeps to its classes."""

from __future__ import annotations

import numpy as np
import pytest
from some_tracks import FRAME_NS, cars

from coopsim.errors import InvalidValueError
from coopsim.tracking.ab3dmot_tracker import ab3dmot
from coopsim.tracking.by_class import TrackersByClass


def both() -> TrackersByClass:
    """Class 7 is dropped at its first miss, all others after five frames."""
    return TrackersByClass(ab3dmot(hits=1, age=5), {(7, 8): ab3dmot(hits=1, age=1)})


def test_rules_differ_by_class() -> None:
    trackers = both()
    trackers.step(cars(0, 20, 40, label=[0, 7, 8]), 0)
    assert trackers.step(cars(), FRAME_NS).label.tolist() == [0]


def test_ids_never_collide_and_are_kept() -> None:
    trackers, label = both(), [0, 7, 0, 8]
    first = trackers.step(cars(0, 20, 40, 60, label=label), 0)
    again = trackers.step(cars(60, 40, 20, 0, label=label[::-1]), FRAME_NS)
    assert len(set(first.id.tolist())) == 4
    where = [dict(zip(t.boxes.center[:, 0].round().tolist(), t.id.tolist(), strict=True)) for t in (first, again)]
    assert where[0] == where[1]


def test_a_state_can_be_gone_back_to() -> None:
    trackers = both()
    trackers.step(cars(0, 20, label=[0, 7]), 0)
    before = trackers.state
    once = trackers.step(cars(1, 20, label=[0, 7]), FRAME_NS)
    trackers.state = before
    again = trackers.step(cars(1, 20, label=[0, 7]), FRAME_NS)
    np.testing.assert_array_equal(once.boxes.array, again.boxes.array)
    np.testing.assert_array_equal(once.id, again.id)


def test_velocities_are_those_of_the_detections_own_tracks() -> None:
    trackers = both()
    for k in range(5):
        trackers.step(cars(1.0 * k, 50 - 2.0 * k, label=[0, 7]), k * FRAME_NS)
    velocity, confirmed = trackers.known(cars(40, 5, 300, label=[7, 0, 0]), 5 * FRAME_NS)
    np.testing.assert_allclose(velocity, [[-20, 0], [10, 0], [0, 0]], atol=0.1)
    assert confirmed.tolist() == [True, True, False]


def test_time_that_goes_back_changes_nothing() -> None:
    trackers = both()
    trackers.step(cars(0), FRAME_NS)
    before = trackers.state
    with pytest.raises(InvalidValueError, match="time must not go back"):
        trackers.step(cars(0), 0)
    assert trackers.state == before and trackers.time_ns == FRAME_NS


def test_no_class_has_two_trackers() -> None:
    with pytest.raises(InvalidValueError, match="class 7 has two trackers"):
        TrackersByClass(ab3dmot(), {(7,): ab3dmot(), (8, 7): ab3dmot()})
