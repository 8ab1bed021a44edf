"""The engine over arrays does as highway-env's objects do, on its roads and on ours."""

import numpy as np
import pytest
from highway_env.road import road as highway_roads
from highway_env.road.lane import PolyLaneFixedWidth
from highway_env.road.road import Road
from highway_env.vehicle.behavior import IDMVehicle
from highway_env.vehicle.controller import ControlledVehicle
from highway_env.vehicle.kinematics import Vehicle
from highway_env_roads import PLACES, fleet_of, make_road, network_of, numbered
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from representatives import all_of

from coopsim.errors import InvalidValueError, UnknownNameError
from coopsim.types.messages import MANEUVERS
from coopsim.world.places.road_network import RoadNetwork
from coopsim.world.scenario import make_scenario
from coopsim.world.traffic import drivers, lane_geometry, motion, rules
from coopsim.world.traffic.array_engine import ArrayEngine
from coopsim.world.traffic.fleet import BODY, PARKED, bodies_of
from coopsim.world.traffic.lanes import NumberedNetwork
from coopsim.world.traffic.neighbours import behind, in_front, list_along_lanes
from coopsim.world.traffic.traffic import ENGINES
from coopsim.world.world import World

NOBODY = np.zeros(0, BODY)
THEIRS = {place: network_of(place) for place in PLACES}
NETWORKS = {place: numbered(THEIRS[place]) for place in PLACES}


def state_of(road: Road, network: NumberedNetwork) -> NDArray[np.float64]:
    """(N, 7): x, y, heading, speed, lane, target lane, crashed."""
    return np.array(
        [
            [
                *vehicle.position,
                vehicle.heading,
                vehicle.speed,
                network.lane_number[vehicle.lane_index],
                network.lane_number[vehicle.target_lane_index],
                vehicle.crashed,
            ]
            for vehicle in road.vehicles
        ]
    )


@pytest.mark.parametrize("place", PLACES)
def test_trajectories_are_highway_envs(place: str) -> None:
    changed = crashed = 0
    for seed in range(3):
        road = make_road(place, seed, count=16)
        network = numbered(road.network)
        fleet, engine = fleet_of(road, network), ArrayEngine(network)
        start = state_of(road, network)
        for _ in range(60):
            road.act()
            road.step(0.1)
            engine.step(fleet, NOBODY, 0.1, {})
            ours = np.column_stack(
                [fleet.rows[name] for name in ("x", "y", "heading", "speed", "lane", "target_lane", "crashed")]
            )
            np.testing.assert_allclose(ours, state_of(road, network), rtol=0, atol=1e-6)
        changed += int((ours[:, 4] != start[:, 4]).sum())
        crashed += int(ours[:, 6].sum())
    assert changed >= 5 and crashed >= 2  # so this compares changes of lanes, ways on from a lane, and collisions


