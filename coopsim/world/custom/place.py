"""Places from descriptions: from programs, from the key `place` of scenario files, from the generator of towns."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from coopsim.config.annotated import read
from coopsim.config.checked_entry import DataEntry, Entry, plain
from coopsim.config.yaml_file import yaml_text
from coopsim.errors import InvalidValueError, ScenarioFileError
from coopsim.geometry.se3 import Floats, wrap_angle
from coopsim.support.files import write_whole
from coopsim.world.custom.clearance import MiddleLines, require_space_to_park
from coopsim.world.custom.ground import (
    AROUND_M,
    PAVEMENT,
    build_ground,
    build_paved,
    build_terrain,
    paved_parts,
    require_off_lanes,
    turning_loops,
)
from coopsim.world.custom.rights import add_rights
from coopsim.world.custom.roads import Roads, build_roads
from coopsim.world.custom.scenery import build_block, build_tree, build_wall, require_furniture_off_roads, require_kinds
from coopsim.world.custom.starts import build_bay, build_speeds, build_starts, build_unit
from coopsim.world.custom.ways import Ways, build_ways
from coopsim.world.furniture.furnish import with_furniture
from coopsim.world.places.description import SURFACES, PlaceDescription
from coopsim.world.places.layout import Layout, flights_around, lane_outline, rectangle
from coopsim.world.places.place import BUILDERS, Place
from coopsim.world.places.road_network import RoadNetwork
from coopsim.world.places.scenery import lane_lines, town_parts
from coopsim.world.places.streets import RSU_HEIGHT_M
from coopsim.world.population import Population
from coopsim.world.snapshot import RoadMap

_CLEARANCE_M = 3.4  # less than between the two lanes of a road: oncoming traffic does not obstruct


def place_from(description: PlaceDescription | Mapping[str, Any], name: str) -> Place:
    """Make a place from a description.

    Args:
        description: it, or plain data as a scenario file has under `place`; tuples and numpy's numbers are taken, too.
        name: name of the place.

    Raises:
        InvalidValueError: names the keys that lead to the mistake, and says what is accepted.
    """
    given = description.plain if isinstance(description, PlaceDescription) else description
    return read_place(DataEntry(plain(given), "place", InvalidValueError), name)


BUILDERS.register("described")(place_from)


def read_place(entry: Entry, name: str) -> Place:
    """Read a place; errors are of the entry's class, and say where the mistake is."""
    description: PlaceDescription = read(PlaceDescription, entry)
    if description.furniture is not None:
        require_kinds(entry.part("furniture"))
    return build_place(description, name, entry)


def build_place(description: PlaceDescription, name: str, root: Entry | None = None) -> Place:
    """Build a place from a description whose values are as annotated; `root` is its entry, for errors."""
    layout = build_layout(description, root or DataEntry({}, "place", InvalidValueError))
    return Place(name, lambda: layout, _usual_population(layout), description)


