"""The state of all vehicles: one row and one route each."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from coopsim.geometry.se3 import Floats
from coopsim.types import Ints
from coopsim.world.traffic.engine.records import dtype_of

HIGHWAY, TOWN, CHAUFFEURED, PARKED = range(4)
"""Drivers: with lane changes by MOBIL; along a route, with a look ahead and junctions; a policy; none."""


class Vehicle(Protocol):
    """A row of a fleet.

    Attributes:
        id: of the actor.
        driver: `HIGHWAY`, `TOWN`, `CHAUFFEURED` or `PARKED`.
        model: index into the world's models.
        x: of the body's center, m.
        y: of the body's center, m.
        heading: rad.
        speed: along the heading, m/s.
        length: m.
        width: m.
        axle_m: from the center to either axle; half the length, as in highway-env, unless the ends extend beyond them.
        steering: of the front wheels, rad, in the last step.
        acceleration: m/s2, in the last step.
        lane: the closest.
        target_lane: the one it follows, or is changing to.
        target_speed: m/s.
        time_wanted: gap to the vehicle in front, s.
        lateral_gain: of the lane keeping, 1/s.
        timer: time since it last considered changing lanes, s.
        crashed: has touched another body; brakes, and stays.
        pushed: a collision moves it in the next step, by (push_x, push_y) m.
        push_x: m.
        push_y: m.
        route_length: how many roads of its route are valid.
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
    """An obstacle: a vehicle or a person.

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
        routes: (N, K, 2) roads that each vehicle will take, its present one first, and its lane's number on each (-1:
            any); only the first `route_length` of a row are valid.
    """

    rows: NDArray[Any]
    routes: Ints

    def __len__(self) -> int:
        return len(self.rows)

    @property
    def position(self) -> Floats:
        """Centers (N, 2), m."""
        return np.column_stack([self.rows["x"], self.rows["y"]])

    @property
    def velocity(self) -> Floats:
        """Velocities (N, 2) of the centers, m/s, with the slip aside by steering, which highway-env's omits."""
        course = self.rows["heading"] + np.arctan(np.tan(self.rows["steering"]) / 2)
        speed = self.rows["speed"]
        return np.column_stack([np.cos(course) * speed, np.sin(course) * speed])


def bodies_of(rows: NDArray[Any], people: NDArray[Any]) -> NDArray[Any]:
    """Return all obstacles (N + M,) `BODY`: vehicles, then people."""
    bodies = np.empty(len(rows) + len(people), dtype=BODY)
    bodies[len(rows) :] = people
    for name in ("x", "y", "heading", "speed", "length", "width", "crashed"):
        bodies[name][: len(rows)] = rows[name]
    bodies["dir_x"], bodies["dir_y"] = np.cos(bodies["heading"]), np.sin(bodies["heading"])
    return bodies
