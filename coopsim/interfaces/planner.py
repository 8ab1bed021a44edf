"""The seam for planners: how a car accelerates and steers, from what its policy reports and what it knows of itself."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np

from coopsim.config.spec import instantiate, parse_spec
from coopsim.errors import InvalidValueError
from coopsim.geometry.se3 import Floats
from coopsim.support.arrays import freeze
from coopsim.support.registry import Registry
from coopsim.support.user_code import class_at
from coopsim.types import Tracks
from coopsim.types.driving import Route
from coopsim.types.intents import Intents


@dataclass(frozen=True, slots=True, eq=False)
class Occlusions:
    """Knowledge of what may hide others from a car, in the car's base frame. It holds no road user.

    Attributes:
        walls: (S, 4) x and y of both ends, m, of sides of buildings and walls near the car, by the map.
        eyes: (V, 2) m, places that agents said they were at in messages that arrived last.
        entries: (A, 5) places on lanes that lead across the way ahead, to whose traffic the car may have to yield, by
            the map: x and y, m; the speed limit, m/s; the distance from there to the way of the car, m; and that along
            the car's route to the line before it, m.
    """

    walls: Floats
    eyes: Floats
    entries: Floats = field(default_factory=lambda: np.zeros((0, 5)))

    def __post_init__(self) -> None:
        freeze(self, walls=((None, 4), np.float64), eyes=((None, 2), np.float64), entries=((None, 5), np.float64))


@dataclass(frozen=True, slots=True, eq=False)
class PlannedCar:
    """Input of a planner: one car at the time of an observation.

    Attributes:
        name: the agent's name.
        time_ns: time since the episode's start.
        dt_s: time until the next call.
        tracks: the policy's report for this observation, in the car's base frame, whose origin is the car's middle.
        speed_m_s: the car's own speed.
        acceleration_m_s2: the car's own acceleration.
        turned_rad: change of the car's heading since the last call, by its odometry: tracks turn by as much against it.
        length_m: length of the car's body.
        width_m: width of the car's body.
        route: the way ahead.
        traffic_side: side of the road that vehicles keep to, "right" or "left".
        steering_rad: angle of the front wheels, of a car that the planner steers.
        wheelbase_m: distance between the axles, of which the middle is the car's, of a car that the planner steers.
        intents: ways that other road users have told, with `uplink="intents"`; `intents.at(times_s)` has their places.
        occlusions: walls, eyes and entries around it, for a planner that is `occlusion_aware`.
    """

    name: str
    time_ns: int
    dt_s: float
    tracks: Tracks
    speed_m_s: float
    acceleration_m_s2: float
    turned_rad: float
    length_m: float
    width_m: float
    route: Route
    traffic_side: str = "right"
    steering_rad: float = 0.0
    wheelbase_m: float = 0.0
    intents: Intents = field(default_factory=Intents.empty)
    occlusions: Occlusions | None = None


Plan = float | tuple[float, float]
"""An acceleration, m/s², or with it an angle of the front wheels, rad."""


class Planner(ABC):
    """The driver of one car for one episode: one object for each car and episode, so it may keep state.

    Attributes:
        steers: the planner steers, too: its car does as under `control="steering"`, and has a goal.
        occlusion_aware: the planner is told what may hide others, as `PlannedCar.occlusions`.
    """

    steers: ClassVar[bool] = False
    occlusion_aware: ClassVar[bool] = False

    @abstractmethod
    def plan(self, car: PlannedCar) -> Plan:
        """Return the acceleration along the route until the next call, m/s²; if it `steers` with the steering angle.

        Accelerations are cut to `LARGEST_BRAKING_M_S2` and `LARGEST_ACCELERATION_M_S2`, a car follows with `JERK_M_S3`;
        angles are those of the front wheels, rad, positive to the left, cut to `LARGEST_STEERING_RAD`.
        """


PLANNERS: Registry[type[Planner]] = Registry(
    "planner",
    home=("coopsim.planning.idm_aeb", "coopsim.planning.route_follower", "coopsim.planning.cautious"),
    group="coopsim.planners",
)
"""Planner classes. Installed packages add theirs through the entry-point group `coopsim.planners`."""


PlannerOption = str | Callable[[], Planner]
"""Planner by name, also with parameters, such as "idm_aeb(headway_s=2)", by the place of its class, such as
"mine.py:MyPlanner", or a class or function that makes one."""


def make_planner(planner: PlannerOption) -> Planner:
    """Make a planner; each car has its own in each episode.

    Raises:
        UnknownNameError: there is no such planner, or no such parameter.
        InvalidValueError: a parameter's value is not accepted, or the place has no class of planners.
    """
    if not isinstance(planner, str):
        if not callable(planner):
            raise InvalidValueError(f"planner must be a name, a spec or a class of planners, got {planner!r}")
        return planner()
    name, parameters = parse_spec("planner", planner, "name, name(parameter=value, ...), module:Class or file.py:Class")
    if ":" not in name:
        return instantiate("planner", name, PLANNERS.get(name), parameters)
    kind = class_at("planner", name, Planner)  # type: ignore[type-abstract]
    return instantiate("planner", name, kind, parameters)
