"""highway-env's own places with drivers of ours, and the same vehicles as a fleet."""

from __future__ import annotations

import numpy as np
from highway_env.envs import HighwayEnv, IntersectionEnv, MergeEnv, RoundaboutEnv
from highway_env.road.lane import SineLane, StraightLane
from highway_env.road.road import Road, RoadNetwork
from highway_env.vehicle.behavior import IDMVehicle

from coopsim.world.places import road_network
from coopsim.world.traffic.fleet import HIGHWAY, VEHICLE, Fleet
from coopsim.world.traffic.highway_env_engine import HighwayDriver
from coopsim.world.traffic.lanes import NumberedNetwork

PLACES = {"highway": HighwayEnv, "intersection": IntersectionEnv, "merge": MergeEnv, "roundabout": RoundaboutEnv}


def network_of(place: str) -> RoadNetwork:
    """Return the roads of a place, with straight lanes for sinusoidal ones, which ours never are."""
    # IntersectionEnv writes manners of its own into the class of all drivers.
    before = {name: value for name, value in vars(IDMVehicle).items() if name.isupper()}
    env = PLACES[place]()
    env.reset(seed=0)
    for name, value in before.items():
        setattr(IDMVehicle, name, value)
    network = env.unwrapped.road.network
    for ends in network.graph.values():
        for lanes in ends.values():
            for k, lane in enumerate(lanes):
                if isinstance(lane, SineLane):
                    ends_m = lane.position(0.0, 0.0), lane.position(lane.length, 0.0)
                    lanes[k] = StraightLane(*ends_m, lane.width, None, lane.forbidden, lane.speed_limit)
    return network


def numbered(network: RoadNetwork) -> NumberedNetwork:
    """Return highway-env's roads as ours, with numbers."""
    ours = road_network.RoadNetwork()
    for (start, end, _), lane in network.lanes_dict().items():
        speed_limit = np.inf if lane.speed_limit is None else lane.speed_limit
        usual = {"width": lane.width, "speed_limit": speed_limit, "forbidden": lane.forbidden}
        if isinstance(lane, StraightLane):
            ours.add_lane(start, end, road_network.StraightLane(lane.start, lane.end, **usual))
        else:
            arc = (lane.center, lane.radius, lane.start_phase, lane.end_phase)
            ours.add_lane(start, end, road_network.CircularLane(*arc, **usual))
    return NumberedNetwork(ours)


def make_road(place: str, seed: int, count: int) -> Road:
    """Return a place with `count` vehicles on random lanes with random routes, some of them about to collide."""
    rng = np.random.default_rng(seed)
    network = network_of(place)
    road = Road(network, np_random=np.random.RandomState(seed))
    indexes = list(network.lanes_dict())
    for number in range(count):
        index = indexes[rng.integers(len(indexes))]
        lane = network.get_lane(index)
        along, speed = rng.uniform(0, min(lane.length, 200.0)), rng.uniform(5, 25)
        vehicle = HighwayDriver(road, lane.position(along, rng.normal(0, 0.3)), lane.heading_at(along), speed=speed)
        vehicle.fit(vehicle.LENGTH, vehicle.WIDTH, vehicle.LENGTH / 2, turn_key=number)
        if rng.random() < 0.7 and index[1] in network.graph:
            vehicle.plan_route_to(_some_end(network, index[1], rng))
        road.vehicles.append(vehicle)
    return road


def _some_end(network: RoadNetwork, start: str, rng: np.random.Generator) -> str:
    """Return a node to which roads lead from `start`, five away or where they end."""
    node = start
    for _ in range(5):
        if node not in network.graph:
            break
        node = str(rng.choice(list(network.graph[node])))
    return node


def fleet_of(road: Road, network: NumberedNetwork) -> Fleet:
    """Return the same vehicles as rows."""
    vehicles = road.vehicles
    rows = np.zeros(len(vehicles), VEHICLE)
    longest = max([HighwayDriver.roads_ahead, *(len(vehicle.route or ()) for vehicle in vehicles)])
    routes = np.zeros((len(vehicles), longest, 2), np.int64)
    for k, (row, vehicle) in enumerate(zip(rows, vehicles, strict=True)):
        vehicle.roads_ahead = longest
        row["id"], row["driver"] = k + 1, HIGHWAY
        row["x"], row["y"] = vehicle.position
        row["heading"], row["speed"], row["target_speed"] = vehicle.heading, vehicle.speed, vehicle.target_speed
        row["length"], row["width"], row["timer"] = vehicle.LENGTH, vehicle.WIDTH, vehicle.timer
        row["axle_m"], row["turn_key"] = vehicle.LENGTH / 2, getattr(vehicle, "turn_key", 0)
        row["lane"] = network.lane_number[vehicle.lane_index]
        row["target_lane"] = network.lane_number[vehicle.target_lane_index]
        row["time_wanted"], row["lateral_gain"] = vehicle.TIME_WANTED, vehicle.KP_LATERAL
        row["route_length"] = len(vehicle.route or ())
        for step, (start, end, number) in enumerate(vehicle.route or ()):
            routes[k, step] = network.road_number[start, end], -1 if number is None else number
    return Fleet(rows, routes)
