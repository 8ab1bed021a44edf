"""Tracks that move face where they go."""

from __future__ import annotations

import numpy as np
import pytest

from coopsim.geometry.boxes import Boxes3D
from coopsim.tracking.motion.turning import face_velocity
from coopsim.types import Tracks


@pytest.mark.parametrize(
    ("yaw_rad", "velocity_m_s", "expected_rad"),
    [
        (0.1, (8.0, 0.0), 0.1),
        (0.1, (-8.0, 0.0), 0.1 + np.pi),
        (2.0, (0.0, -3.0), 2.0 + np.pi),
        (-3.0, (0.0, -3.0), -3.0),
        (0.1, (-1.9, 0.0), 0.1),  # too slow to know
    ],
)
def test_a_track_that_moves_faces_forwards(
    yaw_rad: float, velocity_m_s: tuple[float, float], expected_rad: float
) -> None:
    boxes = Boxes3D.from_array(np.array([[3.0, 4.0, 1.0, 4.5, 1.9, 1.6, yaw_rad]]))
    one = Tracks(np.array([7]), boxes, np.array([velocity_m_s]), np.array([0.9]), np.array([0]))
    faced = face_velocity(one)
    assert np.cos(faced.boxes.array[0, 6] - expected_rad) == pytest.approx(1.0)
    np.testing.assert_array_equal(faced.boxes.array[:, :6], boxes.array[:, :6])
    assert faced.id.tolist() == [7] and faced.velocity.tolist() == [list(velocity_m_s)]


def test_no_tracks_stay_none() -> None:
    assert len(face_velocity(Tracks.empty())) == 0