def build_layout(description: PlaceDescription, root: Entry) -> Layout:
    """Build all that a description says; errors are those of its entry."""
    roads = build_roads(description, root)
    add_rights(roads)
    endless = roads.network.endless
    starts, middles = build_starts(roads), MiddleLines(roads)
    walks, rides = (
        None if each is None else build_ways(each, root.part(key), roads.network, one_way=key == "rides")
        for key, each in (("walks", description.walks), ("rides", description.rides))
    )
    low, high = (corner(np.array(list(roads.nodes.values())), axis=0) for corner in (np.min, np.max))
    ground = rectangle((low[0] - AROUND_M, high[0] + AROUND_M), (low[1] - AROUND_M, high[1] + AROUND_M))
    terrain = build_terrain(roads, ground[0], ground[2])
    blocks = [build_block(each, k, root, middles, terrain) for k, each in enumerate(description.buildings)]
    walls = [build_wall(each, k, root, middles, terrain) for k, each in enumerate(description.walls)]
    trees = [part for k, each in enumerate(description.trees) for part in build_tree(each, k, middles, terrain)]
    paved = build_paved(description.paved, root)
    rsus = tuple(build_unit(each, k, root, middles) for k, each in enumerate(description.rsus))
    bays = tuple(build_bay(each, k, middles) for k, each in enumerate(description.parked))
    require_space_to_park(bays, root, middles)
    mast_m = RSU_HEIGHT_M if description.mast_m is None else float(description.mast_m)
    outlines = [[outline for one in each for outline in one.outlines] for each in (blocks, walls)]
    road_map = road_map_of(roads, walks, paved, *outlines)
    given = description.drones_around
    layout = Layout(
        network=roads.network,
        slots=tuple(slot for slot, _ in starts),
        connected_order=tuple(
            sorted(range(len(starts)), key=lambda k: (starts[k][1], starts[k][0].lane[:2] not in endless))
        ),
        footways=walks.footways if walks else None,
        rsus=rsus,
        rsu_height_m=mast_m,
        speeds_m_s=build_speeds(roads),
        static=(
            *town_parts(road_map, walks.stripes if walks else [], [], rsus, mast_m, ground),
            *paved_parts(paved),
            *(part for one in (*blocks, *walls) for part in one.parts),
            *trees,
        ),
        road_map=road_map,
        movements=roads.movements,
        priority=roads.priority,
        yields=roads.yields,
        signals=roads.signals,
        cut=description.cut,
        cars_first=description.cars_first,
        cycleways=rides.footways if rides else None,
        bays=bays,
        flights=flights_around((low + high) / 2 if given is None else np.array(given, dtype=np.float64)),
        roads_ahead=roads.ahead,
        clearance_m=_CLEARANCE_M,
    )
    works = build_ground(roads, terrain)
    if works.kerb_m > 0 and paved[PAVEMENT]:
        require_off_lanes(paved[PAVEMENT], roads, middles)
    layout = works.applied(layout, turning_loops(roads))
    if description.furniture is None:
        return layout
    require_furniture_off_roads(description.furniture, root, middles)
    return with_furniture(layout, description.furniture)


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


def write_place_file(
    path: str | Path, description: PlaceDescription | Mapping[str, Any], content: Mapping[str, Any]
) -> Path:
    """Write a scenario file with a place that reads back to the same numbers, bit by bit; an older file is replaced.

    `content` has the other keys of the file as plain data. They are checked when it is read.

    Raises:
        ScenarioFileError: the file cannot be written.
    """
    try:
        place = description.plain if isinstance(description, PlaceDescription) else description
        return write_whole(path, yaml_text({"place": place, **content}))
    except InvalidValueError as error:
        raise ScenarioFileError(str(error)) from error


_STRAIGHT_RAD = 1e-3  # at smaller kinks the slit outside is at most 2 mm wide


def road_map_of(
    roads: Roads, walks: Ways | None, paved: Mapping[str, list[Floats]], buildings: list[Floats], walls: list[Floats]
) -> RoadMap:
    """Return the outlines (K, 2) m of a place; `paved` has some by kind."""
    lanes = [quad for lane in roads.network.lanes.values() for quad in lane_outline(lane)] + _wedges(roads.network)
    crosswalks, pavements = (walks.crosswalks, walks.pavements) if walks else ([], [])
    more: dict[str, Any] = {SURFACES[kind]: tuple(outlines) for kind, outlines in paved.items()}
    more |= {"lanes": (*lanes, *paved["road"]), "pavements": (*pavements, *paved["pavement"])}
    lines = lane_lines(roads.network, roads.movements)
    lit = [roads.lane(road) for signal in roads.signals for road in signal.roads]
    stops = tuple(np.array([lane.position(0.0, side * lane.width / 2) for side in (-1, 1)]) for lane in lit)
    more |= {"crosswalks": tuple(crosswalks), "buildings": tuple(buildings), "walls": tuple(walls)}
    return RoadMap(markings=lines, stop_lines=stops, **more)


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
