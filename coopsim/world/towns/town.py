"""Drawn towns: their descriptions, the places made from these, and the usual numbers of vehicles and people."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import is_dataclass, replace
from functools import lru_cache
from itertools import pairwise
from typing import Any, TypeVar, cast

import numpy as np

from coopsim.config.annotated import Point
from coopsim.geometry import exact
from coopsim.geometry.outlines import keep_corners
from coopsim.support.rng import stream
from coopsim.world.custom.place import build_place
from coopsim.world.drawn_options import TownOptions
from coopsim.world.furniture.furnish import furnished, leafy
from coopsim.world.places.description import PlaceDescription, point_of
from coopsim.world.places.layout import Layout
from coopsim.world.population import Population
from coopsim.world.scenario import Place
from coopsim.world.towns import roadside
from coopsim.world.towns.kerbs import corner_kerb, kerb_lines_of, trace_rounds
from coopsim.world.towns.lots import build_corners, build_frontages
from coopsim.world.towns.pavements import PeopleWays, cross_at_junctions, cross_between, describe_ways
from coopsim.world.towns.plan import Plan
from coopsim.world.towns.planning import draw_plan
from coopsim.world.towns.roads import TownRoads, lay_roads
from coopsim.world.towns.signals import light_junctions
from coopsim.world.towns.site import Site
from coopsim.world.towns.starts import FIRST, bring_near, off_roads, place_starts

_ANY = TownOptions()
_KEPT = 32  # places, of 5 MB each: environments ask for the same ones again, as a learner that has towns to train in
_DECIMALS = 3  # of lengths in m and angles in degrees: a file is shorter
_SCALE = 1000.0  # 10 to the power of these
_POINTS = ("at", "look_at", "centre", "drones_around")
_LINES = ("via", "along", "outline")

T = TypeVar("T")

KERB_M = 0.12
"""Height of pavements over the road."""

_WAY_M = 2.6  # from the kerb to the middle of people's way
_HALF_WAY_M = 1.5
_LANE_SIDE_M = 4.0  # from kerbs to both sides, at least: the lane, and the pavement
_CHORD_M = 6.0
_BORDER_M = _WAY_M + _HALF_WAY_M + 0.1


def describe_town(seed: int, options: TownOptions = _ANY) -> PlaceDescription:
    """Draw the description of a town."""
    description = draw_place(seed, options).description
    assert description is not None, "it was built from one"
    return description


@lru_cache(_KEPT)
def draw_place(seed: int, options: TownOptions = _ANY) -> Place:
    """Draw a town, and build it."""
    if options.traffic_side == "left":
        right = draw_place(seed, replace(options, traffic_side="right"))
        assert right.description is not None, "it was built from one"
        return replace(build_place(mirrored(right.description), right.name), population=right.population)
    bare = build_place(leafy(describe_streets(seed, options)), f"town-{seed}")
    assert bare.description is not None, "it was built from one"
    layout, description = furnished(bare.make_layout(), bare.description, seed)
    return Place(bare.name, lambda: layout, usual_population(layout), description)


def describe_streets(seed: int, options: TownOptions = _ANY) -> PlaceDescription:
    """Draw a description like `describe_town`, but without furniture, and with traffic on the right."""
    plan = draw_plan(seed, options)
    roads = lay_roads(plan)
    usual, spots = place_starts(plan, roads)
    beside = dress_streets(plan, seed, options.openness, roads if options.traffic_lights else None)
    starts, masts = bring_near(usual, spots, off_roads(beside["rsus"], roads.nodes, roads.roads))
    parts = beside | {"rsus": tuple(masts), "starts": tuple(starts)}
    found = PlaceDescription(nodes=roads.nodes, roads=tuple(roads.roads), cars_first=FIRST, **parts)
    return turned(found, plan.turn_rad)


def dress_streets(plan: Plan, seed: int, openness: float | None = None, lit: TownRoads | None = None) -> dict[str, Any]:
    """Draw all that is beside the lanes, not turned, as fields of a description; lights for the roads `lit`."""
    rounds = trace_rounds(plan)
    kerbs = kerb_lines_of(rounds)
    ways = PeopleWays(tuple(each.clear_offset(_WAY_M, kerbs) for each in rounds))
    cross_at_junctions(ways, rounds, plan)
    cross_between(ways, rounds, plan, seed)
    borders = [each.clear_offset(_BORDER_M, kerbs) for each in rounds]
    drawn = stream(seed, "openness").uniform() if openness is None else openness
    site = Site(plan, seed, drawn, rounds, kerbs, ways, borders)
    _take_streets(site)
    roadside.pave_junctions(site)
    roadside.pave_sides(site)
    roadside.place_roadside_units(site)
    build_corners(site)
    build_frontages(site)
    roadside.line_streets(site)
    roadside.plant_behind(site)
    roadside.mark_bays(site)
    roadside.add_humps(site)
    roadside.add_puddles(site)
    walks = describe_ways(ways)
    return {
        "walks": walks,
        "signals": () if lit is None else light_junctions(plan, lit, ways, walks, seed),
        **{name: tuple(parts) for name, parts in site.parts.items()},
        "mast_m": float(np.round(site.stream("masts").uniform(5.0, 8.0), 1)),
        "drones_around": point_of(plan.junctions[plan.meeting].centre),
        "kerb_m": KERB_M,
        "crown": 0.025,
    }


def _take_streets(site: Site) -> None:
    """Take the ground of streets, junctions, loops and people's ways."""
    taken = site.taken
    for line in site.ways.lines:
        taken.take_lines(line, np.roll(line, -1, axis=0), np.full(len(line), _HALF_WAY_M + 0.05))
    taken.take_lines(site.kerbs[0], site.kerbs[1], np.maximum(site.kerbs[2], _LANE_SIDE_M))
    for street in site.plan.streets:
        first, last = street.span_m
        along = np.linspace(first, last, max(2, int((last - first) / _CHORD_M)))
        middle, half_m = street.position(along), street.half_m(along)
        taken.take_lines(middle[:-1], middle[1:], np.maximum(half_m[:-1], half_m[1:]))
    for junction in site.plan.junctions:
        for arm in range(len(junction.arms)):
            kerb = corner_kerb(junction, arm)
            for here, there in pairwise(kerb[keep_corners(kerb, 1.0)]):
                taken.take(np.array([junction.centre, here, there]))


