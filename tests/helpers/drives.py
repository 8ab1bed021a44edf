"""Drives made by hand: a car on a straight road along x, and objects that move as functions of time."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from coopsim.geometry.boxes import Boxes3D
from coopsim.metrics import DriveFrame, DriveLog, Evaluator, summarize
from coopsim.types import GroundTruth, Tracks
from coopsim.types.driving import CarState, Route

DT_S = 0.1
CAR, PEDESTRIAN = 0, 7
LENGTH_M, WIDTH_M = 4.5, 1.9
SIZES = {CAR: (4.5, 1.9, 1.5), PEDESTRIAN: (0.5, 0.5, 1.8)}


@dataclass(frozen=True)
class Thing:
    """An object whose middle is at `at(t)` and looks along `yaw`; seen by the car from `seen_s` on, tracked from
    `tracked_s` on."""

    label: int
    at: Callable[[float], tuple[float, float]]
    yaw: float = 0.0
    seen_s: float = 0.0
    tracked_s: float = 0.0
    conflicts: bool = False


def straight(x: float, y: float, vx: float, vy: float) -> Callable[[float], tuple[float, float]]:
    return lambda t: (x + vx * t, y + vy * t)


def drive(
    accelerations: Sequence[float],
    things: Sequence[Thing] = (),
    *,
    speed: float = 10.0,
    crashed: bool = False,
    limits: Callable[[float], float] = lambda x: 10.0,
    tracks: Callable[[float], Tracks] | None = None,
    route: Callable[[float], Mapping[str, Any]] = lambda x: {},
    state: Callable[[float], Mapping[str, Any]] = lambda x: {},
    left: Callable[[float], tuple[bool, bool]] = lambda x: (False, False),
    way_m: Callable[[float], float] = lambda x: 0.0,
) -> DriveLog:
    """Log a drive from x = 0 on with an acceleration in each step; `crashed`: in the last frame.

    `route`, `state` and `left` are further fields of `Route`, `CarState` and `DriveFrame` where the middle is at x,
    and `way_m` is how far to the left of the car its way then is.
    """
    log, x = DriveLog(), 0.0
    before = 0.0
    for k, acceleration in enumerate([*accelerations, 0.0]):
        t, last = k * DT_S, k == len(accelerations)
        ways, legal = np.arange(101.0), np.array([limits(x + s) for s in range(101)])
        points, rights = np.column_stack([ways, np.full(101, way_m(x))]), np.zeros(101, np.int64)
        way = Route(points, 1.0, legal, rights, lane_width_m=np.full(101, 4.0), **route(x))
        car = CarState(speed, before, LENGTH_M, WIDTH_M, crashed and last, way, **state(x))
        truth, reported = _around(things, t, x)
        log.append(
            DriveFrame(
                round(t * 1e9),
                np.array([x, 0.0, 0.0]),
                car,
                truth,
                Tracks.empty() if last else tracks(t) if tracks else reported,
                conflict_ids=tuple(number + 1 for number, each in enumerate(things) if each.conflicts),
                left=left(x),
            )
        )
        after = max(speed + acceleration * DT_S, 0.0)
        before, x, speed = (after - speed) / DT_S, x + speed * DT_S, after
    return log


def _around(things: Sequence[Thing], t: float, x: float) -> tuple[GroundTruth, Tracks]:
    rows = [[each.at(t)[0] - x, each.at(t)[1], 0.9, *SIZES[each.label], each.yaw] for each in things]
    boxes = Boxes3D.from_array(np.reshape(rows, (-1, 7)))
    moved = [np.subtract(each.at(t + 1e-3), each.at(t)) * 1e3 for each in things]
    velocity = np.reshape(moved, (-1, 2))
    ids, label = np.arange(1, len(things) + 1), np.array([each.label for each in things], np.int64)
    seen = np.array([0 if t >= each.seen_s - 1e-9 else 2 for each in things], np.int64)
    truth = GroundTruth(ids, boxes, label, seen, velocity)
    known = np.flatnonzero([t >= each.tracked_s - 1e-9 for each in things])
    return truth, Tracks(ids[known] + 70, boxes[known], velocity[known], np.ones(len(known)), label[known])


def scored(*drives: DriveLog) -> Mapping[str, float]:
    """Return the values of a score with these drives."""
    return summarize([Evaluator().log], records={"drives": drives}).values
