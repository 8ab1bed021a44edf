"""Places that know their traffic: vehicles turn, start and come in by it."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace

import numpy as np
import pytest
from lit_crossing import crossing

from coopsim.errors import InvalidValueError
from coopsim.world.custom.place import place_from
from coopsim.world.places.description import PlaceDescription
from coopsim.world.places.road_network import RoadNetwork
from coopsim.world.scenario import make_scenario
from coopsim.world.traffic.edges import Edges
from coopsim.world.traffic.lanes import NumberedNetwork
from coopsim.world.world import World


def known(**traffic_per_h: float) -> PlaceDescription:
    """Return a crossing of streets that end, with the traffic of the lanes that lead to it."""
    place = crossing()
    traffic = {f"{node}.": each for node, each in traffic_per_h.items()}
    return replace(place, roads=tuple(replace(road, traffic_per_h=traffic.get(road.start)) for road in place.roads))


def test_roads_come_as_often_as_their_traffic_asks() -> None:
    network, roads = RoadNetwork(), [("a", "b"), ("a", "c"), ("a", "d")]
    assert network.by_traffic(roads) == roads
    network.traffic_per_h = {("a", "b"): 300.0, ("a", "c"): 100.0}
    assert Counter(network.by_traffic(roads)) == {("a", "b"): 38, ("a", "c"): 12, ("a", "d"): 1}


def test_turns_are_drawn_by_traffic() -> None:
    """Of the ways from one lane, the first has nine tenths of the traffic."""
    place = crossing()
    start = next(road.end for road in place.roads if road.start == "in0.")
    ways = [road for road in place.roads if road.start == start]
    assert len(ways) > 1
    traffic = {road: 90.0 if road is ways[0] else 10.0 / (len(ways) - 1) for road in ways}
    busy = tuple(replace(road, traffic_per_h=traffic.get(road)) for road in place.roads)
    for described, low, high in ((replace(place, roads=busy), 0.85, 0.95), (place, 0.0, 0.6)):
        network = NumberedNetwork(place_from(described, "known").make_layout().network)
        row = network.arrays.roads[network.road_number["in0.", start]]
        onward = network.arrays.ways[row["first_way"] : row["first_way"] + row["ways"]]
        share = np.mean(onward == network.road_number[ways[0].start, ways[0].end])
        assert low < share < high


def test_vehicles_come_in_by_traffic() -> None:
    layout = place_from(known(in0=10.0, in1=0.0, in2=30.0, in3=0.0), "known").make_layout()
    world = World(make_scenario(place_from(crossing(), "cut"), vehicles=1, connected_cars=0, rsus=0, drones=1), 0)
    edges = Edges(layout, NumberedNetwork(layout.network), 0)
    edges._is_seen = lambda places, seen_from: np.zeros(len(places), np.bool_)  # type: ignore[method-assign]
    world.fleet.rows["x"] = 1e4
    entries = [edges.entry(world.fleet, []) for _ in range(200)]
    counts = Counter(entry[0].lane[0] for entry in entries if entry is not None)
    assert set(counts) == {"in0.", "in2."} and 0.6 < counts["in2."] / 200 < 0.9


def test_vehicles_start_by_traffic() -> None:
    scenario = make_scenario(place_from(known(in0=1000.0), "known"), vehicles=3, connected_cars=0, rsus=0, drones=1)
    lanes = NumberedNetwork(scenario.layout.network).lane_index
    starts = Counter(lanes[k][0] for seed in range(5) for k in World(scenario, seed).fleet.rows["lane"].tolist())
    assert starts == {"in0.": 15}  # in an empty street there are starts for all


def test_traffic_is_no_negative_number() -> None:
    with pytest.raises(InvalidValueError, match="traffic_per_h must be in"):
        place_from(known(in0=-1.0), "known")