@pytest.mark.parametrize(
    ("name", "numbers"),
    [
        ("crossing", {"vehicles": 20}),
        ("highway", {"vehicles": 30}),
        ("roundabout", {}),
        ("platoon", {}),
        ("occluded_crossing", {}),
        ("t_junction", {"vehicles": 14, "buses": 8, "truck_share": 0.3}),
        ("highway", {"vehicles": 12, "buses": 8, "truck_share": 0.3}),
    ],
)
@pytest.mark.parametrize("control", all_of(["traffic", "policy"], "policy"))
def test_our_drivers_do_the_same_on_either_engine(name: str, numbers: dict[str, int], control: str) -> None:
    worlds = [World(make_scenario(name, **numbers), 1, control=control, traffic=engine) for engine in ENGINES]
    for k in range(70):
        told = {"cav_0": MANEUVERS.index(("faster", "idle", "slower", "lane_left", "lane_right")[k // 7 % 5])}
        for world in worlds:
            world.step(0.1, told)
        ours, theirs = (world.actors() for world in worlds)
        np.testing.assert_allclose(ours.boxes.array, theirs.boxes.array, rtol=0, atol=1e-6)
        np.testing.assert_allclose(ours.velocity, theirs.velocity, rtol=0, atol=1e-6)
        assert worlds[0].crashed() == worlds[1].crashed()


def test_on_either_engine_who_finds_no_room_behind_the_junction_turns_elsewhere() -> None:
    worlds = [World(make_scenario("crossing", vehicles=22, pedestrians=0), 2, traffic=engine) for engine in ENGINES]
    exits = {arm: worlds[0]._traffic._network.lane_number[f"exit{arm}", f"bend{arm}", 0] for arm in range(4)}
    for world in worlds:
        row, lane = world._traffic.fleet.rows[-1], world._traffic._network.source.get_lane(("exit0", "bend0", 0))
        row["driver"], row["speed"], row["lane"], row["target_lane"] = PARKED, 0.0, exits[0], exits[0]
        (row["x"], row["y"]), row["heading"] = lane.position(6.0, 0.0), lane.heading_at(6.0)
    visited = set()
    for _ in range(150):
        for world in worlds:
            world.step(0.1)
        ours, theirs = (world.actors() for world in worlds)
        np.testing.assert_allclose(ours.boxes.array, theirs.boxes.array, rtol=0, atol=1e-6)
        rows = worlds[0]._traffic.fleet.rows
        visited |= set(rows["lane"][:-1][np.hypot(rows["x"], rows["y"])[:-1] < 35.0].tolist())
    assert exits[0] not in visited and visited >= {exits[1], exits[2], exits[3]}
    assert worlds[0].crashed() == ()


def test_constants_are_highway_envs() -> None:
    for name in (
        "ACC_MAX",
        "COMFORT_ACC_MIN",
        "DISTANCE_WANTED",
        "DELTA",
        "LANE_CHANGE_DELAY",
        "LANE_CHANGE_MIN_ACC_GAIN",
        "LANE_CHANGE_MAX_BRAKING_IMPOSED",
    ):
        assert getattr(drivers, name) == getattr(IDMVehicle, name), name
    assert rules.COMFORT_ACC_MAX == IDMVehicle.COMFORT_ACC_MAX
    assert IDMVehicle.POLITENESS == 0
    assert pytest.approx(ControlledVehicle.KP_HEADING) == motion.HEADING_GAIN_1_S
    assert pytest.approx(ControlledVehicle.KP_A) == motion.SPEED_GAIN_1_S
    assert pytest.approx(ControlledVehicle.TAU_PURSUIT) == motion.PURSUIT_S
    assert ControlledVehicle.MAX_STEERING_ANGLE == rules.STEERING_MAX_RAD
    assert Vehicle.MAX_SPEED == -Vehicle.MIN_SPEED == motion.SPEED_MAX_M_S
    assert Vehicle.LENGTH == rules.VEHICLE_LENGTH_M


def _numbers(low: float, high: float) -> st.SearchStrategy[float]:
    """Draw numbers without -0.0, in whose direction from the middle of a ring two arctan2 need not agree."""
    return st.floats(low, high).map(lambda number: number + 0.0)


places = st.tuples(_numbers(-150, 250), _numbers(-150, 150), _numbers(-7, 7))


@given(st.sampled_from(sorted(PLACES)), places)
@settings(max_examples=200)  # each looks at all lanes of a place: slow on a busy machine
def test_lane_geometry_is_highway_envs(place: str, where: tuple[float, float, float]) -> None:
    network, theirs = NETWORKS[place], THEIRS[place]
    x, y, heading = where
    spot, corners = np.array([x, y]), network.arrays.corners
    for row, index in zip(network.arrays.lanes, network.lane_index, strict=True):
        lane, ours = theirs.get_lane(index), network.source.get_lane(index)
        along, aside = lane.local_coordinates(spot)
        # Not to the last bit: highway-env's differs between processors, and ours does not.
        assert (*ours.local_coordinates(spot), ours.length) == pytest.approx(
            (along, aside, lane.length), rel=1e-12, abs=1e-12
        )
        np.testing.assert_allclose(ours.position(along, aside), lane.position(along, aside), rtol=1e-12, atol=1e-12)
        assert ours.heading_at(along) == pytest.approx(lane.heading_at(along), rel=1e-12)
        assert ours.contains(spot) == lane.on_lane(spot)
        np.testing.assert_allclose(lane_geometry.local_coordinates(row, corners, x, y), (along, aside), atol=1e-9)
        np.testing.assert_allclose(lane_geometry.position_at(row, corners, along), lane.position(along, 0), atol=1e-9)
        assert lane_geometry.heading_at(row, corners, along) == pytest.approx(lane.heading_at(along), abs=1e-12)
        distance = lane.distance(spot)
        assert lane_geometry.distance_to(row, corners, x, y) == pytest.approx(distance, abs=1e-9)
        assert lane_geometry.distance_to_box(row, x, y) <= distance + 1e-9
    closest = theirs.get_closest_lane_index(spot, heading)
    for guess in (0, len(network.lane_index) - 1):
        assert (
            network.lane_index[lane_geometry.closest_lane(network.arrays.lanes, corners, x, y, heading, guess)]
            == closest
        )


@pytest.mark.parametrize("place", PLACES)
def test_neighbours_are_highway_envs(place: str) -> None:
    road = make_road(place, 5, count=40)
    network = numbered(road.network)
    fleet = fleet_of(road, network)
    lists = list_along_lanes(network.arrays, bodies_of(fleet.rows, NOBODY))
    found = 0
    for me, vehicle in enumerate(road.vehicles):
        for number, index in enumerate(network.lane_index):
            theirs = road.neighbour_vehicles(vehicle, index)
            along, _ = road.network.get_lane(index).local_coordinates(vehicle.position)
            for search, other in zip((in_front, behind), theirs, strict=True):
                expected = -1 if other is None else road.vehicles.index(other)
                assert search(lists, network.arrays.lanes, number, me, along) == expected
                found += expected >= 0
    assert found > 50


def test_of_two_who_are_as_far_along_highway_envs_choice_is_taken() -> None:
    road = Road(highway_roads.RoadNetwork.straight_road_network(lanes=1))
    for x, y in ((50.0, 0.0), (80.0, 1.0), (80.0, -1.0), (20.0, 1.0), (20.0, -1.0)):
        road.vehicles.append(IDMVehicle(road, (x, y), speed=10.0))
    network = numbered(road.network)
    lists = list_along_lanes(network.arrays, bodies_of(fleet_of(road, network).rows, NOBODY))
    front, rear = (road.vehicles.index(other) for other in road.neighbour_vehicles(road.vehicles[0]))
    assert in_front(lists, network.arrays.lanes, 0, 0, 50.0) == front
    assert behind(lists, network.arrays.lanes, 0, 0, 50.0) == rear


def test_a_lane_of_another_kind_is_refused_with_the_accepted_ones() -> None:
    network = RoadNetwork()
    network.add_lane("a", "b", PolyLaneFixedWidth([(0, 0), (10, 0), (20, 5)]))
    with pytest.raises(
        InvalidValueError, match=r"StraightLane, CircularLane, PolylineLane, got PolyLaneFixedWidth at .*'a', 'b'"
    ):
        ArrayEngine(NumberedNetwork(network))


def test_an_unknown_engine_is_refused_with_the_known_ones() -> None:
    with pytest.raises(UnknownNameError, match=r"unknown traffic 'array'. Did you mean 'arrays'"):
        World(make_scenario("crossing"), 0, traffic="array")
