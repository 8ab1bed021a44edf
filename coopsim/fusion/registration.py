"""Registration of one agent's boxes with another's by the objects that both see: shift, turn, height and tilt.

Received boxes come through a relative pose that is never exact, least of all in tilt, and from a sweep that was taken
some milliseconds earlier or later, in which a car at 10 m/s moves by decimetres. `alignment` corrects a sender's pose
over ground and over time, and places all its boxes by that. Registration needs less and changes nothing: from the boxes
of one moment alone it gives the positions at which the receiver would detect the objects that it misses.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from coopsim.fusion.common_objects import turned
from coopsim.geometry.assignment import match_boxes
from coopsim.geometry.boxes import Boxes3D
from coopsim.geometry.se3 import Floats, wrap_angle
from coopsim.types import Detections, Mask

_ROUNDS, _GATE = 2, -0.2
"""Number of rounds, each matching the boxes under the registration of the round before; smallest BEV GIoU of a pair."""

_SHIFT = np.array([0.7, 0.7, np.radians(1.0)])
_RISE = np.array([0.7, 0.1, 0.1])
"""Standard deviations of the priors: x, y m and heading rad; height m, and its slopes along x and y, which in practice
the boxes alone decide."""

_NOISE_M = 0.4
"""Standard deviation of a box's own error, over ground and in height."""

_OUTLIER_M = 0.6, 0.4
"""Residual from which a pair counts little, over ground and in height: two cars, or a height without a road."""

_STEPS = 4
_FARTHEST_M = 1e5
"""Boxes farther away are ignored: their squares might overflow."""


@dataclass(frozen=True, slots=True, eq=False)
class Registration:
    """A transform that moves the other agent's boxes onto the own ones.

    Attributes:
        middle: (2,) m, centre of the turn and the tilt.
        shift: (3,) x, y m over ground, and the turn in rad.
        rise: (3,) m up at the middle, and the slopes along x and y, metres up per metre.
        common: number of objects that both agents see.
    """

    middle: Floats = field(default_factory=lambda: np.zeros(2))
    shift: Floats = field(default_factory=lambda: np.zeros(3))
    rise: Floats = field(default_factory=lambda: np.zeros(3))
    common: int = 0

    def place(self, boxes: Boxes3D) -> Boxes3D:
        """Return the boxes moved onto the own ones."""
        off = boxes.center[:, :2] - self.middle
        height = boxes.center[:, 2] + self.rise[0] + off @ self.rise[1:]
        center = np.column_stack([self.middle + self.shift[:2] + turned(off, self.shift[2]), height])
        return Boxes3D(center, boxes.size, wrap_angle(boxes.yaw + self.shift[2]))


def register(own: Detections, other: Detections) -> Registration:
    """Return the most likely registration of another agent's boxes with the own ones, in one frame.

    Pairs of a class are matched (Hungarian on the BEV GIoU), and shift and rise follow by least squares with Gaussian
    priors, each reweighted by how well pairs agree (Cauchy's weights). A turn is taken as small. Without common objects
    the registration moves nothing.
    """
    found = Registration(_middle(other.boxes))
    fitted: list[tuple[int, int]] = []
    for _ in range(_ROUNDS):
        mine, theirs = match_boxes(own.boxes, own.label, found.place(other.boxes), other.label, _GATE)
        within = _near(own.boxes[mine]) & _near(other.boxes[theirs])
        mine, theirs = mine[within], theirs[within]
        pairs = list(zip(mine.tolist(), theirs.tolist(), strict=True))
        if not pairs or pairs == fitted:  # the same pairs give the same result
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
    """Return the mean centre (2,) m over ground of the boxes that are not too far away."""
    near = boxes.center[_near(boxes), :2]
    return near.mean(axis=0) if len(near) else np.zeros(2)


def _near(boxes: Boxes3D) -> Mask:
    """Return the mask (N,) of boxes within `_FARTHEST_M` of the origin."""
    near: Mask = np.abs(boxes.center).max(axis=1, initial=0.0) <= _FARTHEST_M
    return near


def _shift(off: Floats, apart: Floats, weight: Floats) -> Floats:
    """Fit x, y (m) and the turn (rad) to gaps (N, 2) m of pairs at offsets (N, 2) m from the middle."""
    one, none = np.ones(len(off)), np.zeros(len(off))
    rows = np.stack([np.column_stack([one, none, -off[:, 1]]), np.column_stack([none, one, off[:, 0]])], axis=1)
    return _least_squares(rows, apart, weight, _SHIFT, _OUTLIER_M[0])


def _rise(off: Floats, apart: Floats, weight: Floats) -> Floats:
    """Fit height (m) and its slopes to gaps (N,) m of pairs at offsets (N, 2) m from the middle."""
    rows = np.column_stack([np.ones(len(off)), off])
    return _least_squares(rows[:, None], apart[:, None], weight, _RISE, _OUTLIER_M[1])


def _least_squares(rows: Floats, target: Floats, weight: Floats, expected: Floats, outlier_m: float) -> Floats:
    """Return the most likely x (3,) of `rows` (N, D, 3) x = `target` (N, D) m with prior deviations `expected`."""
    trusted = weight
    for _ in range(_STEPS):
        normal = np.einsum("n,ndi,ndj->ij", trusted, rows, rows) / _NOISE_M**2 + np.diag(expected**-2.0)
        found: Floats = np.linalg.solve(normal, np.einsum("n,ndi,nd->i", trusted, rows, target) / _NOISE_M**2)
        error_m = np.linalg.norm(rows @ found - target, axis=1)
        trusted = weight / (1 + (error_m / outlier_m) ** 2)
    return found
