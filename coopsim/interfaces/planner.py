"""The seam for planners: a car's acceleration, from what its policy reports and what the car knows of itself."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass

from coopsim.config.spec import instantiate, parse_spec
from coopsim.errors import InvalidValueError
from coopsim.support.registry import Registry
from coopsim.support.user_code import class_at
from coopsim.types import Tracks
from coopsim.types.driving import Route


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


class Planner(ABC):
    """The driver of one car for one episode: one object for each car and episode, so it may keep state."""

    @abstractmethod
    def plan(self, car: PlannedCar) -> float:
        """Return the acceleration along the route until the next call, m/s².

        It is cut to `LARGEST_BRAKING_M_S2` and `LARGEST_ACCELERATION_M_S2`; a car follows with `JERK_M_S3`.
        """


PLANNERS: Registry[type[Planner]] = Registry("planner", home="coopsim.planning.idm_aeb", group="coopsim.planners")
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
