"""The victim of an attack that aims at a planner: all that the attacker hears of it, and can try on a copy."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from coopsim.geometry.boxes import Boxes3D
from coopsim.geometry.se3 import SE3, Floats
from coopsim.interfaces.planner import PlannedCar, PlannerOption, make_planner
from coopsim.types import NS_PER_S, Detections, Ints, Mask, Tracks
from coopsim.types.driving import Route, acceleration_of

TRIED_S, _STEP_S = 0.8, 0.2
"""Time for which an attacker plays what it would say to a copy of the planner, a second less the delay of brakes; and
the least time between two questions."""

_CAR_M, _WHEELBASE_M = (4.5, 1.9), 2.7
"""Length and width of a passenger car, and its wheelbase: nobody states his own."""


@dataclass(slots=True, eq=False)
class Lines:
    """The changes of a message: what an attack says of each of N objects, and of objects of its own.

    Attributes:
        by_m: (N, 2) m by which each object is moved.
        speed: (N, 2) m/s that are added to its velocity, where messages have any.
        hidden: (N,) whether it is left out.
        score: (N,) its confidence as stated; NaN: as it is.
        added: number, row of a box, velocity, class and score of each claimed object.
    """

    by_m: Floats
    speed: Floats
    hidden: Mask
    score: Floats
    added: list[tuple[int, Floats, Floats, int, float]] = field(default_factory=list)

    @property
    def are_honest(self) -> bool:
        """True if nothing is changed."""
        return not (self.by_m.any() or self.speed.any() or self.hidden.any() or self.added)

    @classmethod
    def honest(cls, count: int) -> Lines:
        """Return no changes of so many objects."""
        return cls(np.zeros((count, 2)), np.zeros((count, 2)), np.zeros(count, np.bool_), np.full(count, np.nan))


@dataclass(eq=False)
class VictimPlan:
    """A driven car, as an attacker knows it: by its messages, the map, and own sensors. All in the car's base frame.

    Attributes:
        name: the car's name.
        time_ns: time since the episode's start.
        dt_s: time between two frames of the attacker's.
        speed_m_s: the car's speed, by its last two messages.
        route: the way ahead that the map has; straight on without a lane.
        objects: objects that the attacker itself detects or tracks, the car among them.
        id: (N,) number of each object, the same from frame to frame; -1: it is the car itself.
        velocity: (N, 2) m/s of each, by the attacker's own tracking; zero where it is unknown.
        heard: (N,) number of others in whose last message an object is there, too.
        others: objects in the last message of each other agent, by name.
        planner: the planner, for copies.
        liar_SE3_base: the car's base frame in the attacker's.
        world_SE3_base: the car's place in the world, by its messages.
        rng: random stream of the attack.
    """

    name: str
    time_ns: int
    dt_s: float
    speed_m_s: float
    route: Route
    objects: Detections
    id: Ints
    velocity: Floats
    heard: Ints
    others: dict[str, Boxes3D]
    planner: PlannerOption
    liar_SE3_base: SE3
    world_SE3_base: SE3
    rng: np.random.Generator
    lines: Lines = field(init=False)

    def __post_init__(self) -> None:
        self.lines = Lines.honest(len(self.objects))

    @property
    def time_s(self) -> float:
        """Time since the episode's start."""
        return self.time_ns / NS_PER_S

    @cached_property
    def along_m(self) -> Floats:
        """Distances (N,) of the objects along the route, ahead of the car's middle."""
        return self.route.place(self.objects.boxes.center[:, :2])[0]

    @cached_property
    def aside_m(self) -> Floats:
        """Distances (N,) of the objects to the left of the route."""
        return self.route.place(self.objects.boxes.center[:, :2])[1]

    @cached_property
    def toward(self) -> Floats:
        """Unit vectors (N, 2) from the objects to the route, across it."""
        east, north = self.route.tangents[self.route.place(self.objects.boxes.center[:, :2])[2]].T
        toward: Floats = -np.sign(self.aside_m)[:, None] * np.column_stack([-north, east])
        return toward

    def move(self, row: int, by_m: Floats, speed: Floats | None = None, score: float = math.nan) -> None:
        """Say that an object is beside its place by (2,) m, faster by (2,) m/s, and how sure that is; NaN: as it is."""
        self.lines.by_m[row], self.lines.score[row] = by_m, score
        self.lines.speed[row] = 0.0 if speed is None else speed

    def hide(self, row: int) -> None:
        """Leave an object out."""
        self.lines.hidden[row] = True

    def claim(self, number: int, box: Floats, label: int, velocity: Floats | None = None, score: float = 0.9) -> None:
        """Say that an object with a number of its own is there, by its box (7,) and class."""
        speed = np.zeros(2) if velocity is None else np.asarray(velocity, np.float64)
        self.lines.added.append((number, np.asarray(box, np.float64), speed, int(label), score))

    def answer(self, boxes: Boxes3D, velocity: Floats, label: Ints, seen_after_s: float = 0.0) -> float:
        """Return the hardest braking, m/s² below zero, by which a copy of the planner answers within `TRIED_S`.

        The copy sees nothing but these objects, which go on at their velocities, and the car at its speed.

        Args:
            boxes: N objects as they would be believed.
            velocity: (N, 2) m/s.
            label: (N,) classes.
            seen_after_s: time until the car has a track on them.
        """
        planner, answers = make_planner(self.planner), [0.0]
        for number, (now_SE3_base, route, turned) in enumerate(self._way):
            ahead_s = number * self._step_s
            if ahead_s >= seen_after_s:
                moved = boxes.center + np.column_stack([velocity * ahead_s, np.zeros(len(boxes))])
                later = Boxes3D(moved, boxes.size, boxes.yaw).transform(now_SE3_base)
                speed, score = now_SE3_base.rotate_planar(velocity), np.full(len(boxes), 0.9)
                tracks = Tracks(np.arange(len(boxes)) + 1, later, speed, score, label)
            else:
                tracks = Tracks.empty()
            answers.append(acceleration_of(planner.plan(self._car(number, tracks, route, turned))))
        return float(np.nan_to_num(min(answers)))

    def _car(self, number: int, tracks: Tracks, route: Route, turned: float) -> PlannedCar:
        time_ns, step_s = self.time_ns + round(number * self._step_s * NS_PER_S), self._step_s
        motion = (self.speed_m_s, 0.0, turned)
        return PlannedCar(self.name, time_ns, step_s, tracks, *motion, *_CAR_M, route, wheelbase_m=_WHEELBASE_M)

    @property
    def _step_s(self) -> float:
        return max(self.dt_s, _STEP_S)

    @cached_property
    def _way(self) -> list[tuple[SE3, Route, float]]:
        """Frames of the car in the next frames, as it goes on, with the route there and the turn since the last."""
        found, heading = [], 0.0
        for number in range(round(TRIED_S / self._step_s) + 1):
            place = min(
                round(number * self._step_s * self.speed_m_s / self.route.spacing_m), len(self.route.points) - 2
            )
            if not number or not place:
                found.append((SE3.identity(), self.route, 0.0))
                continue
            east, north = self.route.tangents[place]
            yaw = math.atan2(north, east)
            now_SE3_base = SE3.from_xyz_yaw(np.append(self.route.points[place], 0.0), yaw).inverse()
            found.append((now_SE3_base, _from(self.route, place, now_SE3_base), yaw - heading))
            heading = yaw
        return found


def _from(route: Route, place: int, now_SE3_base: SE3) -> Route:
    """Return the rest of a route, from one of its points on, in another frame."""
    points = np.column_stack([route.points[place:], np.zeros(len(route.points) - place)])
    return replace(
        route,
        points=now_SE3_base.apply(points)[:, :2],
        speed_limit_m_s=route.speed_limit_m_s[place:],
        right_of_way=route.right_of_way[place:],
    )
