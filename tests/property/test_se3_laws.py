"""Rigid transforms form a group, and boxes move with them."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from coopsim.geometry.boxes import Boxes3D
from coopsim.geometry.se3 import SE3, wrap_angle

metres = st.floats(-200, 200)
radians = st.floats(-10, 10)
poses = st.builds(lambda x, y, z, yaw: SE3.from_xyz_yaw([x, y, z], yaw), metres, metres, metres, radians)
points = st.lists(st.tuples(metres, metres, metres), min_size=1, max_size=5).map(np.array)


@given(poses, poses, poses, points)
def test_composition_is_associative(a: SE3, b: SE3, c: SE3, p: np.ndarray) -> None:
    left, right = a.compose(b).compose(c), a.compose(b.compose(c))
    np.testing.assert_allclose(left.apply(p), right.apply(p), atol=1e-8)
    np.testing.assert_allclose(left.apply(p), a.apply(b.apply(c.apply(p))), atol=1e-8)


@given(poses, points)
def test_inverse_undoes(a: SE3, p: np.ndarray) -> None:
    np.testing.assert_allclose(a.inverse().apply(a.apply(p)), p, atol=1e-8)
    np.testing.assert_allclose(a.compose(a.inverse()).apply(p), p, atol=1e-8)


@given(poses, metres, metres, radians)
def test_corners_of_moved_boxes_are_moved_corners(a: SE3, x: float, y: float, yaw: float) -> None:
    boxes = Boxes3D.from_array([[x, y, 1.0, 4.5, 1.9, 1.6, yaw]])
    np.testing.assert_allclose(boxes.transform(a).corners, a.apply(boxes.corners), atol=1e-8)


@given(st.floats(-100, 100))
def test_wrapped_angles_are_the_same_direction(angle: float) -> None:
    wrapped = float(wrap_angle(angle))
    assert -np.pi <= wrapped < np.pi
    np.testing.assert_allclose([np.cos(wrapped), np.sin(wrapped)], [np.cos(angle), np.sin(angle)], atol=1e-12)