def turned(part: T, angle_rad: float) -> T:
    """Return a description, or a part of one, turned about the origin, counter-clockwise; numbers are rounded."""
    cos, sin, angle_deg = float(exact.cos(angle_rad)), float(exact.sin(angle_rad)), float(np.degrees(angle_rad))

    def point(at: Point) -> Point:
        x, y = at
        # As numpy rounds; adding 0.0 makes a zero of a negative one, which a file would keep.
        east, north = round((cos * x - sin * y) * _SCALE), round((sin * x + cos * y) * _SCALE)
        return east / _SCALE + 0.0, north / _SCALE + 0.0

    return _placed(part, point, lambda heading_deg: heading_deg + angle_deg)


def mirrored(description: PlaceDescription) -> PlaceDescription:
    """Return the place in which y is -y, and traffic keeps to the other side."""
    found = _placed(description, lambda at: (at[0] + 0.0, 0.0 - at[1]), lambda heading_deg: -heading_deg)
    roads = tuple(
        replace(each, turn=_OTHER.get(each.turn or "", each.turn), left=each.right, right=each.left)
        for each in found.roads
    )
    # What a line has on its left, such as rails, is on the left of the line back.
    pieces = found.furniture and tuple(replace(each, along=each.along[::-1]) for each in found.furniture)
    return replace(found, roads=roads, furniture=pieces, traffic_side=_OTHER[found.traffic_side])


_OTHER = {"left": "right", "right": "left"}


