"""What stands and lies beside the roads of a map, as fields of a place's description."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from coopsim.data.maps.dress import solids
from coopsim.data.maps.dress.crossings import crossings_of
from coopsim.data.maps.dress.field import Field
from coopsim.data.maps.dress.paving import paved
from coopsim.data.maps.dress.roads import Roads, pieces_of, roads_of
from coopsim.data.maps.dress.spots import bays, junctions, units
from coopsim.data.maps.dress.surfaces import area_m2
from coopsim.data.maps.dress.ways import Lines, describe, footpaths, joined, runs, usual_m, ways_beside
from coopsim.data.maps.street_map import StreetMap
from coopsim.geometry.se3 import Floats
from coopsim.geometry.taken_ground import TakenGround
from coopsim.support.rng import stream
from coopsim.world.places.description import point_of
from coopsim.world.places.streetside import LOTS, Streetside

KERB_M = 0.12
"""Height of pavements over the road, as in drawn towns."""

_VERGE_M, _BORDER_M, _HALF_WAY_M = 2.5, 0.3, 1.55  # from roads, from pavements, from the middle of ways to their edge
_LINED_M = 2.0  # from kerbs to people's ways, at least, where trees stand between
_CROSSWALK_FREE_M = 6.0
_LEAST_M2 = 1500.0  # of a block with houses; the islands of roundabouts are smaller


@dataclass(frozen=True, slots=True, eq=False)
class Surroundings:
    """What is beside the roads of a map.

    Attributes:
        fields: fields of a `PlaceDescription`, for `dataclasses.replace`.
        crosswalks: the two nodes of `walks` of each crossing that people use, by the crossing's id; for lights
            (`MapSignal.crosswalks`).
    """

    fields: Mapping[str, Any]
    crosswalks: Mapping[str, tuple[str, str]]


def surroundings_of(streets: StreetMap, seed: int) -> Surroundings:
    """Draw what stands and lies beside the roads of a map.

    What the map has comes first. Where it has no houses, lots are drawn along streets; where it has no pavements at
    all, there are some along roads with a limit of 60 km/h at most. The fields are `paved`, `walks`, `buildings`,
    `walls`, `trees`, `parked`, `rsus`, `mast_m`, `drones_around`, `kerb_m` and, where the map has poles, `furniture`.
    They fit roads of this map whose lanes are at most 2.6 m wide, or as wide as in the map. The place is complete with
    leaves and furniture: `leafy` and `furnished` of `coopsim.world.furniture.furnish`.

    Args:
        streets: a map, or a part of one that was cut out.
        seed: seed of what is drawn.
    """
    roads = roads_of(streets)
    beside = ways_beside(streets, roads)
    lines = joined(beside, footpaths(streets, roads.field, beside), crossings_of(streets, roads), roads.field)
    walks, crosswalks = describe(lines)
    people, taken, kerbside = _people(lines, roads.field), TakenGround(), TakenGround()
    pieces = roads.pieces
    taken.take_lines(pieces[:, :2], pieces[:, 2:4], pieces[:, 4:].max(axis=1) + 0.5)
    found = _of_the_map(streets, roads.field, seed)
    for building in found["buildings"]:
        taken.take(np.array(building.outline))
    for wall in found["walls"]:
        taken.take(np.array(wall.along), 0.3)
    surfaces = paved(streets, roads, beside)
    for area in surfaces:
        if area.kind in ("pavement", "parking"):
            taken.take(np.array(area.outline))
    _take(lines, taken, kerbside)
    masts = units(streets, roads, people)
    for unit in masts:
        kerbside.take(np.array([unit.at, unit.at]), 0.3)
    parked = bays(streets, roads, kerbside)
    ground = roads.field
    lined = usual_m(streets, ground) >= _LINED_M
    kerbs = [line - ground.at(line)[:, None] * ground.away(line) for line in beside if lined]
    fronts, country = _borders(streets, roads, lines)
    drawn = LOTS.get("town")(Streetside(seed, tuple(kerbs), tuple(fronts), tuple(country), taken, kerbside))
    fields: dict[str, Any] = {
        name: (*found.get(name, ()), *drawn.get(name, ())) for name in ("buildings", "walls", "trees")
    }
    middle = next(iter(junctions(streets)), (np.zeros(2), 0.0))[0]
    fields |= {
        "paved": (*surfaces, *drawn.get("paved", ())),
        "parked": (*parked, *drawn.get("parked", ())),
        "walks": walks,
        "rsus": masts,
        "mast_m": float(np.round(stream(seed, "masts").uniform(5.0, 8.0), 1)),
        "drones_around": point_of(middle),
        "kerb_m": KERB_M,
    }
    return Surroundings(fields | ({"furniture": found["furniture"]} if found["furniture"] else {}), crosswalks)


def _of_the_map(streets: StreetMap, ground: Field, seed: int) -> dict[str, tuple[Any, ...]]:
    """Return the map's own buildings, walls, trees and furniture."""
    found: dict[str, list[Any]] = {"buildings": [], "walls": [], "trees": [], "furniture": []}
    for solid in streets.solids:
        if solid.kind == "building" or (solid.kind == "wall" and solid.thickness_m is None):
            found["buildings"] += solids.buildings(solid, ground, seed)
        elif solid.kind == "wall":
            found["walls"] += solids.walls(solid, ground)
        elif solid.kind == "tree":
            found["trees"] += solids.trees(solid, ground)
        else:
            found["furniture"] += solids.poles(solid, ground)
    return {name: tuple(parts) for name, parts in found.items()}


def _people(lines: Lines, ground: Field) -> Field | None:
    """Return the distances from the middles of people's ways, and from crossings."""
    pieces = [pieces_of(line) for line in lines.lines]
    pieces += [pieces_of(np.array(span), _HALF_WAY_M) for span in lines.spans()]
    return ground.of(np.concatenate(pieces)) if pieces else None


def _take(lines: Lines, taken: TakenGround, kerbside: TakenGround) -> None:
    """Take the ground of people's ways, and that around crossings at the kerb."""
    for line in lines.lines:
        taken.take_lines(line[:-1], line[1:], np.full(len(line) - 1, _HALF_WAY_M))
    for span in lines.spans():
        kerbside.take(np.array(span), _CROSSWALK_FREE_M)
        taken.take(np.array(span), _HALF_WAY_M)


def _borders(streets: StreetMap, roads: Roads, lines: Lines) -> tuple[list[Floats], list[Floats]]:
    """Return the borders of private ground, those for houses and those along fast roads."""
    public = [pieces_of(line, _HALF_WAY_M) for line in lines.lines]
    for lane in streets.lanes.values():
        if lane.kind == "walk":
            half_m = lane.width_m / 2
            public.append(np.column_stack([lane.line[:-1, :2], lane.line[1:, :2], half_m[:-1], half_m[1:]]))
    ground = replace(roads.field, distance_m=roads.field.distance_m - (_VERGE_M - _BORDER_M))
    ground = ground.with_pieces(np.concatenate(public)) if public else ground
    fronts, country = list[Floats](), list[Floats]()
    for line in ground.lines(_BORDER_M):
        if -_LEAST_M2 < area_m2(line) < 0.0:  # an island
            continue
        fast = roads.fast[roads.field.owner_at(line)]
        fronts += runs(line, ~fast, np.ones_like(fast))
        country += runs(line, fast, np.ones_like(fast))
    return fronts, country
