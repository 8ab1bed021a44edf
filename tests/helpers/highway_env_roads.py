"""highway-env's own places with its own drivers, and the same as a fleet."""

from __future__ import annotations

import numpy as np
from highway_env.envs import HighwayEnv, IntersectionEnv, MergeEnv, RoundaboutEnv
from highway_env.road.road import Road, RoadNetwork
from highway_env.vehicle.behavior import IDMVehicle

from coopsim.world.traffic.engine.fleet import PLAIN, VEHICLE, Fleet
from coopsim.world.traffic.engine.lanes import Network

PLACES = {"highway": HighwayEnv, "intersection": IntersectionEnv, "merge": MergeEnv, "roundabout": RoundaboutEnv}


def network_of(place: str) -> RoadNetwork:
    # IntersectionEnv writes manners of its own into the class of everybody's drivers.
    before = {name: value for name, value in vars(IDMVehicle).items() if name.isupper()}
    env = PLACES[place]()
    env.reset(seed=0)
    for name, value in before.items():
        setattr(IDMVehicle, name, value)
    return env.unwrapped.road.network


def make_road(place: str, seed: int, count: int) -> Road:
    """A place with `count` vehicles, each on a random lane with a random route, some of them about to collide."""
    rng = np.random.default_rng(seed)
    network = network_of(place)
    road = Road(network, np_random=np.random.RandomState(seed))
    indexes = list(network.lanes_dict())
    for _ in range(count):
        index = indexes[rng.integers(len(indexes))]
        lane = network.get_lane(index)
        along, speed = rng.uniform(0, min(lane.length, 200.0)), rng.uniform(5, 25)
        vehicle = IDMVehicle(road, lane.position(along, rng.normal(0, 0.3)), lane.heading_at(along), speed=speed)
        if rng.random() < 0.7 and index[1] in network.graph:
            vehicle.plan_route_to(_some_end(network, index[1], rng))
        road.vehicles.append(vehicle)
    return road


def _some_end(network: RoadNetwork, start: str, rng: np.random.Generator) -> str:
    """A node to which roads lead from `start`, five away or where they end."""
    node = start
    for _ in range(5):
        if node not in network.graph:
            break
        node = str(rng.choice(list(network.graph[node])))
    return node


def fleet_of(road: Road, network: Network) -> Fleet:
    """The same vehicles as rows."""
    vehicles = road.vehicles
    rows = np.zeros(len(vehicles), VEHICLE)
    longest = max(len(vehicle.route or ()) for vehicle in vehicles)
    routes = np.zeros((len(vehicles), max(longest, 1), 2), np.int64)
    for k, (row, vehicle) in enumerate(zip(rows, vehicles, strict=True)):
        row["id"], row["driver"] = k + 1, PLAIN
        row["x"], row["y"] = vehicle.position
        row["heading"], row["speed"], row["target_speed"] = vehicle.heading, vehicle.speed, vehicle.target_speed
        row["length"], row["width"], row["timer"] = vehicle.LENGTH, vehicle.WIDTH, vehicle.timer
        row["axle_m"] = vehicle.LENGTH / 2
        row["lane"] = network.lane_number[vehicle.lane_index]
        row["target_lane"] = network.lane_number[vehicle.target_lane_index]
        row["time_wanted"], row["lateral_gain"] = vehicle.TIME_WANTED, vehicle.KP_LATERAL
        row["route_length"] = len(vehicle.route or ())
        for step, (start, end, number) in enumerate(vehicle.route or ()):
            routes[k, step] = network.road_number[start, end], -1 if number is None else number
    return Fleet(rows, routes)
