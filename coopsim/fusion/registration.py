"""How one agent's boxes lie off another's, by the objects that both see: a little beside, turned, higher, tilted.

What an agent says comes through a relative pose that is never exact, least of all in tilt, and from a sweep that was
taken some milliseconds earlier or later, in which a car at 10 m/s moves on by decimetres. `alignment` corrects a
sender's pose over ground and over time, and places all it says by that. This asks less and changes nothing: it tells
from the boxes of one moment alone where the receiver would have put what it does not see.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from coopsim.fusion.box_matching import match_boxes
from coopsim.fusion.common_objects import turned
from coopsim.geometry.boxes import Boxes3D
from coopsim.geometry.se3 import Floats, wrap_angle
from coopsim.types import Detections, Mask

_ROUNDS, _GATE = 2, -0.2
"""Boxes are matched anew under what the round before found; how small the BEV GIoU of a pair may be."""

_SHIFT = np.array([0.7, 0.7, np.radians(1.0)])
_RISE = np.array([0.7, 0.1, 0.1])
"""Expected size of what is looked for: x, y m and heading rad; height m, and its slopes along x and y, which in
practice the boxes alone decide."""

_NOISE_M = 0.4
"""How far off a box is by itself, over ground and in height."""

_OUTLIER_M = 0.6, 0.4
"""From about where on a pair counts little, over ground and in height: two cars, or a height from where no road is."""

_STEPS = 4
_FARTHEST_M = 1e5
"""What is farther away tells nothing, and its squares might not be numbers."""


@dataclass(frozen=True, slots=True, eq=False)
class Registration:
    """Moves the other agent's boxes to where they lie on the own ones.

    Attributes:
        middle: (2,) m, around what they are turned and tilted.
        shift: (3,) x, y m over ground, and the turn in rad.
        rise: (3,) m up at the middle, and the slopes along x and y, metres up per metre.
        common: number of objects that both see.
    """

    middle: Floats = field(default_factory=lambda: np.zeros(2))
    shift: Floats = field(default_factory=lambda: np.zeros(3))
    rise: Floats = field(default_factory=lambda: np.zeros(3))
    common: int = 0

    def place(self, boxes: Boxes3D) -> Boxes3D:
        """Where the boxes lie on the own ones."""
        off = boxes.center[:, :2] - self.middle
        height = boxes.center[:, 2] + self.rise[0] + off @ self.rise[1:]
        center = np.column_stack([self.middle + self.shift[:2] + turned(off, self.shift[2]), height])
        return Boxes3D(center, boxes.size, wrap_angle(boxes.yaw + self.shift[2]))


def register(own: Detections, other: Detections) -> Registration:
    """The most likely registration of another agent's boxes with the own ones, in one frame; none where none is common.

    Pairs of a class are matched (Hungarian on the BEV GIoU), and shift and rise follow by least squares with Gaussian
    priors, each reweighted by how well pairs agree (Cauchy's weights). A turn is taken as small.
    """
    found = Registration(_middle(other.boxes))
    fitted: list[tuple[int, int]] = []
    for _ in range(_ROUNDS):
        mine, theirs = match_boxes(own.boxes, own.label, found.place(other.boxes), other.label, _GATE)
        within = _near(own.boxes[mine]) & _near(other.boxes[theirs])
        mine, theirs = mine[within], theirs[within]
        pairs = list(zip(mine.tolist(), theirs.tolist(), strict=True))
        if not pairs or pairs == fitted:  # the same pairs give the same again
            return found
        fitted = pairs
        weight = np.clip(np.minimum(own.score[mine], other.score[theirs]), 1e-3, 1.0)
        off = other.boxes.center[theirs, :2] - found.middle
        apart = own.boxes.center[mine] - other.boxes.center[theirs]
        apart[:, 2] = own.boxes.bottom[mine] - other.boxes.bottom[theirs]
        found = Registration(
            found.middle, _shift(off, apart[:, :2], weight), _rise(off, apart[:, 2], weight), len(mine)
        )
    return found


def _middle(boxes: Boxes3D) -> Floats:
    near = boxes.center[_near(boxes), :2]
    return near.mean(axis=0) if len(near) else np.zeros(2)


def _near(boxes: Boxes3D) -> Mask:
    near: Mask = np.abs(boxes.center).max(axis=1, initial=0.0) <= _FARTHEST_M
    return near


def _shift(off: Floats, apart: Floats, weight: Floats) -> Floats:
    one, none = np.ones(len(off)), np.zeros(len(off))
    rows = np.stack([np.column_stack([one, none, -off[:, 1]]), np.column_stack([none, one, off[:, 0]])], axis=1)
    return _least_squares(rows, apart, weight, _SHIFT, _OUTLIER_M[0])


def _rise(off: Floats, apart: Floats, weight: Floats) -> Floats:
    rows = np.column_stack([np.ones(len(off)), off])
    return _least_squares(rows[:, None], apart[:, None], weight, _RISE, _OUTLIER_M[1])


def _least_squares(rows: Floats, target: Floats, weight: Floats, expected: Floats, outlier_m: float) -> Floats:
    """Most likely x (3,) of `rows` (N, D, 3) x = `target` (N, D) m, `expected` (3,) being its standard deviations."""
    trusted = weight
    for _ in range(_STEPS):
        normal = np.einsum("n,ndi,ndj->ij", trusted, rows, rows) / _NOISE_M**2 + np.diag(expected**-2.0)
        found: Floats = np.linalg.solve(normal, np.einsum("n,ndi,nd->i", trusted, rows, target) / _NOISE_M**2)
        error_m = np.linalg.norm(rows @ found - target, axis=1)
        trusted = weight / (1 + (error_m / outlier_m) ** 2)
    return found
