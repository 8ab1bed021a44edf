"""A place cut out of a map: vehicles leave it and come in again, connected cars stay."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from lit_crossing import crossing
from test_long_vehicles import CAR, fleet_on

from coopsim.errors import InvalidValueError
from coopsim.world.custom.place import place_from
from coopsim.world.places.description import MapLane, PlaceDescription
from coopsim.world.scenario import make_scenario
from coopsim.world.traffic.edges import Edges
from coopsim.world.traffic.lanes import NumberedNetwork
from coopsim.world.world import World


def test_a_lane_may_end_only_in_a_place_that_is_cut() -> None:
    with pytest.raises(InvalidValueError, match="no road leads on"):
        place_from(replace(crossing(), cut=False), "wrong")
    assert place_from(crossing(), "cut").description.cut


def test_vehicles_that_leave_come_in_again_with_new_ids() -> None:
    scenario = make_scenario(place_from(crossing(), "cut"), vehicles=10, connected_cars=0, rsus=0, drones=1)
    world, ids = World(scenario, 2), set[int]()
    for _ in range(600):
        before = {row["id"]: (row["x"], row["y"]) for row in world.fleet.rows}
        world.step(0.1)
        for row in world.fleet.rows:
            if row["id"] in before:
                assert np.hypot(row["x"] - before[row["id"]][0], row["y"] - before[row["id"]][1]) < 2
            else:
                assert max(abs(row["x"]), abs(row["y"])) > 80  # at the beginning of a lane
        assert (np.abs(world.fleet.position) < 100).all()
        ids |= set(world.fleet.rows["id"].tolist())
    assert len(ids) > 15 and len(world.fleet) == 10 and world.crashed() == ()


def test_vehicles_come_in_out_of_sight_if_they_can() -> None:
    layout = place_from(crossing(), "cut").make_layout()
    edges = Edges(layout, NumberedNetwork(layout.network), 0)
    ways_in = np.array([lane.position(4.0, 0.0) for lane in edges._lanes])
    assert [index[0] for index in edges._entries] == ["in0.", "in1.", "in2.", "in3."]
    short = replace(crossing(), nodes=crossing().nodes | {"in0.": (26.0, 1.6)})
    edges_there = Edges(place_from(short, "cut").make_layout(), NumberedNetwork(layout.network), 0)
    assert [index[0] for index in edges_there._entries] == ["in1.", "in2.", "in3."], "12 m before a junction"
    # From the west, houses hide the north and the south, and the east is far.
    assert edges._is_seen(ways_in, np.array([[-80.0, 1.6]])).tolist() == [False, False, True, False]
    assert edges._is_seen(ways_in, np.array([[0.0, 0.0]])).all()


def ring_with_exits() -> PlaceDescription:
    """Return a street with turning loops, one way onto it, and one off it."""
    nodes = {"a": (0, -2), "b": (60, -2), "c": (60, 2), "d": (0, 2), "m": (30, -2), "x": (70.0, -30.0), "y": (-45, -2)}
    return PlaceDescription(
        nodes=nodes,
        roads=(
            MapLane("y", "a", curved=True),
            MapLane("a", "m", curved=True),
            MapLane("m", "b", curved=True),
            MapLane("m", "x", ((45.0, -6.0), (58.0, -17.0)), curved=True),
            MapLane("b", "c", turn="around"),
            MapLane("c", "d"),
            MapLane("d", "a", turn="around"),
        ),
        cut=True,
    )


def test_vehicles_come_in_as_slowly_as_those_far_ahead_ask_for() -> None:
    long = replace(crossing(), nodes=crossing().nodes | {"in0.": (190.0, 1.6)})
    layout = place_from(long, "cut").make_layout()
    network = NumberedNetwork(layout.network)
    edges = Edges(layout, network, 0)
    first = [index[0] for index in edges._entries].index("in0.")
    fleet = fleet_on(network, CAR | {"route": [("in0.", "in0")], "along": 100.0, "speed": 0.0})
    assert edges._room_m(fleet, first) == pytest.approx(100.0 - CAR["length"] / 2 - 4.0)


def test_connected_cars_turn_where_they_can_stay() -> None:
    scenario = make_scenario(place_from(ring_with_exits(), "ring"), vehicles=4, connected_cars=2, rsus=0)
    world = World(scenario, 1)
    cars = list(world._traffic.connected)
    ids = world.fleet.rows["id"][cars].tolist()
    for _ in range(900):
        world.step(0.1)
        assert (world.fleet.position[cars, 1] > -12).all()  # not on the way out, but in a turning loop
    assert world.fleet.rows["id"][cars].tolist() == ids and world.fleet.rows["id"].max() > 4
    assert len(scenario.layout.network.endless) == len(scenario.layout.network.lanes) - 1


def test_a_connected_car_that_must_leave_stops_at_the_end() -> None:
    given = replace(ring_with_exits(), roads=(MapLane("a", "b"), MapLane("c", "d")), starts=None)
    world = World(make_scenario(place_from(given, "ends"), vehicles=2, connected_cars=2, rsus=0), 1)
    for _ in range(400):
        world.step(0.1)
    assert (world.fleet.rows["speed"] < 0.1).all() and (np.abs(world.fleet.position[:, 0] - 30) < 30).all()
