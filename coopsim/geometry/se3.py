"""Rigid transforms, named `dst_SE3_src`: they take coordinates in `src` to coordinates in `dst`.

Frames follow ROS: REP-103 (x forward, y left, z up; angles counter-clockwise) and REP-105 (`world` is
the map frame, `odom` drifts, `base` moves with the agent).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from coopsim.support.arrays import Floats as Floats
from coopsim.support.arrays import frozen, sealed


def wrap_angle(angle_rad: ArrayLike) -> Floats:
    """Wrap angles to [-pi, pi)."""
    return (np.asarray(angle_rad, dtype=np.float64) + np.pi) % (2 * np.pi) - np.pi


@dataclass(frozen=True, slots=True, eq=False)
class SE3:
    """A rigid transform of 3D space.

    Attributes:
        rotation: (3, 3), orthonormal, determinant 1.
        translation: (3,) m.
    """

    rotation: Floats
    translation: Floats

    def __post_init__(self) -> None:
        object.__setattr__(self, "rotation", frozen(self.rotation, (3, 3), np.float64, "rotation"))
        object.__setattr__(self, "translation", frozen(self.translation, (3,), np.float64, "translation"))

    @classmethod
    def trusted(cls, rotation: Floats, translation: Floats) -> SE3:
        """Make a transform without a check, of new or read-only float64 arrays that are known to fit."""
        transform = object.__new__(cls)
        object.__setattr__(transform, "rotation", sealed(rotation))
        object.__setattr__(transform, "translation", sealed(translation))
        return transform

    @classmethod
    def identity(cls) -> SE3:
        """Return the transform that changes nothing."""
        return cls(np.eye(3), np.zeros(3))

    @classmethod
    def from_xyz_yaw(cls, xyz_m: ArrayLike, yaw_rad: float) -> SE3:
        """Return a gravity-aligned pose: translation (3,) m and heading about z."""
        cos, sin = np.cos(yaw_rad), np.sin(yaw_rad)
        return cls(np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]]), np.asarray(xyz_m))

    @property
    def yaw(self) -> float:
        """Heading about z, rad, in [-pi, pi] (`wrap_angle` maps pi to -pi)."""
        return float(np.arctan2(self.rotation[1, 0], self.rotation[0, 0]))

    def inverse(self) -> SE3:
        """Return `src_SE3_dst`."""
        return SE3.trusted(self.rotation.T, -self.rotation.T @ self.translation)

    def compose(self, other: SE3) -> SE3:
        """Chain transforms: `a_SE3_b.compose(b_SE3_c)` is `a_SE3_c`."""
        return SE3.trusted(self.rotation @ other.rotation, self.rotation @ other.translation + self.translation)

    def apply(self, points_m: ArrayLike) -> Floats:
        """Transform points (..., 3) from src to dst."""
        return self.rotate(points_m) + self.translation

    def rotate(self, vectors: ArrayLike) -> Floats:
        """Rotate vectors (..., 3), velocities or directions, from src to dst; they are not translated."""
        return _turned(vectors, self.rotation)

    def rotate_planar(self, vectors: ArrayLike) -> Floats:
        """Rotate horizontal vectors (..., 2) by the planar part (exact when gravity-aligned)."""
        return _turned(vectors, self.rotation[:2, :2])


def _turned(vectors: ArrayLike, rotation: Floats) -> Floats:
    # Not by @: BLAS would take several threads for a sweep, stall where cores are busy, and may round differently for
    # another number of threads.
    turned: Floats = np.einsum("...j,ij->...i", np.asarray(vectors, dtype=np.float64), rotation)
    return turned
