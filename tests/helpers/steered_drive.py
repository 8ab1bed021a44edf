"""Drives of planners among others that keep their velocity, along a straight road east on y = 0."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from coopsim.geometry.boxes import Boxes3D
from coopsim.interfaces.planner import Occlusions, PlannedCar, Planner
from coopsim.types import Tracks
from coopsim.types.driving import Route
from coopsim.types.taxonomy import ObjectClass

DT_S, LENGTH_M, WIDTH_M, WHEELBASE_M = 0.1, 4.5, 1.9, 2.6
CAR_M, PERSON_M = (4.5, 1.9, 1.6), (0.6, 0.6, 1.75)


@dataclass
class Other:
    """An object: its place at the time 0 and its velocity, m and m/s; its class; from when on it is seen; its heading,
    None: along its velocity."""

    x: float
    y: float
    vx: float = 0.0
    vy: float = 0.0
    label: ObjectClass = ObjectClass.CAR
    seen_from_s: float = 0.0
    yaw: float | None = None

    @property
    def size(self) -> tuple[float, float, float]:
        return PERSON_M if self.label == ObjectClass.PEDESTRIAN else CAR_M

    @property
    def heading(self) -> float:
        return math.atan2(self.vy, self.vx) if self.yaw is None else self.yaw

    def at(self, time_s: float) -> tuple[float, float]:
        return self.x + self.vx * time_s, self.y + self.vy * time_s


def tracks_of(others: Sequence[Other], time_s: float, x: float, y: float = 0.0, yaw: float = 0.0) -> Tracks:
    """Return tracks on the others that are seen at a time, in the frame of a car at a place."""
    seen = [k for k, each in enumerate(others) if time_s >= each.seen_from_s]
    turn = np.array([[math.cos(yaw), -math.sin(yaw)], [math.sin(yaw), math.cos(yaw)]])
    known = [others[k] for k in seen]
    rows = [[*(np.subtract(each.at(time_s), (x, y)) @ turn), 0.8, *each.size, each.heading - yaw] for each in known]
    velocity = np.array([[each.vx, each.vy] for each in known]).reshape(-1, 2) @ turn
    labels = np.array([int(each.label) for each in known], dtype=np.int64)
    boxes = Boxes3D.from_array(np.array(rows).reshape(-1, 7))
    return Tracks(np.array(seen, dtype=np.int64), boxes, velocity, np.ones(len(seen)), labels)


def touches(others: Sequence[Other], time_s: float, x: float, y: float = 0.0) -> bool:
    """Return whether a car that heads along the road touches one of others, which head along it or across."""
    for each in others:
        at, across = each.at(time_s), abs(each.vy) > abs(each.vx)
        long, wide = each.size[1::-1] if across else each.size[:2]
        if abs(at[0] - x) < (long + LENGTH_M) / 2 and abs(at[1] - y) < (wide + WIDTH_M) / 2:
            return True
    return False


@dataclass
class Driven:
    """What came out, by frame: places and speeds of the car; and whether its body touched another's."""

    x: list[float] = field(default_factory=list)
    y: list[float] = field(default_factory=list)
    speed: list[float] = field(default_factory=list)
    touched: bool = False


def drive(
    planner: Planner,
    others: Sequence[Other] = (),
    *,
    speed: float = 10.0,
    seconds: float = 10.0,
    beside: tuple[int, int] = (0, 0),
    lasts_m: float = math.inf,
    walls: Sequence[Sequence[float]] = (),
    eyes: Sequence[Sequence[float]] = (),
    entries: Sequence[Sequence[float]] = (),
) -> Driven:
    """Drive; lanes `beside` last for a way. Walls, eyes and entries are of `Occlusions`, in the frame of the road."""
    x = y = yaw = acceleration = 0.0
    out = Driven()
    for k in range(round(seconds / DT_S)):
        turn = np.array([[math.cos(yaw), -math.sin(yaw)], [math.sin(yaw), math.cos(yaw)]])
        move = lambda places: (np.asarray(places, float).reshape(-1, 2) - [x, y]) @ turn  # noqa: B023, E731
        tracks = tracks_of(others, k * DT_S, x, y, yaw)
        occlusions = Occlusions(move(walls).reshape(-1, 4), move(eyes), _moved(entries, move, x))
        car = PlannedCar(
            "cav_0", round(k * DT_S * 1e9), DT_S, tracks, speed, acceleration, 0.0, LENGTH_M, WIDTH_M,
            _road(move, x, beside, lasts_m), wheelbase_m=WHEELBASE_M, occlusions=occlusions,
        )  # fmt: skip
        acceleration, angle = planner.plan(car)  # type: ignore[misc]  # it steers
        speed = max(speed + max(acceleration, -8.0) * DT_S, 0.0)
        x, y = x + speed * DT_S * math.cos(yaw), y + speed * DT_S * math.sin(yaw)
        yaw += speed * DT_S * math.tan(angle) / WHEELBASE_M
        out.touched |= touches(others, k * DT_S, x, y)
        out.x.append(x), out.y.append(y), out.speed.append(speed)
    return out


def _moved(entries: Sequence[Sequence[float]], move: object, x: float) -> np.ndarray:
    rows = np.array(entries, dtype=float).reshape(-1, 5)
    rows[:, :2], rows[:, 4] = move(rows[:, :2]), rows[:, 4] - x - LENGTH_M / 2  # type: ignore[operator]
    return rows


def _road(move: object, x: float, beside: tuple[int, int], lasts_m: float) -> Route:
    ahead = x + np.arange(101.0)
    lanes = np.where((ahead < lasts_m)[:, None], beside, 0)
    points = move(np.column_stack([ahead, 0 * ahead]))  # type: ignore[operator]
    return Route(points, 1.0, np.full(101, 13.9), np.zeros(101), np.full(101, 3.5), lanes)
