"""Drives of planners that steer, among others that keep their velocity, along a straight road east on y = 0."""

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
    """An object: its place at the time 0 and its velocity, m and m/s; from when it is there; its class and size."""

    x: float
    y: float
    vx: float = 0.0
    vy: float = 0.0
    from_s: float = 0.0
    label: ObjectClass = ObjectClass.CAR
    yaw: float = 0.0

    @property
    def size(self) -> tuple[float, float, float]:
        return PERSON_M if self.label == ObjectClass.PEDESTRIAN else CAR_M


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
        there = [each for each in others if k * DT_S >= each.from_s]
        at = np.array([[o.x + o.vx * k * DT_S, o.y + o.vy * k * DT_S] for o in there]).reshape(-1, 2)
        turn = np.array([[math.cos(yaw), -math.sin(yaw)], [math.sin(yaw), math.cos(yaw)]])
        move = lambda places: (np.asarray(places, float).reshape(-1, 2) - [x, y]) @ turn  # noqa: B023, E731
        boxes = [[*place, 0.8, *o.size, o.yaw - yaw] for place, o in zip(move(at), there, strict=True)]
        velocity = np.array([[o.vx, o.vy] for o in there]).reshape(-1, 2) @ turn
        labels = np.array([o.label for o in there], dtype=np.int64)
        rows = Boxes3D.from_array(np.array(boxes).reshape(-1, 7))
        tracks = Tracks(np.array([others.index(o) for o in there], int), rows, velocity, np.ones(len(there)), labels)
        occlusions = Occlusions(move(walls).reshape(-1, 4), move(eyes), _moved(entries, move, x))
        car = PlannedCar(
            "cav_0", round(k * DT_S * 1e9), DT_S, tracks, speed, acceleration, 0.0, LENGTH_M, WIDTH_M,
            _road(move, x, beside, lasts_m), wheelbase_m=WHEELBASE_M, occlusions=occlusions,
        )  # fmt: skip
        acceleration, angle = planner.plan(car)  # type: ignore[misc]  # it steers
        speed = max(speed + max(acceleration, -8.0) * DT_S, 0.0)
        x, y = x + speed * DT_S * math.cos(yaw), y + speed * DT_S * math.sin(yaw)
        yaw += speed * DT_S * math.tan(angle) / WHEELBASE_M
        apart = np.abs(at - [x, y])
        reach = np.array([o.size[:2] for o in there]).reshape(-1, 2) / 2 + [LENGTH_M / 2, WIDTH_M / 2]
        out.touched |= bool((apart < reach).all(axis=1).any())
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
