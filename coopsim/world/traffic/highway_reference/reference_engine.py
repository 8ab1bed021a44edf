"""The engine that steps highway-env's own objects."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from highway_env.road import lane as highway_lanes
from highway_env.road import road as highway_roads
from highway_env.vehicle.objects import RoadObject
from numpy.typing import NDArray

from coopsim.types import Ints
from coopsim.types.maneuvers import MANEUVERS
from coopsim.world.places.layout import CLEARANCE_M
from coopsim.world.places.road_network import CircularLane, Road, RoadNetwork, StraightLane
from coopsim.world.traffic.engine.fleet import CHAUFFEURED, HIGHWAY, PARKED, TOWN, Fleet
from coopsim.world.traffic.engine.lanes import NumberedNetwork
from coopsim.world.traffic.engine.right_of_way import GRANTED, grant, movements_of
from coopsim.world.traffic.highway_reference.drivers import (
    Chauffeured,
    Driver,
    HighwayDriver,
    Parked,
    SizedVehicle,
    TownDriver,
)

_DRIVERS: dict[int, type[SizedVehicle]] = {
    HIGHWAY: HighwayDriver,
    TOWN: TownDriver,
    CHAUFFEURED: Chauffeured,
    PARKED: Parked,
}


class _Body(RoadObject):  # type: ignore[misc]
    """A person as an obstacle that moves; a car that touches it is crashed."""

    def __init__(self, road: highway_roads.Road, row: NDArray[Any]) -> None:
        super().__init__(road, (row["x"], row["y"]))
        self.LENGTH, self.WIDTH = float(row["length"]), float(row["width"])
        self.diagonal = np.hypot(self.LENGTH, self.WIDTH)


class ReferenceEngine:
    """Steps a fleet as `ArrayEngine` does, with the same arguments."""

    def __init__(
        self,
        network: NumberedNetwork,
        movements: Sequence[Road] = (),
        speeds_m_s: Sequence[float] = (),
        priority: Sequence[Road] = (),
        clearance_m: float = CLEARANCE_M,
    ) -> None:
        self._network, self._speeds = network, tuple(speeds_m_s)
        self._road = highway_roads.Road(_as_highway_env(network.source))
        self._movements, self._over_junctions = (
            movements_of(network, movements, priority, clearance_m),
            frozenset(movements),
        )
        self._ids: list[int] = []

    def step(self, fleet: Fleet, people: NDArray[Any], dt_s: float, maneuvers: Mapping[int, int]) -> None:
        """Advance a fleet by `dt_s`; see `ArrayEngine.step`."""
        self._read(fleet, people)
        vehicles: list[SizedVehicle] = self._road.vehicles
        for row, maneuver in maneuvers.items():
            vehicles[row].act(MANEUVERS[maneuver].upper())
        if self._over_junctions:
            self._grant(fleet)
        self._road.act()
        self._road.step(dt_s)
        self._write(fleet)

    def _read(self, fleet: Fleet, people: NDArray[Any]) -> None:
        """Take over new vehicles, target speeds, and people."""
        for k, row in enumerate(fleet.rows):
            if k == len(self._ids):
                self._ids.append(0)
                self._road.vehicles.append(None)
            if row["id"] != self._ids[k]:
                self._ids[k], self._road.vehicles[k] = row["id"], self._vehicle(row, fleet.routes[k])
            if isinstance(self._road.vehicles[k], Driver):
                self._road.vehicles[k].target_speed = row["target_speed"]
        if len(self._road.objects) != len(people):
            self._road.objects = [_Body(self._road, row) for row in people]
        for body, row in zip(self._road.objects, people, strict=True):
            body.position = np.array([row["x"], row["y"]])
            body.heading, body.speed = row["heading"], row["speed"]

    def _grant(self, fleet: Fleet) -> None:
        """Renew the right of way, which may also change routes."""
        number = self._network.road_number
        for row, route, vehicle in zip(fleet.rows, fleet.routes, self._road.vehicles, strict=True):
            planned = [number[start, end] for start, end, _ in vehicle.route or ()]
            route[: len(planned), 0], route[: len(planned), 1] = planned, -1
            row["route_length"], row["turns"] = len(planned), vehicle.turns
            row["target_lane"] = self._network.lane_number[vehicle.target_lane_index]
        grant(self._network.arrays, fleet.rows, fleet.routes, self._movements)
        for row, route, vehicle in zip(fleet.rows, fleet.routes, self._road.vehicles, strict=True):
            vehicle.route, vehicle.turns = self._named(route[: row["route_length"]]), int(row["turns"])
            vehicle.waits = row["ticket"] > GRANTED

    def _named(self, route: Ints) -> list[tuple[str, str, int | None]]:
        return [(*self._network.roads[road], None) for road, _ in route]

    def _write(self, fleet: Fleet) -> None:
        for row, vehicle in zip(fleet.rows, self._road.vehicles, strict=True):
            row["x"], row["y"] = vehicle.position
            row["heading"], row["speed"], row["crashed"] = vehicle.heading, vehicle.speed, vehicle.crashed
            row["steering"], row["acceleration"] = vehicle.action["steering"], vehicle.action["acceleration"]
            row["lane"] = self._network.lane_number[vehicle.lane_index]
            row["target_lane"] = self._network.lane_number[vehicle.target_lane_index]

    def _vehicle(self, row: NDArray[Any], route: Ints) -> SizedVehicle:
        vehicle = _DRIVERS[int(row["driver"])](
            self._road,
            (row["x"], row["y"]),
            row["heading"],
            speed=row["speed"],
            target_lane_index=self._network.lane_index[row["target_lane"]],
            target_speed=row["target_speed"],
        )
        vehicle.fit(float(row["length"]), float(row["width"]), float(row["axle_m"]), int(row["turn_key"]))
        vehicle.roads_ahead = len(route)
        vehicle.route = self._named(route[: row["route_length"]])
        if isinstance(vehicle, Driver):
            vehicle.TIME_WANTED = float(row["time_wanted"])
        if isinstance(vehicle, TownDriver):
            vehicle.movements = self._over_junctions
        if isinstance(vehicle, Chauffeured):
            vehicle.choose_among(self._speeds)
        return vehicle


def _as_highway_env(network: RoadNetwork) -> highway_roads.RoadNetwork:
    """Return the same roads as highway-env's objects."""
    converted = highway_roads.RoadNetwork()
    for (start, end, _), lane in network.lanes.items():
        usual = {"width": lane.width, "speed_limit": lane.speed_limit, "forbidden": lane.forbidden}
        if isinstance(lane, StraightLane):
            converted.add_lane(start, end, highway_lanes.StraightLane(lane.start, lane.end, **usual))
        elif isinstance(lane, CircularLane):
            # highway-env looks at y from above: its clockwise is our left turn.
            arc = (lane.center, lane.radius, lane.start_phase, lane.end_phase, lane.turn > 0)
            converted.add_lane(start, end, highway_lanes.CircularLane(*arc, **usual))
    return converted
