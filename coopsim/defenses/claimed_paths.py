"""Paths of the objects that each sender claims, and what of them no body can do: slide sideways, or leap."""

from __future__ import annotations

import numpy as np

from coopsim.geometry.se3 import SE3, Floats
from coopsim.interfaces.defense import Claim
from coopsim.interfaces.guard import MOST_SENDERS
from coopsim.types import NS_PER_S, Mask

_WINDOW, _FEWEST = 12, 10
"""Messages in a path, and the fewest of which anything is said: of a second, at 10 Hz."""

_LATE, _EARLY, _SLIDES = 3, 7, 8
"""Messages whose mean is the present place of an object, those that say how it moved before, and those over which it
slides: over eight in 0.8 s places
that err by 0.3 m give a speed that errs by 0.46 m/s, `0.3 sqrt(12 / 8^3) / 0.1` (Bar-Shalom, Li and Kirubarajan,
"Estimation with Applications to Tracking and Navigation", 2001)."""

_YAW_RAD = 0.17
"""Error of a heading, 10 degrees: by that much of its speed a vehicle that drives seems to slide."""

_FASTER_M_S = 1.0
"""Growth of speed of what leaps: braking is harder than any start, and no leap."""

_SAME_M, _FORGOTTEN_S, _MOST_OBJECTS = 1.5, 1.0, 512
"""Largest distance of an object from where it was before, time after which it is forgotten, and most of a sender."""

_VEHICLE_M = 3.0
"""Length from which a body cannot go sideways: people and two-wheelers are shorter."""


class ClaimedPaths:
    """Places of each sender's objects in its last messages, in the receiver's odometry frame."""

    def __init__(self) -> None:
        self._known: dict[str, Floats] = {}  # (K, W, 3): x, y m and time s, the newest last; NaN: none

    def add(self, claim: Claim, odom_SE3_base: SE3, time_ns: int) -> tuple[Floats, Floats]:
        """Take in a message.

        Args:
            claim: the message.
            odom_SE3_base: the receiver's place.
            time_ns: now.

        Returns:
            The speed (N,) m/s at which each object slides across its heading, if it is a vehicle, and by how much (N,)
            m it has leapt: from where its speed before would have it, if it got faster. 0: nothing is known.
        """
        boxes = claim.detections.boxes
        place = odom_SE3_base.apply(boxes.center)[:, :2]
        paths = self._joined(claim, place, time_ns / NS_PER_S - claim.age_s)
        yaw = boxes.yaw + odom_SE3_base.yaw
        speed = _fit(paths[:, -_SLIDES:])[1]
        across, along = (
            np.abs(np.einsum("nd,nd->n", speed, np.column_stack(axis)))
            for axis in ((-np.sin(yaw), np.cos(yaw)), (np.cos(yaw), np.sin(yaw)))
        )
        slides = np.maximum(across - _YAW_RAD * along, 0.0)
        enough = np.isfinite(paths[:, :, 2]).sum(axis=1) >= _FEWEST
        leaps = _leaps(paths) * enough
        return np.where(enough & (boxes.size[:, 0] >= _VEHICLE_M), slides, 0.0), leaps

    def _joined(self, claim: Claim, place: Floats, now_s: float) -> Floats:
        """Return the paths (N, W, 3) of places (N, 2), and remember them if the message is new."""
        known = self._known.pop(claim.sender, np.zeros((0, _WINDOW, 3)))
        known = known[known[:, -1, 2] >= now_s - _FORGOTTEN_S]
        paths = np.full((len(place), _WINDOW, 3), np.nan)
        paths[:, -1] = np.column_stack([place, np.full(len(place), now_s)])
        gone = known
        if len(known) and len(place):
            ahead, speed = _fit(known[:, -_SLIDES:])
            since_s = now_s - _mean_times(known[:, -_SLIDES:])[:, None]
            apart = np.linalg.norm(place[:, None] - (ahead + speed * since_s)[None], axis=2)
            nearest, rows = apart.argmin(axis=1), np.arange(len(place))
            same = (apart[rows, nearest] <= _SAME_M) & (apart.argmin(axis=0)[nearest] == rows)
            paths[same, :-1] = known[nearest[same], 1:] if claim.is_new else known[nearest[same], :-1]
            gone = np.delete(known, nearest[same], axis=0)
        self._known[claim.sender] = np.concatenate([paths, gone])[:_MOST_OBJECTS] if claim.is_new else known
        while len(self._known) > MOST_SENDERS:
            self._known.pop(next(iter(self._known)))
        return paths


def _leaps(paths: Floats) -> Floats:
    """Return by how much (N,) m objects are away from where the speed of the older part of their paths leads.

    What starts with 3 m/s² is 0.7 m away then, and what leaps by 0.3 m a message 0.9 m with the fourth.
    """
    before, speed = _fit(paths[:, :_EARLY])
    then_s = _mean_times(paths[:, :_EARLY])
    now, late_s = _fit(paths[:, -_LATE:])[0], _mean_times(paths[:, -_LATE:])
    leap: Floats = np.linalg.norm(now - before - speed * (late_s - then_s)[:, None], axis=1)
    newest = _fit(paths[:, -_LATE - 2 :])[1]
    faster: Mask = np.linalg.norm(newest, axis=1) > np.linalg.norm(speed, axis=1) + _FASTER_M_S
    return np.where(faster, leap, 0.0)


def _mean_times(paths: Floats) -> Floats:
    known = np.isfinite(paths[:, :, 2])
    total = np.where(known, paths[:, :, 2], 0.0).sum(axis=1)
    means: Floats = total / np.maximum(known.sum(axis=1), 1)
    return means


def _fit(paths: Floats) -> tuple[Floats, Floats]:
    """Return the mean places (N, 2) and speeds (N, 2) m/s of least squares of paths (N, W, 3) with gaps; 0 for none."""
    known = np.isfinite(paths[:, :, 2])
    count = np.maximum(known.sum(axis=1), 1)[:, None]
    place = np.where(known[:, :, None], paths[:, :, :2], 0.0)
    mean = place.sum(axis=1) / count
    time = np.where(known, paths[:, :, 2] - _mean_times(paths)[:, None], 0.0)
    spread = (time**2).sum(axis=1)[:, None]
    slope = (time[:, :, None] * place).sum(axis=1) / np.where(spread > 0, spread, 1.0)
    return mean, np.where(spread > 0, slope, 0.0)
