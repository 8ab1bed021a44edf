"""Many rigid transforms at once, a struct of arrays."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from coopsim.geometry.boxes import Boxes3D
from coopsim.geometry.se3 import SE3, Floats, wrap_angle
from coopsim.support.arrays import Ints
from coopsim.support.kernels import njit


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

    def boxes(self, boxes: Boxes3D, number: Ints) -> Boxes3D:
        """Return each of N boxes in the frame to which the transform of its number (N,) in 0..M - 1 takes it."""
        center = boxes.center.copy()
        _apply(self.rotation, self.translation, number, center)
        return Boxes3D.trusted(center, boxes.size, wrap_angle(boxes.yaw + self.yaw[number]))


@njit(cache=True, nogil=True)
def _apply(rotation: Floats, translation: Floats, number: Ints, points: Floats) -> None:
    """Transform each of N points (N, 3) in place, in the order of operations of `SE3.apply`."""
    for row in range(len(points)):
        turn, shift = rotation[number[row]], translation[number[row]]
        x, y, z = points[row]
        for axis in range(3):
            points[row, axis] = x * turn[axis, 0] + y * turn[axis, 1] + z * turn[axis, 2] + shift[axis]
