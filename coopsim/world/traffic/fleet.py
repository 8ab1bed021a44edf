"""The state of all vehicles: one row and one route each."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from coopsim.geometry.se3 import Floats
from coopsim.support.arrays import dtype_of
from coopsim.support.kernels import njit
from coopsim.types import Ints

HIGHWAY, TOWN, CHAUFFEURED, PARKED, PEDALLED, UNYIELDING, STEERED = range(7)
"""Drivers: with lane changes by MOBIL; along a route, with a look ahead and junctions; an agent's maneuvers; none; an
agent's accelerations along a route; as in town, but without notice of right of way, stop lines and limits; an agent's
accelerations and steering, wherever they lead."""


class Vehicle(Protocol):
    """A row of a fleet."""

    id: int  # of the actor
    driver: int  # `HIGHWAY`, `TOWN`, `CHAUFFEURED`, `PARKED`, `PEDALLED`, `UNYIELDING` or `STEERED`
    model: int  # index into the world's models
    x: float  # of the body's center, m
    y: float  # of the body's center, m
    heading: float  # rad
    speed: float  # along the heading, m/s
    length: float  # m
    width: float  # m
    axle_m: float  # from the center to either axle; half the length, as in highway-env, except for buses
    steering: float  # of the front wheels, rad, in the last step
    acceleration: float  # m/s2, in the last step
    lane: int  # the closest
    target_lane: int  # the one it follows, or is changing to
    target_speed: float  # m/s
    time_wanted: float  # gap to the vehicle in front, s
    lateral_gain: float  # of the lane keeping, 1/s
    timer: float  # time since it last considered changing lanes, s
    crashed: bool  # has touched another body; brakes, and stays
    pushed: bool  # a collision moves it in the next step, by (push_x, push_y) m
    push_x: float  # m
    push_y: float  # m
    route_length: int  # how many roads of its route are valid
    turn_key: int  # decides all its turns
    turns: int  # how many it has drawn
    stays: bool  # turns only where its way never has to end
    ends: bool  # stops where its way ends
    movement: int  # over the junction, that it asks for; -1: none
    ticket: int  # see `coopsim.world.traffic.right_of_way`
    left: int  # 1 + the curved movement that its tail has not left yet; 0: none
    wheel: float  # angle of a steered car's front wheels, rad; `steering` is less where they slide
    grip: float  # coefficient of friction of a steered car's tyres
    astray: bool  # a steered car is on no lane, or against it, and asks for no movement
    against: bool  # a steered car is on lanes, which all lead the other way
    over: int  # 1 + the movement that an agent's car began last; 0: none
    red_lights: int  # how many of them it has begun at red


class Body(Protocol):
    """An obstacle: a vehicle or a person."""

    x: float  # m
    y: float  # m
    heading: float  # rad; of a person the direction of walking
    speed: float  # along it, m/s
    length: float  # m
    width: float  # m
    dir_x: float  # of the heading
    dir_y: float  # of the heading
    crashed: bool  # is a wreck
    steered: bool  # goes wherever an agent steers it


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
        position = np.empty((len(self.rows), 2))
        position[:, 0], position[:, 1] = self.rows["x"], self.rows["y"]
        return position

    @property
    def velocity(self) -> Floats:
        """Velocities (N, 2) of the centers, m/s, with the slip aside by steering, which highway-env's omits."""
        course = self.rows["heading"] + np.arctan(np.tan(self.rows["steering"]) / 2)
        speed, velocity = self.rows["speed"], np.empty((len(self.rows), 2))
        velocity[:, 0], velocity[:, 1] = np.cos(course) * speed, np.sin(course) * speed
        return velocity


def bodies_of(rows: NDArray[Any], people: NDArray[Any]) -> NDArray[Any]:
    """Return all obstacles (N + M,) `BODY`: vehicles, then people."""
    bodies = np.empty(len(rows) + len(people), dtype=BODY)
    bodies[len(rows) :] = people
    _copy(rows, bodies)
    bodies["dir_x"], bodies["dir_y"] = np.cos(bodies["heading"]), np.sin(bodies["heading"])
    return bodies


@njit(cache=True, nogil=True)
def _copy(rows: NDArray[Any], bodies: NDArray[Any]) -> None:
    """Copy vehicles to the first bodies, all but their directions."""
    for k in range(len(rows)):
        body, vehicle = bodies[k], rows[k]
        body.x, body.y, body.heading, body.speed = vehicle.x, vehicle.y, vehicle.heading, vehicle.speed
        body.length, body.width = vehicle.length, vehicle.width
        body.crashed, body.steered = vehicle.crashed, vehicle.driver == STEERED
