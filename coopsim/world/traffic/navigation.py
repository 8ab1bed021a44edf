"""Ways of steered cars to their goals, and the lanes on which others take them to be."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from coopsim.errors import InvalidValueError
from coopsim.geometry.se3 import Floats
from coopsim.support.arrays import sealed, unchecked
from coopsim.support.kernels import njit
from coopsim.support.rng import stream
from coopsim.types import Ints
from coopsim.types.driving import GIVES_WAY, NO_LIGHT, YELLOW, Route
from coopsim.world.traffic.asked import can_stop
from coopsim.world.traffic.beside import lanes_beside
from coopsim.world.traffic.entries import entering
from coopsim.world.traffic.fleet import STEERED, Fleet
from coopsim.world.traffic.lane_geometry import local_coordinates
from coopsim.world.traffic.lanes import LaneArrays
from coopsim.world.traffic.movements import FIRST, Movements
from coopsim.world.traffic.obstacles import Kerbs, Obstacles
from coopsim.world.traffic.rules import SAME_WAY
from coopsim.world.traffic.steered import DRY, WHEELBASE, is_against, is_on_lane
from coopsim.world.traffic.way_ahead import BEFORE_LINE_M, REACH_M, SPACING_M, points_ahead

ROUTE_M = (200.0, 2000.0)
"""Usual bounds of the distance to a goal along the lanes."""

_SHORTEST_M, _LONGEST_M = 10.0, 10_000.0
_WALKS = 12  # draws of a way; places may end sooner
_BESIDE_M = 1.0  # farther than this outside its lane a car is not on its way
_ENTERS_M = 40  # junctions farther ahead need no care yet
_BACK_M, _ON_M = 30, 100  # where a car is looked for on its way, from where it was before


def checked_route(route_m: object) -> tuple[float, float]:
    """Return bounds of the distance to a goal, m, as a tuple; raise `InvalidValueError` for others."""
    numbers = list(route_m) if isinstance(route_m, (tuple, list)) else []
    if len(numbers) == 2 and all(isinstance(each, (int, float)) for each in numbers):
        low, high = map(float, numbers)
        if _SHORTEST_M <= low <= high <= _LONGEST_M:
            return low, high
    raise InvalidValueError(
        f"route_m must be two distances in m, the least first, in [{_SHORTEST_M:g}, {_LONGEST_M:g}], got {route_m!r}"
    )


class Way:
    """The way of one car from its start to its goal, as a navigation map has it.

    Args:
        network: the roads.
        movements: movements over junctions.
        row: the car, at the start.
        roads: numbers of the roads of the way, the car's own first.
        length_m: distance to the goal along the lanes.
    """

    def __init__(
        self, network: LaneArrays, movements: Movements, row: Any, roads: Sequence[int], length_m: float
    ) -> None:
        start, route = row.copy().reshape(1), np.column_stack([roads, np.full(len(roads), -1)])
        start["route_length"] = len(roads)
        count = math.ceil((length_m + REACH_M) / SPACING_M) + 1
        found = points_ahead(network, movements, start, 0, route, SPACING_M, count, obeys=False)
        self._points = found.points + np.array([float(row["x"]), float(row["y"])])
        self._limit_m_s, self._rights, self._lanes, self._places = (
            found.limit_m_s,
            found.rights,
            found.lanes,
            found.places,
        )
        self._roads, self._length_m, self._network = np.array(roads), length_m, network
        self._width_m = sealed(found.width_m)
        self._beside = sealed(lanes_beside(network, self._points, self._lanes, movements.of_road >= 0))
        self._movements = movements.of_road[network.lanes["road"][self._lanes]]
        self._lines = np.flatnonzero(np.diff(self._lanes, prepend=self._lanes[0]))
        self._at, self._entering = 0, dict[int, Floats]()

    def follow(self, row: Any, route: Ints) -> None:
        """Take note of where a car is, and of the lane and the roads that others take it to be on and to drive to."""
        self._at = self._nearest(row)
        road, place = self._network.lanes["road"][row["lane"]], self._places[self._at]
        on = np.flatnonzero(self._roads[place : place + 2] == road)
        row["target_lane"], row["route_length"] = row["lane"], 0
        if len(on) or self._is_near(row):
            place += on[0] if len(on) else 0
            ahead = self._roads[place : place + len(route)]
            row["target_lane"] = row["lane"] if len(on) else self._lanes[self._at]
            route[: len(ahead), 0], route[: len(ahead), 1], row["route_length"] = ahead, -1, len(ahead)
        row["astray"] = not is_on_lane(self._network, row, row["target_lane"])

    def ahead(self, row: Any, movements: Movements) -> Route:
        """Return the way ahead of the car, in its own frame, with lights as they are now."""
        self._at = self._nearest(row)
        part = slice(self._at, self._at + round(REACH_M / SPACING_M) + 1)
        limit_m_s, rights = self._limit_m_s[part].copy(), self._rights[part].copy()
        movement = self._movements[part]
        lights = np.where(movement >= 0, movements.light[movement], NO_LIGHT) if movements.light.any() else 0 * movement
        first, end = np.searchsorted(self._lines, [self._at + 1, self._at + len(movement)])
        for line in (self._lines[first:end] - self._at).tolist():
            if lights[line] >= YELLOW and can_stop(row, line * SPACING_M):
                # The line is between this point and the one before; limits are 0 from a point before the stop on.
                stop = max(math.floor(line - 1 - (row["length"] / 2 + BEFORE_LINE_M) / SPACING_M), 0)
                limit_m_s[stop:], rights[stop:] = 0.0, GIVES_WAY
                break
        cos, sin = math.cos(row["heading"]), math.sin(row["heading"])
        points = (self._points[part] - [row["x"], row["y"]]) @ np.array([[cos, -sin], [sin, cos]])
        goal_m = self._length_m - self._at * SPACING_M
        return unchecked(
            Route,
            points=points,
            spacing_m=SPACING_M,
            speed_limit_m_s=limit_m_s,
            right_of_way=rights,
            lane_width_m=self._width_m[part],
            beside=self._beside[part],
            lights=lights,
            goal_m=goal_m,
            length_m=self._length_m,
        )

    def entries(self, row: Any, movements: Movements) -> Floats:
        """Return places (A, 5) on lanes across the way ahead, in the car's own frame; see `Occlusions.entries`."""
        part = slice(self._at, self._at + _ENTERS_M)
        crossed, first = np.unique(self._movements[part], return_index=True)
        found = [np.zeros((0, 5))]
        for movement, line in zip(crossed.tolist(), first.tolist(), strict=True):
            if movement >= 0 and line > 0:
                at = self._entering.get(movement)
                if at is None:
                    at = self._entering[movement] = entering(self._network, movements, movement)
                open_ = ~movements.closed[at[:, 4].astype(int)] & (movements.role[movement] != FIRST)
                line_m = line * SPACING_M - row["length"] / 2
                found.append(np.column_stack([at[open_, :4], np.full(open_.sum(), line_m)]))
        entries = np.concatenate(found)
        cos, sin = math.cos(row["heading"]), math.sin(row["heading"])
        entries[:, :2] = (entries[:, :2] - [row["x"], row["y"]]) @ np.array([[cos, -sin], [sin, cos]])
        return entries

    def _nearest(self, row: Any) -> int:
        first = max(self._at - _BACK_M, 0)
        last = len(self._points) - round(REACH_M / SPACING_M)  # the goal is the last place to be
        return int(_nearest(self._points, first, min(self._at + _ON_M, last), row["x"], row["y"]))

    def _is_near(self, row: Any) -> bool:
        """Return whether the car is beside its way, and headed along it."""
        at = self._at
        step = self._points[at + 1] - self._points[at]
        apart_m = math.hypot(*(self._points[at] - [row["x"], row["y"]]))
        along = step[0] * math.cos(row["heading"]) + step[1] * math.sin(row["heading"])
        most_m = self._network.lanes["width"][self._lanes[at]] / 2 + _BESIDE_M
        return bool(apart_m < most_m and along > SAME_WAY * math.hypot(*step))


