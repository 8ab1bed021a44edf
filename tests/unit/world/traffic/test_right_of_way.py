"""Right of way by kernels is that of a second implementation, over objects."""

from __future__ import annotations

import numpy as np
import pytest
from junction_by_objects import Junction
from numpy.typing import NDArray
from worlds import make_world

from coopsim.world.places.road_network import Lane, Road
from coopsim.world.scenario import make_scenario
from coopsim.world.traffic.asked import GRANTED
from coopsim.world.traffic.fleet import PARKED
from coopsim.world.traffic.lanes import NumberedNetwork
from coopsim.world.traffic.routes import lane_of_route, plan_ahead, start_of_route


class Traveller:
    """A row of a fleet as the junction over objects sees it."""

    def __init__(self, network: NumberedNetwork, row: NDArray[np.void], route: NDArray[np.int64]) -> None:
        self._network, self._row, self._route = network, row, route

    @property
    def position(self) -> NDArray[np.float64]:
        return np.array([self._row["x"], self._row["y"]])

    @property
    def speed(self) -> float:
        return float(self._row["speed"])

    @property
    def LENGTH(self) -> float:
        return float(self._row["length"])

    def upcoming(self) -> list[tuple[Road, Lane, float]]:
        if self._row["driver"] == PARKED:
            return []
        arrays, row, roads = self._network.arrays, self._row, []
        plan_ahead(arrays, row, self._route)
        distance_m = start_of_route(arrays, row, self._route)
        for k in range(row["route_length"]):
            lane = self._network.lane_index[lane_of_route(arrays, row, self._route, k)]
            roads.append((lane[:2], self._network.source.get_lane(lane), distance_m))
            distance_m += roads[-1][1].length
        return roads

    def choose_again(self, place: int) -> None:
        self._row["route_length"] = place
        self.upcoming()


@pytest.mark.parametrize(
    ("name", "numbers"),
    [
        ("crossing", {"vehicles": 20}),
        ("roundabout", {}),
        ("t_junction", {"vehicles": 14, "buses": 8, "truck_share": 0.3}),
        ("merge", {"buses": 4}),
    ],
)
def test_the_same_vehicles_go_and_wait_in_the_same_order(name: str, numbers: dict[str, int]) -> None:
    world, layout = make_world(name, 1, **numbers), make_scenario(name).layout
    network, fleet = NumberedNetwork(layout.network), world._traffic.fleet
    rows, routes = fleet.rows.copy(), fleet.routes.copy()
    travellers = [Traveller(network, rows[k], routes[k]) for k in range(len(rows))]
    junction = Junction(layout.network, layout.movements, layout.priority, layout.clearance_m)
    waited = 0
    for _ in range(120):
        rows[:], routes[:] = fleet.rows, fleet.routes
        junction.update(travellers, [])
        world.step(0.1)
        movement, ticket = fleet.rows["movement"], fleet.rows["ticket"]
        granted = {k: movement[k] for k in np.flatnonzero((movement >= 0) & (ticket == GRANTED))}
        assert {travellers.index(vehicle): way for vehicle, way in junction._granted.items()} == granted
        waiting = sorted(np.flatnonzero(ticket > GRANTED), key=lambda k: ticket[k])
        assert [travellers.index(vehicle) for vehicle in junction._queue] == waiting
        waited += len(waiting)
    assert waited > 100
