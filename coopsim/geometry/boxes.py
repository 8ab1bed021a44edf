"""Upright 3D boxes, a struct of arrays."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from coopsim.errors import InvalidValueError
from coopsim.geometry.se3 import SE3, Floats, SE3Batch, wrap_angle
from coopsim.support.arrays import Ints, frozen, require_finite, sealed


@dataclass(frozen=True, slots=True, eq=False)
class Boxes3D:
    """N upright boxes in one frame.

    Attributes:
        center: (N, 3) m, the middle of each box.
        size: (N, 3) m: length (along x of the box), width (y), height (z).
        yaw: (N,) rad, heading about z.
    """

    center: Floats
    size: Floats
    yaw: Floats

    def __post_init__(self) -> None:
        center = frozen(self.center, (None, 3), np.float64, "center")
        object.__setattr__(self, "center", center)
        object.__setattr__(self, "size", frozen(self.size, (len(center), 3), np.float64, "size"))
        object.__setattr__(self, "yaw", frozen(self.yaw, (len(center),), np.float64, "yaw"))

    @classmethod
    def trusted(cls, center: Floats, size: Floats, yaw: Floats) -> Boxes3D:
        """Make boxes without a check, of new or read-only float64 arrays that are known to have these shapes."""
        boxes = object.__new__(cls)
        object.__setattr__(boxes, "center", sealed(center))
        object.__setattr__(boxes, "size", sealed(size))
        object.__setattr__(boxes, "yaw", sealed(yaw))
        return boxes

    @classmethod
    def empty(cls) -> Boxes3D:
        """Return no boxes."""
        return cls.from_array(np.zeros((0, 7)))

    @classmethod
    def from_array(cls, array: ArrayLike) -> Boxes3D:
        """Make boxes from rows (N, 7): x, y, z, l, w, h, yaw."""
        rows = frozen(array, (None, 7), np.float64, "boxes")
        return cls.trusted(rows[:, :3], rows[:, 3:6], rows[:, 6])

    @classmethod
    def concatenate(cls, parts: Iterable[Boxes3D]) -> Boxes3D:
        """Join the boxes of all parts, in order; no parts give no boxes."""
        whole = list(parts)
        if not whole:
            return cls.empty()
        center, size = np.concatenate([part.center for part in whole]), np.concatenate([part.size for part in whole])
        return cls.trusted(center, size, np.concatenate([part.yaw for part in whole]))

    @property
    def array(self) -> Floats:
        """(N, 7): x, y, z, l, w, h, yaw."""
        rows = np.empty((len(self), 7))
        rows[:, :3], rows[:, 3:6], rows[:, 6] = self.center, self.size, self.yaw
        return rows

    @property
    def bottom(self) -> Floats:
        """(N,) m, height of the undersides."""
        height: Floats = self.center[:, 2] - self.size[:, 2] / 2
        return height

    @property
    def corners(self) -> Floats:
        """(N, 8, 3) m: bottom face counter-clockwise from front-left, then the top face alike."""
        signs = np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]]) / 2
        unit = np.concatenate([np.column_stack([signs, np.full(4, z)]) for z in (-0.5, 0.5)])
        local = unit * self.size[:, None]
        cos, sin = np.cos(self.yaw)[:, None], np.sin(self.yaw)[:, None]
        x, y = local[..., 0] * cos - local[..., 1] * sin, local[..., 0] * sin + local[..., 1] * cos
        return np.stack([x, y, local[..., 2]], axis=-1) + self.center[:, None]

    def __len__(self) -> int:
        return len(self.center)

    def __getitem__(self, index: slice | NDArray[Any]) -> Boxes3D:
        center = self.center[index]
        make = Boxes3D.trusted if center.ndim == 2 else Boxes3D  # which refuses a single row
        return make(center, self.size[index], self.yaw[index])

    def transform(self, dst_SE3_src: SE3) -> Boxes3D:
        """Return the boxes in dst; the transform must be gravity-aligned (rotation about z)."""
        center = dst_SE3_src.apply(self.center)
        return Boxes3D.trusted(center, self.size, wrap_angle(self.yaw + dst_SE3_src.yaw))

    def transform_each(self, transforms: SE3Batch, number: Ints) -> Boxes3D:
        """Return each of N boxes moved by the transform of its number (N,), with the bits of `transform`."""
        center = transforms.apply(self.center, number)
        return Boxes3D.trusted(center, self.size, wrap_angle(self.yaw + transforms.yaw[number]))

    def validate(self, what: str = "boxes") -> None:
        """Raise `InvalidValueError` unless all numbers are finite and all sizes positive."""
        if not len(self):
            return
        require_finite(self.array, what)
        if self.size.min() <= 0:
            row = int(np.argmin(self.size.min(axis=1)))
            raise InvalidValueError(f"{what}: sizes must be > 0 m, got {self.size[row].tolist()} at {row}")


def in_region(places_m: Floats, region_m: Floats | tuple[float, float]) -> NDArray[np.bool_]:
    """Return the mask (N,) of places (N, 2 or more) within a region's half length and width, in its frame."""
    inside: NDArray[np.bool_] = np.all(np.abs(places_m[:, :2]) <= region_m, axis=1)
    return inside


def covers(boxes: Boxes3D, point_m: Floats) -> NDArray[np.bool_]:
    """Return the mask (N,) of boxes that cover a point on the ground, one (2,) for all or one for each (N, 2)."""
    offset_m, beyond_m = boxes.center[:, :2] - point_m, boxes.size[:, 0] + boxes.size[:, 1]
    over: NDArray[np.bool_] = (np.abs(offset_m[:, 0]) < beyond_m) & (np.abs(offset_m[:, 1]) < beyond_m)
    near = np.flatnonzero(over)  # few; the others cannot
    (x, y), (length, width), yaw = offset_m[near].T, boxes.size[near, :2].T, boxes.yaw[near]
    cos, sin = np.cos(yaw), np.sin(yaw)
    over[near] = (np.abs(x * cos + y * sin) <= length / 2) & (np.abs(y * cos - x * sin) <= width / 2)
    return over