@njit(cache=True, nogil=True)
def _nearest(points: Floats, first: int, last: int, x: float, y: float) -> int:
    """Return the first of the nearest points, from `first` to before `last`, to a place."""
    nearest, least = first, np.inf
    for k in range(first, last):
        right, up = points[k, 0] - x, points[k, 1] - y
        apart = right * right + up * up
        if apart < least:
            nearest, least = k, apart
    return nearest


def draw_roads(
    network: LaneArrays, first: Sequence[int], behind_m: float, wanted_m: float, rng: np.random.Generator
) -> tuple[list[int], float]:
    """Draw a way that turns at random, and takes no road twice where another leads on.

    Args:
        network: the roads.
        first: roads that it begins with, at least one.
        behind_m: length of the first one that is behind the car.
        wanted_m: length of the way.
        rng: source of the turns.

    Returns:
        The longest of a few ways, at most `wanted_m` and 100 m long, and its length, m.
    """
    best, best_m = list(first), -math.inf
    for _ in range(_WALKS):
        roads = list(first)
        length_m = sum(_length_m(network, road) for road in roads) - behind_m
        while length_m < wanted_m + REACH_M:
            road = network.roads[roads[-1]]
            ways = network.ways[road["first_way"] :][: road["inner_ways"] or road["ways"]].tolist()
            if not ways:
                break
            new = [way for way in ways if way not in roads]
            roads.append((new or ways)[rng.integers(len(new or ways))])
            length_m += _length_m(network, roads[-1])
        if length_m > best_m:
            best, best_m = roads, length_m
        if best_m >= wanted_m + REACH_M:
            break
    return best, best_m