def _placed(part: T, point: Callable[[Point], Point], turn_deg: Callable[[float], float]) -> T:
    """Return a description, or a part of one, with other points and headings."""

    def content(name: str, value: Any) -> Any:
        if value is None or isinstance(value, str):
            return value
        if name in _POINTS:
            return point(value)
        if name in _LINES:
            return tuple(map(point, value))
        if name == "nodes":
            return {each: point(at) for each, at in value.items()}
        if name == "heading_deg":
            return round((turn_deg(float(value)) + 180.0) % 360.0 - 180.0, _DECIMALS) + 0.0
        if isinstance(value, tuple):
            return tuple(whole(each) if is_dataclass(each) else each for each in value)
        if is_dataclass(value):
            return whole(value)
        return float(value) if isinstance(value, float) else value  # numpy's numbers as Python's

    def whole(each: Any) -> Any:
        return type(each)(**{name: content(name, getattr(each, name)) for name in each.__slots__})

    return cast("T", whole(part))


MOST = Population(
    vehicles=30,
    truck_share=0.1,
    vans=4,
    buses=1,
    motorcycles=2,
    pedestrians=40,
    children=6,
    bicycles=8,
    scooters=4,
    parked=60,
    connected_cars=3,
    rsus=2,
)
"""Largest usual numbers in any town."""

FEWEST = Population(vehicles=9, truck_share=0.1, pedestrians=0, connected_cars=3, rsus=2, drones=4)
"""Least usual numbers in every town, and (roadside units and drones) least numbers of places for them."""

FEWEST_STARTS = 20
"""Least number of starts for vehicles in every town."""

MOVING = ("motorcycles", "buses", "vans", "vehicles")

MOST_TOGETHER = ((MOVING, 500), (("parked",), 150), (("pedestrians", "children", "bicycles", "scooters"), 4000))
"""Largest numbers on roads, at kerbs and on pavements of any town. Of 30 with nine junctions and three lanes the
largest has room for 434, 110 and 2,922."""

_ALWAYS, _PER_JUNCTION = 5, 3.2  # vehicles: with more of them, some wait at junctions for half a minute
_JUNCTION_M = 36.0  # around the middle of a junction: the middles of its movements
_PER_VEHICLE_M = 80.0  # of lanes, at least
_LEAST = 9  # vehicles: of every three, one starts in the order of connection, so the three usual agents do
_PER_WALKER_M = 45.0  # of pavements; footways hold one person on every two metres
_PARKED_SHARE = 0.7  # of bays
_FREE_SHARE = 0.6  # of starts: no more are taken


def usual_population(layout: Layout) -> Population:
    """Return the numbers that go with a town's junctions, the length of its pavements, and its bays and masts."""
    lanes_m = sum(lane.length for lane in layout.network.lanes.values())
    vehicles = round(min(_ALWAYS + _PER_JUNCTION * count_junctions(layout), lanes_m / _PER_VEHICLE_M))
    vehicles = min(max(vehicles, _LEAST), int(_FREE_SHARE * len(layout.slots)), MOST.vehicles)
    more = vehicles // 10
    pavements_m = 0.0 if layout.footways is None else layout.footways.capacity * 2.0
    pedestrians = min(round(pavements_m / _PER_WALKER_M), MOST.pedestrians)
    wheels = 0 if layout.footways is None and layout.cycleways is None else 1 + vehicles // 6
    return Population(
        vehicles=vehicles,
        truck_share=MOST.truck_share,
        vans=min(more, MOST.vans),
        buses=0,
        motorcycles=min(more // 2, MOST.motorcycles),
        pedestrians=pedestrians,
        children=min(pedestrians // 6, MOST.children),
        bicycles=min(wheels, MOST.bicycles),
        scooters=min(wheels // 2, MOST.scooters),
        parked=min(int(_PARKED_SHARE * len(layout.bays)), MOST.parked),
        connected_cars=min(MOST.connected_cars, vehicles // 2),
        rsus=min(MOST.rsus, len(layout.rsus)),
    )


def count_junctions(layout: Layout) -> int:
    """Return the number of places where more than two ways cross or join: where lanes join, there are two."""
    lanes = [layout.network.get_lane((*road, 0)) for road in layout.movements]
    middles = np.array([lane.position(lane.length / 2, 0.0) for lane in lanes]).reshape(-1, 2)
    count = 0
    while len(middles):
        near = exact.norm(middles - middles[0], axis=1) < _JUNCTION_M
        near = exact.norm(middles - middles[near].mean(axis=0), axis=1) < _JUNCTION_M
        near[0] = True
        count += int(near.sum() > 2)
        middles = middles[~near]
    return count
