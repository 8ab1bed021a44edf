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
| `buildings` | list of blocks: `outline` (convex) and `height_m`; `windows: true`, bands of glass; `roof: gable`, on |
| | four walls of that height; `color`, one of `coopsim.world.custom.scenery.COLORS` |
| `walls` | list: `along`, points from end to end; `height_m`; `thickness_m` (0.25) |
| `trees` | list: `at`, `height_m` and `crown_m` |
| `paved` | list of further ground: `outline` (convex) and `kind` (road, pavement, parking, yard or grass) |
| `rsus`, `mast_m` | list of places for roadside units, in order: `at` and `look_at`; height of their masts |
| `drones_around` | the middle of drones' circles |
| `furniture` | list, seen in full detail: `kind` (docs/reference/furniture.md), `at` and `heading_deg`, or |
| | `along`, points of a line; sizes of the kind |
| `kerb_m`, `crown`, `humps`, `wet` | the ground, see `coopsim.world.custom.ground` |

Only `nodes` and `roads` are needed. Crossings and junctions are found from the geometry of the roads. Vehicles wait at
the beginning of the road, bend or piece that crosses; the first to ask goes first, and all give way to a road with
`priority`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from coopsim.config.checked_entry import DataEntry, Entry, plain
from coopsim.config.yaml_file import yaml_text
from coopsim.errors import InvalidValueError, ScenarioFileError
from coopsim.geometry.se3 import Floats, wrap_angle
from coopsim.support.checks import require_between, require_count
from coopsim.support.files import write_whole
from coopsim.world.custom.clearance import MiddleLines, require_space_to_park
from coopsim.world.custom.ground import (
    GROUND_KEYS,
    paved_parts,
    read_ground,
    read_paved,
    require_off_lanes,
    turning_loops,
)
from coopsim.world.custom.roads import Roads, read_roads
from coopsim.world.custom.scenery import read_building, read_furniture, read_tree, read_wall
from coopsim.world.custom.starts import read_bay, read_speeds, read_starts, read_unit
from coopsim.world.custom.ways import Ways, read_ways
from coopsim.world.furniture.furnish import with_furniture
from coopsim.world.places.layout import Layout, flights_around, lane_outline, rectangle
from coopsim.world.places.road_network import RoadNetwork
from coopsim.world.places.scenery import lane_lines, town_parts
from coopsim.world.places.streets import RSU_HEIGHT_M
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
    "walls",
    "trees",
    "paved",
    "rsus",
    "mast_m",
    "drones_around",
    "furniture",
    *GROUND_KEYS,
)

_CLEARANCE_M = 3.4  # less than between the two lanes of a road: oncoming traffic does not obstruct
_AROUND_M = 150.0  # of ground on each side of the outermost nodes

T = TypeVar("T")


def place_from(description: Mapping[str, Any], name: str) -> Place:
    """Make a place from a description in memory: plain data as a scenario file has under `place`.

    Args:
        description: see the table above; tuples and numpy's numbers are accepted, too.
        name: name of the place.

    Raises:
        InvalidValueError: names the keys that lead to the mistake.
    """
    return read_place(DataEntry(plain(description), "place", InvalidValueError), name)


def read_place(entry: Entry, name: str) -> Place:
    """Read a place; errors are of the entry's class, and say where the mistake is."""
    fields = entry.fields(("nodes", "roads"), KEYS)
    roads = read_roads(fields["nodes"], fields["roads"])
    starts = read_starts(roads, fields)
    walks = read_ways(fields["walks"], roads.network) if "walks" in fields else None
    rides = read_ways(fields["rides"], roads.network, one_way=True) if "rides" in fields else None
    middles = MiddleLines(roads)
    buildings = _each(fields, "buildings", lambda item, k: read_building(item, k, middles))
    walls = _each(fields, "walls", lambda item, _: read_wall(item, middles))
    trees = _each(fields, "trees", lambda item, _: read_tree(item, middles))
    paved = read_paved(fields["paved"].entries() if "paved" in fields else ())
    rsus = tuple(_each(fields, "rsus", lambda item, _: read_unit(item, middles)))
    mast_m = float(fields["mast_m"].checked(require_between, 1, 30)) if "mast_m" in fields else RSU_HEIGHT_M
    outlines = [[outline for one in each for outline in one.outlines] for each in (buildings, walls)]
    road_map = road_map_of(roads, walks, paved, *outlines)
    bays = _each(fields, "parked", lambda item, _: read_bay(item, middles))
    if bays:
        require_space_to_park(bays, fields["parked"].entries(), middles)
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
        speeds_m_s=read_speeds(roads, fields),
        static=(
            *town_parts(road_map, walks.stripes if walks else [], [], rsus, mast_m, ground),
            *paved_parts(paved),
            *(part for one in (*buildings, *walls) for part in one.parts),
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
    works = read_ground(fields, roads.network)
    if works.kerb_m > 0 and paved["pavements"]:
        require_off_lanes(paved["pavements"], fields["paved"], middles)
    layout = works.applied(layout, turning_loops(roads))
    if "furniture" in fields:
        layout = with_furniture(layout, read_furniture(fields["furniture"], middles))
    return Place(name, lambda: layout, _usual_population(layout), entry.as_read)


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


def write_place_file(path: str | Path, description: Mapping[str, Any], content: Mapping[str, Any]) -> Path:
    """Write a scenario file with a place that reads back to the same numbers, bit by bit; an older file is replaced.

    `content` has the other keys of the file as plain data. They are checked when it is read.

    Raises:
        ScenarioFileError: the file cannot be written.
    """
    try:
        return write_whole(path, yaml_text({"place": description, **content}))
    except InvalidValueError as error:
        raise ScenarioFileError(str(error)) from error


_STRAIGHT_RAD = 1e-3  # at smaller kinks the slit outside is at most 2 mm wide


def road_map_of(
    roads: Roads, walks: Ways | None, paved: Mapping[str, list[Floats]], buildings: list[Floats], walls: list[Floats]
) -> RoadMap:
    """Return the outlines (K, 2) m of a place; `paved` has some by the field that they belong to."""
    lanes = [quad for lane in roads.network.lanes.values() for quad in lane_outline(lane)] + _wedges(roads.network)
    crosswalks, pavements = (walks.crosswalks, walks.pavements) if walks else ([], [])
    more = {field: tuple(outlines) for field, outlines in paved.items()}
    more |= {"lanes": (*lanes, *paved["lanes"]), "pavements": (*pavements, *paved["pavements"])}
    lines = lane_lines(roads.network, roads.movements)
    return RoadMap(crosswalks=tuple(crosswalks), buildings=tuple(buildings), walls=tuple(walls), markings=lines, **more)


def _wedges(network: RoadNetwork) -> list[Floats]:
    """Return triangles (3, 2) m, counter-clockwise, that fill the outsides of kinks between lanes."""
    wedges = []
    for (_, node, _), lane in network.lanes.items():
        for after in (other for lanes in network.graph.get(node, {}).values() for other in lanes):
            turn = float(wrap_angle(after.heading_at(0.0) - lane.heading_at(lane.length)))
            if abs(turn) < _STRAIGHT_RAD:
                continue
            outside = -np.sign(turn) / 2
            corners = [lane.position(lane.length, outside * lane.width), after.position(0.0, outside * after.width)]
            wedges.append(np.array([after.position(0.0, 0.0), *(corners if turn > 0 else corners[::-1])]))
    return wedges