def _length_m(network: LaneArrays, road: int) -> float:
    return float(network.lanes["length"][network.roads["first_lane"][road]])


class SteeredCars:
    """The cars of a fleet that agents steer.

    Args:
        fleet: their axles and their grip are set.
        network: the roads.
        movements: movements over junctions.
        obstacles: bodies that cars do not pass.
        kerbs: makes the kerbs that one car mounts; None: there are none.
        seed: decides their ways.
        route_m: bounds of the distance to a goal.
        grip: coefficient of friction.
    """

    def __init__(
        self,
        fleet: Fleet,
        network: LaneArrays,
        movements: Movements,
        obstacles: Obstacles,
        kerbs: Callable[[], Kerbs] | None,
        seed: int,
        route_m: tuple[float, float] = ROUTE_M,
        grip: float = DRY,
    ) -> None:
        self._obstacles, self._ways, self._network = obstacles, dict[int, Way](), network
        self._kerbs, self._hits = dict[int, Kerbs](), dict[int, str]()
        for k in np.flatnonzero(fleet.rows["driver"] == STEERED).tolist():
            row, rng = fleet.rows[k], stream(seed, "route", str(k))
            row["axle_m"], row["grip"] = WHEELBASE * row["length"] / 2, grip
            lane = network.lanes[row["target_lane"]]
            behind_m = local_coordinates(lane, network.corners, row["x"], row["y"])[0]
            given = fleet.routes[k, : row["route_length"], 0].tolist() or [int(lane["road"])]
            wanted_m = rng.uniform(*route_m)
            roads, length_m = draw_roads(network, given, behind_m, wanted_m, rng)
            self._ways[k] = Way(network, movements, row, roads, max(min(wanted_m, length_m), 1.0))
            if kerbs is not None:
                self._kerbs[k] = kerbs()

    def find(self, fleet: Fleet) -> None:
        """Put them on the lanes where they are, before a step."""
        for k, way in self._ways.items():
            way.follow(fleet.rows[k], fleet.routes[k])

    def judge(self, rows: NDArray[Any]) -> None:
        """After a step note who goes against the traffic, slow down on kerbs, and let cars crash into obstacles."""
        for k in self._ways:
            row = rows[k]
            row["against"] = is_against(self._network, row)
            if row["crashed"]:
                continue
            if k in self._kerbs:
                self._kerbs[k].slow(row)
            if hit := self._obstacles.met(row):
                row["crashed"], self._hits[k] = True, hit

    def hit(self, k: int) -> str:
        """Return the obstacle that the car in a row has crashed into, "" for none."""
        return self._hits.get(k, "")

    def has(self, k: int) -> bool:
        """Return whether the car in a row is one of them."""
        return k in self._ways

    def way_ahead(self, fleet: Fleet, k: int, movements: Movements) -> Route:
        """Return the way ahead of the car in a row, in its own frame."""
        return self._ways[k].ahead(fleet.rows[k], movements)

    def entries(self, fleet: Fleet, k: int, movements: Movements) -> Floats:
        """Return places on lanes across the way ahead of the car in a row; see `Way.entries`."""
        return self._ways[k].entries(fleet.rows[k], movements)

    def release(self, fleet: Fleet, k: int, driver: int) -> None:
        """Hand the car in a row to the traffic model."""
        row = fleet.rows[k]
        row["driver"], row["astray"], row["route_length"], row["target_lane"] = driver, False, 0, row["lane"]
        row["target_speed"] = row["speed"]
        del self._ways[k]
