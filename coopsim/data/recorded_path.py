"""Path of a recording car whose files have boxes in its own frame and no poses: what stands still says it.

Unlike `coopsim.data.ego_motion`, which is causal and is given detections alone, this looks at a whole recording at
once, and knows which boxes are of one object. The unknowns are the car's poses (x_k, h_k) and the places p_j of
objects that stand. They minimize

    sum_i rho(|x_k + R(h_k) z_i - p_j| / LABEL_M)                boxes z_i of standing objects; rho is Geman-McClure's
    + sum_k |x_{k+1} - x_k - R(h_k) o_k|^2 / STEP_M^2            first estimates of steps o_k,
    + sum_k (h_{k+1} - h_k - t_k)^2 / TURN_RAD^2                 and of turns t_k
    + sum_k |x_{k+2} - 2 x_{k+1} + x_k|^2 / BENT_M^2             bounded acceleration
    + sum_k (h_{k+2} - 2 h_{k+1} + h_k)^2 / TURNED_RAD^2

by Gauss-Newton on sparse normal equations. Which boxes stand is decided anew with the poses, round by round: those
whose object moves slower than a bound, which falls.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.linalg import spsolve

from coopsim.geometry.se3 import Floats
from coopsim.types import Ints, Mask

LABEL_M = 0.05
"""Spread of a label's middle, an axis, as of parked cars; at twice of it a label counts a quarter."""

STEP_M, TURN_RAD = 0.06, 0.01
"""Spread of the first estimates, which come from detections."""

BENT_M, TURNED_RAD = 0.02, 0.004
"""Spread of the change of a step and of a turn: at 10 Hz 2 m/s^2 and 0.4 rad/s^2."""

BOUNDS_M = (1.0, 0.5, 0.3, 0.3)
"""Displacement in ten frames below which an object stands, round by round: first poses are rough."""

_HALF, _ITERATIONS = 5, 4


@dataclass(frozen=True, slots=True, eq=False)
class Sightings:
    """N boxes of objects known by name, in the car's frame; rows rise by object, then by frame.

    Attributes:
        frame: (N,) frame.
        object: (N,) name.
        place: (N, 2) m.
    """

    frame: Ints
    object: Ints
    place: Floats


@dataclass(frozen=True, slots=True, eq=False)
class RecordedPath:
    """Recovered poses of a car, in its first frame.

    Attributes:
        pose: (F, 3) x, y m and heading rad.
        standing: (N,) sightings of objects that stand.
        residual_m: (N, 2) place of a sighting in the world less that of its object; nan where it does not stand.
    """

    pose: Floats
    standing: Mask
    residual_m: Floats


def recover_path(seen: Sightings, steps: Floats) -> RecordedPath:
    """Return the car's path.

    Args:
        seen: boxes of all objects, standing or not, without the car itself.
        steps: (F, 3) first estimate of the motion since the frame before, x, y m and heading rad there; row 0 is zero.
    """
    pose = chained(steps)
    for bound_m in BOUNDS_M:
        standing, run = standing_runs(seen, in_world(seen.place, pose[seen.frame]), bound_m)
        rows = np.flatnonzero(standing)
        place = _middles(in_world(seen.place[rows], pose[seen.frame[rows]]), run)
        for _ in range(_ITERATIONS):
            pose, place = _improved(pose, place, seen.frame[rows], seen.place[rows], run, steps)
    return RecordedPath(pose, *residuals_of(seen, pose))


def residuals_of(seen: Sightings, pose: Floats) -> tuple[Mask, Floats]:
    """Return which sightings (N,) stand by poses (F, 3), and how far each lies from the mean of its run, (N, 2) m.

    The sightings need not be those by which the poses were recovered; what moves has nan.
    """
    place = in_world(seen.place, pose[seen.frame])
    standing, run = standing_runs(seen, place, BOUNDS_M[-1])
    residual_m = np.full((len(standing), 2), np.nan)
    residual_m[standing] = place[standing] - _middles(place[standing], run)[run]
    return standing, residual_m


def chained(steps: Floats) -> Floats:
    """Return poses (F, 3) in the first frame of motions (F, 3), each since the frame before."""
    heading = np.cumsum(steps[:, 2])
    moved = in_world(steps[:, :2], np.column_stack([np.zeros((len(steps), 2)), np.r_[0.0, heading[:-1]]]))
    return np.column_stack([np.cumsum(moved, axis=0), heading])


def in_world(place: Floats, pose: Floats) -> Floats:
    """Return places (N, 2) of the world from those in frames with poses (N, 3)."""
    return pose[:, :2] + _turned(place, pose[:, 2])


