"""The engine that steps highway-env's own objects: what the arrays are checked against, and for lanes of any kind."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from highway_env.road.road import Road
from highway_env.vehicle.objects import RoadObject
from numpy.typing import NDArray

from coopsim.types import Ints
from coopsim.types.maneuvers import MANEUVERS
from coopsim.world.places.layout import CLEARANCE_M
from coopsim.world.places.layout import Road as RoadIndex
from coopsim.world.traffic.engine.fleet import CHAUFFEURED, HIGHWAY, PARKED, TOWN, Fleet
from coopsim.world.traffic.engine.lanes import Network
from coopsim.world.traffic.highway_reference.drivers import (
    Chauffeured,
    Driver,
    HighwayDriver,
    Parked,
    SizedVehicle,
    TownDriver,
)
from coopsim.world.traffic.highway_reference.junction import Junction

_DRIVERS: dict[int, type[SizedVehicle]] = {
    HIGHWAY: HighwayDriver,
    TOWN: TownDriver,
    CHAUFFEURED: Chauffeured,
    PARKED: Parked,
}


class _Body(RoadObject):  # type: ignore[misc]
    """A person as cars see one: an obstacle that moves. A car that touches it is crashed."""

    def __init__(self, road: Road, row: NDArray[Any]) -> None:
        super().__init__(road, (row["x"], row["y"]))
        self.LENGTH, self.WIDTH = float(row["length"]), float(row["width"])
        self.diagonal = np.hypot(self.LENGTH, self.WIDTH)


class ReferenceEngine:
    """As `ArrayEngine`, with the same arguments."""

    def __init__(
        self,
        network: Network,
        movements: Sequence[RoadIndex] = (),
        speeds_m_s: Sequence[float] = (),
        priority: Sequence[RoadIndex] = (),
        clearance_m: float = CLEARANCE_M,
    ) -> None:
        self._network, self._speeds = network, tuple(speeds_m_s)
        self._road = Road(network.source)
        self._junction = Junction(network.source, movements, priority, clearance_m) if movements else None
        self._ids: list[int] = []

    def step(self, fleet: Fleet, people: NDArray[Any], dt_s: float, told: Mapping[int, int]) -> None:
        self._take(fleet, people)
        vehicles: list[SizedVehicle] = self._road.vehicles
        for row, maneuver in told.items():
            vehicles[row].act(MANEUVERS[maneuver].upper())
        if self._junction is not None:
            commanded = [vehicle for vehicle in vehicles if isinstance(vehicle, Chauffeured)]
            self._junction.update(vehicles, commanded)
        self._road.act()
        self._road.step(dt_s)
        self._give(fleet)

    def _take(self, fleet: Fleet, people: NDArray[Any]) -> None:
        """What others decide: who is there, how fast drivers want to go, where people are."""
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

    def _give(self, fleet: Fleet) -> None:
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
        vehicle.route = [(*self._network.roads[road], None) for road, _ in route[: row["route_length"]]]
        if isinstance(vehicle, Driver):
            vehicle.TIME_WANTED = float(row["time_wanted"])
        if isinstance(vehicle, TownDriver) and self._junction is not None:
            vehicle.junction = self._junction
        if isinstance(vehicle, Chauffeured):
            vehicle.choose_among(self._speeds)
        return vehicle
