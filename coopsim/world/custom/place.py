"""Custom places, from the key `place` of a scenario file.

| key | value |
|---|---|
| `nodes` | points on the middle of lanes, by name: `[x, y]`, m |
| `roads` | list of lanes: `from`, `to`; for a bend `centre` and `turn: left` or `right`; along further points `via`; |
| | to turn round at the end of a street `turn: around`; `width_m`, `speed_m_s`, `priority: true` |
| `starts` | list, where vehicles start: `road: [from, to]`, `at_m`; `route`, nodes to pass first; `connected`, rank |
| | among those that become connected; without `starts`, every 15 m on straight roads that no other crosses |
| `cars_first` | number of starts with a rank that have cars, whatever else is drawn |
| `speeds_m_s` | speeds that a policy can choose from, evenly spaced, rising |
| `walks` | `nodes`, `ways` (lists of nodes) and `crosswalks` of people, who go along them both ways |
| `rides` | the same for bicycles and scooters, along them one way; without it they use `walks` |
| `parked` | list of bays: `at`, `heading_deg`, `label` (a class; without: a car or now and then a van) |
| `buildings`, `trees` | lists: `outline` (convex) and `height_m`; `at`, `height_m` and `crown_m` |
| `rsus`, `mast_m` | list of places for roadside units, in order: `at` and `look_at`; height of their masts |
| `drones_around` | the middle of drones' circles |

Only `nodes` and `roads` are needed. Crossings and junctions are found from the geometry of the roads. Vehicles wait at
the beginning of the road, bend or piece that crosses; the first to ask goes first, and all give way to a road with
`priority`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from itertools import combinations, pairwise
from typing import Any, TypeVar

import numpy as np

from coopsim.config.entry import DataEntry, Entry, plain
from coopsim.errors import InvalidValueError
from coopsim.geometry.se3 import SE3, Floats, wrap_angle
from coopsim.support.checks import require_between, require_count, require_finite_number
from coopsim.types.taxonomy import ObjectClass
from coopsim.world.custom.clearance import Kerbs, require_space_to_park, require_space_to_start
from coopsim.world.custom.custom_scenery import read_building, read_tree
from coopsim.world.custom.roads import Roads, read_roads
from coopsim.world.custom.ways import Ways, read_ways
from coopsim.world.places.layout import Bay, Layout, StartSlot, flights_around, lane_outline, rectangle
from coopsim.world.places.markings import lane_lines
from coopsim.world.places.road_network import CircularLane, Road, RoadNetwork
from coopsim.world.places.scenery import town_parts
from coopsim.world.places.streets import RSU_HEIGHT_M, spaced_slots
from coopsim.world.population import Population
from coopsim.world.scenario import Place
from coopsim.world.snapshot import RoadMap

KEYS = (
    "starts",
    "cars_first",
    "speeds_m_s",
    "walks",
    "rides",
    "parked",
    "buildings",
    "trees",
    "rsus",
    "mast_m",
    "drones_around",
)

_STRAIGHT_RAD = 1e-3  # at smaller kinks the slit outside is at most 2 mm wide
_STOPPING_M = 14.0  # no starts this close before a stop line: the vehicle could not stop
_APART_M = 14.0  # between two starts in one lane: the longest bus, and the variation of its start
_BESIDE_M = 3.0  # from the middle of a lane to the middle of a parked vehicle
_CLEARANCE_M = 3.4  # less than between the two lanes of a road: oncoming traffic does not obstruct
_AROUND_M = 150.0  # of ground on each side of the outermost nodes
_PARKED = {label.title: label for label in ObjectClass if label not in (ObjectClass.PEDESTRIAN, ObjectClass.CHILD)}

T = TypeVar("T")


def place_from(description: Mapping[str, Any], name: str) -> Place:
    """Make a place from a description in memory: plain data as a scenario file has under `place`.

    Args:
        description: see the table above; tuples and numpy's numbers are accepted, too.
        name: of the place.

    Raises:
        InvalidValueError: names the keys that lead to the mistake.
    """
    return read_place(DataEntry(plain(description), "place", InvalidValueError), name)


def read_place(entry: Entry, name: str) -> Place:
    """Read a place.

    Args:
        entry: its description.
        name: of the place.

    Raises:
        CoopsimError: of the entry's class; it says where the mistake is.
    """
    fields = entry.fields(("nodes", "roads"), KEYS)
    roads = read_roads(fields["nodes"], fields["roads"])
    starts = _starts(roads, fields)
    walks = read_ways(fields["walks"], roads.network) if "walks" in fields else None
    rides = read_ways(fields["rides"], roads.network, one_way=True) if "rides" in fields else None
    kerbs = Kerbs(roads)
    buildings = _each(fields, "buildings", lambda item, k: read_building(item, k, kerbs))
    trees = _each(fields, "trees", lambda item, _: read_tree(item, kerbs))
    rsus = tuple(_each(fields, "rsus", lambda item, _: _unit(item, kerbs)))
    mast_m = float(fields["mast_m"].checked(require_between, 1, 30)) if "mast_m" in fields else RSU_HEIGHT_M
    road_map = _road_map(roads, walks, [outline for outline, _ in buildings])
    bays = _each(fields, "parked", lambda item, _: _bay(item, kerbs))
    if bays:
        require_space_to_park(bays, fields["parked"].entries(), kerbs)
    low, high = (corner(np.array(list(roads.nodes.values())), axis=0) for corner in (np.min, np.max))
    ground = rectangle((low[0] - _AROUND_M, high[0] + _AROUND_M), (low[1] - _AROUND_M, high[1] + _AROUND_M))
    middle = fields["drones_around"].point() if "drones_around" in fields else (low + high) / 2
    layout = Layout(
        network=roads.network,
        slots=tuple(slot for slot, _ in starts),
        connected_order=tuple(sorted(range(len(starts)), key=lambda k: starts[k][1])),
        footways=walks.footways if walks else None,
        rsus=rsus,
        rsu_height_m=mast_m,
        speeds_m_s=_speeds(roads, fields),
        static=(
            *town_parts(road_map, walks.stripes if walks else [], [], rsus, mast_m, ground),
            *(part for _, part in buildings),
            *(part for tree in trees for part in tree),
        ),
        road_map=road_map,
        movements=roads.movements,
        priority=roads.priority,
        cars_first=int(fields["cars_first"].checked(require_count, 0)) if "cars_first" in fields else 0,
        cycleways=rides.footways if rides else None,
        bays=tuple(bays),
        flights=flights_around(middle),
        roads_ahead=roads.ahead,
        clearance_m=_CLEARANCE_M,
    )
    return Place(name, lambda: layout, _usual_population(layout), plain(entry.as_read))


def _each(fields: Mapping[str, Entry], name: str, read: Callable[[Entry, int], T]) -> list[T]:
    items = fields[name].entries() if name in fields else []
    return [read(item, k) for k, item in enumerate(items)]


def _usual_population(layout: Layout) -> Population:
    starts, rsus = len(layout.slots), min(1, len(layout.rsus))
    vehicles = min(30, max(starts * 2 // 3, min(starts, 1)))
    return Population(
        vehicles=vehicles,
        pedestrians=0 if layout.footways is None else min(8, layout.footways.capacity),
        connected_cars=min(3, (vehicles + 1) // 2),
        rsus=rsus,
        drones=0 if vehicles or rsus else 1,
    )


def _starts(roads: Roads, fields: Mapping[str, Entry]) -> list[tuple[StartSlot, float]]:
    """Return slots, and their ranks among those that become connected."""
    if "starts" not in fields:
        pieces = [(piece, name) for name, all_of_it in roads.pieces.items() for piece in all_of_it]
        room_m = {piece: _room_m(roads, piece) for piece, _ in pieces}
        slots = [slot for piece, _ in pieces for slot in spaced_slots((*piece, 0), room_m[piece])]
        return [(slot, np.inf) for slot in slots]
    items = fields["starts"].entries()
    starts = [_start(roads, item) for item in items]
    for (a, item_a), (b, item_b) in combinations(zip(starts, items, strict=True), 2):
        apart_m = _apart_m(roads, a[0], b[0])
        if apart_m < _APART_M:
            raise item_b.error(
                f"starts in one lane must be at least {_APART_M:g} m apart, got {apart_m:.1f} m from that in "
                f"{item_a.spot}"
            )
    require_space_to_start([slot for slot, _ in starts], items, roads)
    return starts


def _room_m(roads: Roads, piece: Road) -> float:
    """Return the length of a piece on which vehicles may start: none on bends and crossings, or right before these."""
    lane = roads.lane(piece)
    if piece in roads.movements or isinstance(lane, CircularLane):
        return 0.0
    stops = any(movement[0] == piece[1] for movement in roads.movements)
    return max(0.0, float(lane.length) - (_STOPPING_M if stops else 0.0))


def _start(roads: Roads, entry: Entry) -> tuple[StartSlot, float]:
    fields = entry.fields(("road", "at_m"), ("route", "connected"))
    road = roads.find(fields["road"])
    along_m = float(fields["at_m"].checked(require_between, 0, round(roads.length_m(road), 3)))
    piece, at_m = roads.piece_at(road, along_m)
    route: list[Road] = []
    if "route" in fields:
        route = roads.pieces[road][roads.pieces[road].index(piece) :]
        nodes = [road[1], *(item.choice(roads.nodes, "node") for item in fields["route"].entries())]
        for step in pairwise(nodes):
            if step not in roads.pieces:
                raise fields["route"].error(f"route: there is no road from {step[0]!r} to {step[1]!r}")
            route = [*route, *roads.pieces[step]]
    rank = float(fields["connected"].checked(require_count, 1)) if "connected" in fields else np.inf
    return StartSlot((*piece, 0), at_m, tuple(route)), rank


def _apart_m(roads: Roads, a: StartSlot, b: StartSlot) -> float:
    """Return the distance of two starts in one lane; infinite if they are in different lanes."""
    lanes = [roads.network.get_lane(slot.lane) for slot in (a, b)]
    places = [lane.position(slot.along_m, 0.0) for lane, slot in zip(lanes, (a, b), strict=True)]
    headings = [lane.heading_at(slot.along_m) for lane, slot in zip(lanes, (a, b), strict=True)]
    offset = places[1] - places[0]
    aside_m = abs(offset[1] * np.cos(headings[0]) - offset[0] * np.sin(headings[0]))
    same_way = abs(float(wrap_angle(headings[1] - headings[0]))) < np.pi / 4
    return float(np.hypot(*offset)) if same_way and aside_m < _BESIDE_M else np.inf


def _speeds(roads: Roads, fields: Mapping[str, Entry]) -> tuple[float, ...]:
    if "speeds_m_s" not in fields:
        return (0.0, roads.fastest_m_s / 2, roads.fastest_m_s)
    speeds = fields["speeds_m_s"].numbers()
    steps = np.diff(speeds)
    if len(speeds) < 2 or speeds[0] < 0 or steps[0] <= 0 or not np.allclose(steps, steps[0]):
        raise fields["speeds_m_s"].error(
            f"speeds_m_s must be at least two, rising in equal steps from 0 or more, got {speeds}"
        )
    return tuple(speeds)


def _bay(entry: Entry, kerbs: Kerbs) -> Bay:
    fields = entry.fields(("at", "heading_deg"), ("label",))
    at = fields["at"].point()
    kerbs.require_beside(at[None], fields["at"], "at", _BESIDE_M)
    heading_deg = float(fields["heading_deg"].checked(require_finite_number))
    label = _PARKED[fields["label"].choice(_PARKED)] if "label" in fields else None
    return Bay(float(at[0]), float(at[1]), float(np.radians(heading_deg)), label)


def _unit(entry: Entry, kerbs: Kerbs) -> SE3:
    fields = entry.fields(("at", "look_at"))
    at, ahead = fields["at"].point(), fields["look_at"].point() - fields["at"].point()
    kerbs.require_beside(at[None], fields["at"], "at")
    if not ahead.any():
        raise fields["look_at"].error("look_at must be another place than at")
    return SE3.from_xyz_yaw([*at, 0.0], float(np.arctan2(ahead[1], ahead[0])))


def _road_map(roads: Roads, walks: Ways | None, buildings: list[Floats]) -> RoadMap:
    lanes = [quad for lane in roads.network.lanes.values() for quad in lane_outline(lane)] + _wedges(roads.network)
    crosswalks, pavements = (walks.crosswalks, walks.pavements) if walks else ([], [])
    lines = lane_lines(roads.network, roads.movements)
    return RoadMap(tuple(lanes), tuple(crosswalks), tuple(pavements), tuple(buildings), lines)


def _wedges(network: RoadNetwork) -> list[Floats]:
    """Return triangles (3, 2) m, counter-clockwise, that fill the outsides of kinks between lanes."""
    lanes, wedges = network.lanes, []
    for (_, node, _), lane in lanes.items():
        for after in (other for index, other in lanes.items() if index[0] == node):
            turn = float(wrap_angle(after.heading_at(0.0) - lane.heading_at(lane.length)))
            if abs(turn) < _STRAIGHT_RAD:
                continue
            outside = -np.sign(turn) / 2
            corners = [lane.position(lane.length, outside * lane.width), after.position(0.0, outside * after.width)]
            wedges.append(np.array([after.position(0.0, 0.0), *(corners if turn > 0 else corners[::-1])]))
    return wedges