def standing_runs(seen: Sightings, place: Floats, bound_m: float) -> tuple[Mask, Ints]:
    """Return which sightings (N,) at world places (N, 2) stand, and for those that do the number of their run.

    A sighting stands if its object's places five rows before and after lie nearer than the bound, for as many frames.
    A run is a part of an object's rows without one that moves.
    """
    rows = np.arange(len(seen.frame))
    before, after = np.maximum(rows - _HALF, 0), np.minimum(rows + _HALF, len(rows) - 1)
    first = np.searchsorted(seen.object, seen.object)
    before = np.maximum(before, first)
    after = np.minimum(after, np.searchsorted(seen.object, seen.object, "right") - 1)
    frames = seen.frame[after] - seen.frame[before]
    moved = np.hypot(*(place[after] - place[before]).T)
    standing = (frames >= _HALF) & (moved * 2 * _HALF < bound_m * np.maximum(frames, 1))
    begins = np.r_[True, (seen.object[1:] != seen.object[:-1]) | ~standing[:-1]]
    return standing, np.unique(np.cumsum(begins)[standing], return_inverse=True)[1]


def _improved(pose: Floats, place: Floats, frame: Ints, at: Floats, run: Ints, steps: Floats) -> tuple[Floats, Floats]:
    """Return better poses (F, 3) and places of standing objects (M, 2), by one step of Gauss-Newton."""
    system = _System(3 * len(pose) + place.size)
    x, y, h = np.arange(3 * len(pose)).reshape(-1, 3).T
    px, py = (3 * len(pose) + np.arange(place.size)).reshape(-1, 2).T
    arm = _turned(at, pose[frame, 2])
    away = pose[frame, :2] + arm - place[run]
    root = 1 / (LABEL_M + (away**2).sum(axis=1) / (4 * LABEL_M))  # the root of Geman-McClure's weight
    system.add([x[frame], h[frame], px[run]], [1.0, -arm[:, 1], -1.0], away[:, 0], root)
    system.add([y[frame], h[frame], py[run]], [1.0, arm[:, 0], -1.0], away[:, 1], root)
    ahead = _turned(steps[1:, :2], pose[:-1, 2])
    off = np.diff(pose[:, :2], axis=0) - ahead
    system.add([x[1:], x[:-1], h[:-1]], [1.0, -1.0, ahead[:, 1]], off[:, 0], 1 / STEP_M)
    system.add([y[1:], y[:-1], h[:-1]], [1.0, -1.0, -ahead[:, 0]], off[:, 1], 1 / STEP_M)
    system.add([h[1:], h[:-1]], [1.0, -1.0], np.diff(pose[:, 2]) - steps[1:, 2], 1 / TURN_RAD)
    for column, spread in ((x, BENT_M), (y, BENT_M), (h, TURNED_RAD)):
        bent = np.diff(pose.ravel()[column], n=2)
        system.add([column[2:], column[1:-1], column[:-2]], [1.0, -2.0, 1.0], bent, 1 / spread)
    for column in (x, y, h):  # the first frame is the world's
        system.add([column[:1]], [1.0], pose.ravel()[column[:1]], 1e4)
    change = system.solution()
    return pose - change[: pose.size].reshape(-1, 3), place - change[pose.size :].reshape(-1, 2)


class _System:
    """Linear least squares over sparse rows."""

    def __init__(self, unknowns: int) -> None:
        self._unknowns, self._count = unknowns, 0
        self._parts: list[tuple[Floats, Ints, Ints]] = []
        self._wanted: list[Floats] = []

    def add(self, columns: list[Ints], factors: list[float | Floats], value: Floats, root: float | Floats) -> None:
        """Add rows (N,): the sum of factors times unknowns is to be `value`; `root` is the root of the weight."""
        rows = self._count + np.arange(len(value))
        for column, factor in zip(columns, factors, strict=True):
            self._parts.append((np.broadcast_to(root * factor, rows.shape), rows, column))
        self._wanted.append(root * value)
        self._count += len(value)

    def solution(self) -> Floats:
        """Return the unknowns."""
        values, rows, columns = (np.concatenate(part) for part in zip(*self._parts, strict=True))
        matrix = coo_array((values, (rows, columns)), shape=(self._count, self._unknowns)).tocsc()
        found: Floats = spsolve((matrix.T @ matrix).tocsc(), matrix.T @ np.concatenate(self._wanted))
        return found


def _middles(place: Floats, run: Ints) -> Floats:
    """Return the mean places (M, 2) of runs."""
    sums = np.column_stack([np.bincount(run, column) for column in place.T])
    mean: Floats = sums / np.bincount(run)[:, None]
    return mean


def _turned(place: Floats, heading: Floats) -> Floats:
    cos, sin = np.cos(heading), np.sin(heading)
    return np.column_stack([cos * place[:, 0] - sin * place[:, 1], sin * place[:, 0] + cos * place[:, 1]])
