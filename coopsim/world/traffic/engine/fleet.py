"""Everything there is to know of the vehicles: a row each, and a route each."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from coopsim.geometry.se3 import Floats
from coopsim.types import Ints
from coopsim.world.traffic.engine.records import dtype_of

PLAIN, HIGHWAY, TOWN, CHAUFFEURED, PARKED = range(5)
"""Who drives: highway-env's `IDMVehicle` as it is, one of `coopsim.world.traffic.highway_reference.drivers`, or
nobody."""


class Vehicle(Protocol):
    """A row of a fleet.

    Attributes:
        id: of the actor.
        driver: who drives.
        model: index into the world's models.
        x: of the body's middle, m.
        y: of the body's middle, m.
        heading: rad.
        speed: along the heading, m/s.
        length: m.
        width: m.
        axle_m: from the middle to either axle; half the length, as in highway-env, unless the ends reach beyond them.
        steering: of the front wheels, rad, in the last step.
        acceleration: m/s2, in the last step.
        lane: the closest.
        target_lane: the one it follows, or is changing to.
        target_speed: m/s.
        time_wanted: gap to the vehicle in front, s.
        lateral_gain: of the lane keeping, 1/s.
        timer: s since it last thought of changing lanes.
        crashed: has touched somebody; brakes, and stays.
        pushed: a collision moves it in the next step, by (push_x, push_y) m.
        push_x: m.
        push_y: m.
        route_length: how many roads of its route count.
        turn_key: decides all its turns.
        turns: how many it has drawn.
        movement: over the junction, that it asks for; -1: none.
        ticket: see `coopsim.world.traffic.engine.right_of_way`.
    """

    id: int
    driver: int
    model: int
    x: float
    y: float
    heading: float
    speed: float
    length: float
    width: float
    axle_m: float
    steering: float
    acceleration: float
    lane: int
    target_lane: int
    target_speed: float
    time_wanted: float
    lateral_gain: float
    timer: float
    crashed: bool
    pushed: bool
    push_x: float
    push_y: float
    route_length: int
    turn_key: int
    turns: int
    movement: int
    ticket: int


class Body(Protocol):
    """What drivers see of each other and of people.

    Attributes:
        x: m.
        y: m.
        heading: rad; of a person the direction of walking.
        speed: along it, m/s.
        length: m.
        width: m.
        dir_x: of the heading.
        dir_y: of the heading.
        crashed: is a wreck.
    """

    x: float
    y: float
    heading: float
    speed: float
    length: float
    width: float
    dir_x: float
    dir_y: float
    crashed: bool


VEHICLE, BODY = dtype_of(Vehicle), dtype_of(Body)


@dataclass(slots=True, eq=False)
class Fleet:
    """N vehicles.

    Attributes:
        rows: (N,) `VEHICLE`.
        routes: (N, K, 2) the roads that a vehicle will take, the one it is on first, and the lane's number on each
            (-1: any); only the first `route_length` of a row count.
    """

    rows: NDArray[Any]
    routes: Ints

    def __len__(self) -> int:
        return len(self.rows)

    @property
    def position(self) -> Floats:
        """(N, 2) m."""
        return np.column_stack([self.rows["x"], self.rows["y"]])

    @property
    def velocity(self) -> Floats:
        """(N, 2) m/s, of the body's middle: who steers also slips aside, which highway-env's `velocity` leaves out."""
        course = self.rows["heading"] + np.arctan(np.tan(self.rows["steering"]) / 2)
        speed = self.rows["speed"]
        return np.column_stack([np.cos(course) * speed, np.sin(course) * speed])


def bodies_of(rows: NDArray[Any], people: NDArray[Any]) -> NDArray[Any]:
    """What there is to run into, (N + M,) `BODY`: vehicles, then people."""
    bodies = np.empty(len(rows) + len(people), dtype=BODY)
    bodies[len(rows) :] = people
    for name in ("x", "y", "heading", "speed", "length", "width", "crashed"):
        bodies[name][: len(rows)] = rows[name]
    bodies["dir_x"], bodies["dir_y"] = np.cos(bodies["heading"]), np.sin(bodies["heading"])
    return bodies
