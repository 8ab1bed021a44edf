"""Scripts: vehicles and people of an episode, each with a place to start and a manner to move."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from coopsim.errors import InvalidValueError
from coopsim.geometry.se3 import Floats
from coopsim.support.arrays import frozen
from coopsim.support.checks import (
    require_between,
    require_choice,
    require_finite_number,
    require_non_negative,
    require_positive,
)
from coopsim.types.taxonomy import ObjectClass
from coopsim.world.places.road_network import LaneIndex, Road

MANNERS = ("usual", "unyielding", "steady", "parked", "leaves lane")
"""Manners of scripted vehicles, see `VehicleRole`."""


@dataclass(frozen=True, slots=True)
class VehicleRole:
    """A scripted vehicle.

    Attributes:
        name: for people to read, such as "van"; `cav_0` for the ego.
        lane: lane on which it starts.
        along_m: distance of its middle from the lane's start.
        speed_m_s: speed at the start.
        route: roads that it takes, the lane's own first; afterwards turns are drawn.
        label: class of the vehicle.
        manner: "usual", a driver of the traffic engine; "unyielding", follows others but takes no notice of right of
            way, stop lines and lights; "steady", keeps its speed whatever comes; "parked", stands; "leaves lane",
            changes lane at `trigger_m` before an obstacle.
        connected: whether it is an agent.
        conflicts: whether it is what the ego may crash into.
        aside_m: distance of its middle to the left of the lane's middle; negative to the right.
        trigger_m: see `manner`.
        model: name of a model of the class, such as "panel_van"; None: one is drawn.
    """

    name: str
    lane: LaneIndex
    along_m: float
    speed_m_s: float = 0.0
    route: tuple[Road, ...] = ()
    label: ObjectClass = ObjectClass.CAR
    manner: str = "usual"
    connected: bool = False
    conflicts: bool = False
    aside_m: float = 0.0
    trigger_m: float | None = None
    model: str | None = None

    def __post_init__(self) -> None:
        require_choice("manner", self.manner, MANNERS)
        require_non_negative(speed_m_s=self.speed_m_s)


@dataclass(frozen=True, slots=True, eq=False)
class WalkRole:
    """A scripted person, who walks along a path whatever comes, and stands at its end.

    Attributes:
        name: for people to read.
        label: class of the person.
        path: (K, 2) m, K >= 2, in the world frame.
        speed_m_s: walking speed.
        starts_s: time at which the walk begins; until then the person stands at the path's start. If it is negative,
            the person is on the way already.
        conflicts: whether the person is what the ego may crash into.
    """

    name: str
    label: ObjectClass
    path: Floats
    speed_m_s: float
    starts_s: float = 0.0
    conflicts: bool = False

    def __post_init__(self) -> None:
        if len(self.path) < 2:
            raise InvalidValueError(f"path must have at least two points, got {len(self.path)}")
        object.__setattr__(self, "path", frozen(self.path, (len(self.path), 2), np.float64, "path"))
        require_positive(speed_m_s=self.speed_m_s)
        require_finite_number(starts_s=self.starts_s)


@dataclass(frozen=True, slots=True, eq=False)
class Script:
    """The vehicles and people of an episode, in place of drawn ones.

    Attributes:
        ego: the car that has to avoid the crash, agent `cav_0`.
        vehicles: all others; connected ones are agents `cav_1` and so on, in this order.
        people: scripted people.
        over_s: time at which the situation is over.
    """

    ego: VehicleRole
    vehicles: tuple[VehicleRole, ...]
    people: tuple[WalkRole, ...]
    over_s: float

    def __post_init__(self) -> None:
        require_between(0.1, 3600, over_s=self.over_s)
