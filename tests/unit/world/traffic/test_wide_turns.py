"""Vehicles on curved lanes, as maps have them: axles and turns of long ones, and who waits before a fork."""

from __future__ import annotations

import numpy as np
import pytest
from lit_crossing import crossing
from test_long_vehicles import CAR, COACH, fleet_on
from worlds import make_world

from coopsim.world.custom.place import place_from
from coopsim.world.places.polyline import PolylineLane
from coopsim.world.places.road_network import RoadNetwork
from coopsim.world.scenario import make_scenario
from coopsim.world.traffic.asked import GRANTED
from coopsim.world.traffic.lanes import NumberedNetwork
from coopsim.world.traffic.movements import movements_of
from coopsim.world.traffic.right_of_way import grant
from coopsim.world.traffic.routes import plan_ahead
from coopsim.world.traffic.rules import LONG_M
from coopsim.world.world import World


def arc(radius_m: float) -> np.ndarray:
    """Return points of a quarter of a circle to the left from (0, 0), where the way leads along x."""
    angle = np.linspace(-np.pi / 2, 0.0, 10)
    return radius_m * np.column_stack([np.cos(angle), 1.0 + np.sin(angle)])


@pytest.mark.parametrize(
    ("vehicle", "radii_m", "taken"), [(COACH, (4, 12), {1}), (CAR, (4, 12), {0, 1}), (COACH, (4,), {0})]
)
def test_long_vehicles_turn_where_they_have_room(vehicle: dict, radii_m: tuple[int, ...], taken: set[int]) -> None:
    source = RoadNetwork()
    source.add_lane("in", "fork", PolylineLane([(-60, 0), (0, 0)]))
    for k, radius_m in enumerate(radii_m):
        source.add_lane("fork", f"way {k}", PolylineLane(arc(radius_m)))
    network, found = NumberedNetwork(source), set()
    for key in range(60):
        fleet = fleet_on(network, vehicle | {"route": [("in", "fork")], "along": 10.0, "speed": 5.0})
        fleet.rows["turn_key"] = key
        plan_ahead(network.arrays, fleet.rows[0], fleet.routes[0])
        found.add(int(network.roads[fleet.routes[0, 1, 0]][1][-1]))
    assert found == taken


def test_axles_of_trucks_lie_as_those_of_buses_where_lanes_are_curved() -> None:
    scenario = make_scenario(
        place_from(crossing(), "cut"), vehicles=12, truck_share=0.7, connected_cars=0, rsus=0, drones=1
    )
    for world, part in ((World(scenario, 1), 0.25), (make_world("crossing", vehicles=12, trucks=8), 0.5)):
        rows = world.fleet.rows[world.fleet.rows["length"] > LONG_M]
        assert len(rows) > 2
        np.testing.assert_allclose(rows["axle_m"], part * rows["length"])


def test_nobody_waits_for_a_vehicle_that_is_behind_it_before_another_line() -> None:
    source = RoadNetwork()
    source.add_lane("a", "fork", PolylineLane([(-80, 0), (0, 0)]))
    for k, side in enumerate((1, -1)):
        source.add_lane("fork", f"line {k}", PolylineLane([(0, 0), (8, 2.0 * side)]))
        source.add_lane(f"line {k}", "exit", PolylineLane([(8, 2.0 * side), (30, 0)]))
    network, roads = NumberedNetwork(source), [("line 0", "exit"), ("line 1", "exit")]
    fleet = fleet_on(
        network,
        *(
            CAR | {"route": [("a", "fork"), ("fork", f"line {k}"), roads[k]], "along": along, "speed": 0.0}
            for k, along in ((0, 78.0), (1, 69.0))
        ),
    )
    fleet.rows["movement"], fleet.rows["ticket"] = (0, 1), (2, 1)  # that behind asked first
    grant(network.arrays, fleet.rows, fleet.routes, movements_of(network, roads, (), 4.2))
    assert fleet.rows["ticket"][0] == GRANTED
    assert fleet.rows["ticket"][1] > GRANTED
