"""Rigid transforms, named `dst_SE3_src`: they take coordinates in `src` to coordinates in `dst`.

Frames follow ROS: REP-103 (x forward, y left, z up; angles counter-clockwise) and REP-105 (`world` is
the map frame, `odom` drifts, `base` moves with the agent).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from coopsim.support.arrays import Floats as Floats
from coopsim.support.arrays import Ints, frozen, sealed
from coopsim.support.kernels import njit


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


def rotation_about(axis: int, angle_rad: float) -> Floats:
    """Return the rotation (3, 3) about x (0), y (1) or z (2)."""
    rotation = np.eye(3)
    a, b = (axis + 1) % 3, (axis + 2) % 3
    rotation[a, a] = rotation[b, b] = np.cos(angle_rad)
    rotation[b, a] = np.sin(angle_rad)
    rotation[a, b] = -rotation[b, a]
    return rotation


@dataclass(frozen=True, slots=True, eq=False)
class SE3Batch:
    """M rigid transforms, each as one `SE3`; every method gives the same bits as the `SE3`s one by one.

    Attributes:
        rotation: (M, 3, 3), orthonormal, determinant 1; C-contiguous.
        translation: (M, 3) m; C-contiguous.
    """

    rotation: Floats
    translation: Floats

    @classmethod
    def of(cls, transforms: Sequence[SE3]) -> SE3Batch:
        """Stack transforms."""
        rotation, translation = np.empty((len(transforms), 3, 3)), np.empty((len(transforms), 3))
        for number, each in enumerate(transforms):
            rotation[number], translation[number] = each.rotation, each.translation
        return cls(rotation, translation)

    @classmethod
    def from_xyz_yaw(cls, xyz_yaw: Floats) -> SE3Batch:
        """Return gravity-aligned poses from rows (M, 4): x, y, z m and heading rad."""
        cos, sin = np.cos(xyz_yaw[:, 3].copy()), np.sin(xyz_yaw[:, 3].copy())
        rotation = np.zeros((len(xyz_yaw), 3, 3))
        rotation[:, 0, 0], rotation[:, 0, 1], rotation[:, 1, 0], rotation[:, 1, 1] = cos, -sin, sin, cos
        rotation[:, 2, 2] = 1.0
        return cls(rotation, xyz_yaw[:, :3].copy())

    @property
    def yaw(self) -> Floats:
        """(M,) headings about z, rad, in [-pi, pi]."""
        yaw: Floats = np.arctan2(self.rotation[:, 1, 0].copy(), self.rotation[:, 0, 0].copy())
        return yaw

    def __len__(self) -> int:
        return len(self.rotation)

    def __getitem__(self, number: int) -> SE3:
        return SE3(self.rotation[number], self.translation[number])

    def take(self, numbers: Sequence[int]) -> SE3Batch:
        """Return the transforms of these numbers, in their order."""
        rows = np.array(numbers, dtype=np.int64)
        return SE3Batch(self.rotation[rows], self.translation[rows])

    def seen_from(self, a_SE3_b: SE3) -> SE3Batch:
        """Chain transforms: of M `b_SE3_c`, return the M `a_SE3_c`."""
        moved = (a_SE3_b.rotation @ self.translation[:, :, None])[:, :, 0] + a_SE3_b.translation
        return SE3Batch(a_SE3_b.rotation @ self.rotation, moved)

    def with_first(self, first: SE3) -> SE3Batch:
        """Return these transforms behind another one."""
        rotation = np.concatenate([first.rotation[None], self.rotation])
        return SE3Batch(rotation, np.concatenate([first.translation[None], self.translation]))

    def rotate_planar(self, vectors: Floats, number: Ints) -> Floats:
        """Rotate each of N horizontal vectors (N, 2) by the transform of its number (N,) in 0..M - 1."""
        turned: Floats = np.einsum("nj,nij->ni", vectors, self.rotation[number, :2, :2])
        return turned

    def apply(self, points_m: Floats, number: Ints) -> Floats:
        """Transform each of N points (N, 3) by the transform of its number (N,) in 0..M - 1."""
        moved = points_m.copy()
        _apply(self.rotation, self.translation, number, moved)
        return moved


@njit(cache=True, nogil=True)
def _apply(rotation: Floats, translation: Floats, number: Ints, points: Floats) -> None:
    """Transform each of N points (N, 3) in place, in the order of operations of `SE3.apply`."""
    for row in range(len(points)):
        turn, shift = rotation[number[row]], translation[number[row]]
        x, y, z = points[row]
        for axis in range(3):
            points[row, axis] = x * turn[axis, 0] + y * turn[axis, 1] + z * turn[axis, 2] + shift[axis]
