"""Description of a place, from a map that is cut out."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from itertools import product

import numpy as np

from coopsim.config.annotated import Point
from coopsim.data.maps.dress.surroundings import surroundings_of
from coopsim.data.maps.place.bends import part_bends
from coopsim.data.maps.place.clear import clear_of_roads, loop_ground
from coopsim.data.maps.place.heights import heights_of
from coopsim.data.maps.place.lights import signals_of
from coopsim.data.maps.place.lines import heading_of, part_of, spaced
from coopsim.data.maps.place.rights import add_yields
from coopsim.data.maps.place.strips import Strip, Strips, strips_of
from coopsim.data.maps.street_map import StreetMap
from coopsim.geometry import exact
from coopsim.geometry.se3 import Floats, wrap_angle
from coopsim.world.places.description import MapLane, PlaceDescription, point_of

_WIDTHS_M, _SPEEDS_M_S = (2.5, 8.0), (1.0, 25.0)  # who drives faster cannot stop within sight of others, 60 m
_ALIKE_M = 0.02
_DECIMALS = 3
_LOOP_M = (3.2, 15.5)  # from a lane to one on its inner side, into which vehicles can turn round
_SIDE_M = 3.0  # from the middle of their lanes to the middle of that between them and others
_BEYOND_M, _LEAST_M = 32.0, 20.0  # that loops reach beyond the ends of lanes; that is left of these
_OPPOSITE_RAD = np.radians(160.0)
_ROOM_M = 300.0  # of lanes without end, on which connected cars can stay
_CARS_FIRST = 10  # starts there that have cars, not trucks


def describe_place(streets: StreetMap, seed: int) -> PlaceDescription:
    """Describe the place of a map that is cut out: its roads, right of way, lights, and what is beside the roads.

    Args:
        streets: the part of a map, see `coopsim.data.maps.place.cut.cut_out`.
        seed: decides the lights that the file has no program for, and what the map lacks beside the roads.
    """
    beside = surroundings_of(streets, seed)
    strips = strips_of(streets)
    part_bends(strips, streets.lanes)
    ways = [each for each in strips.all.values() if each.way is not None]
    add_yields(streets, ways)
    side = "left" if streets.left_hand else "right"
    loops = _loops(strips, 1 if side == "right" else -1)
    nodes = _nodes(strips)
    order = sorted(strips.all.values(), key=lambda each: float(exact.norm(each.line[:, :2].mean(axis=0))))
    known = {name: lane.traffic_per_h for name, lane in streets.lanes.items()}
    known |= {name: way.traffic_per_h for name, way in streets.ways.items()}
    roads = [replace(_lane(each, strips), traffic_per_h=known.get(each.name.rstrip("~"))) for each in order]
    return PlaceDescription(
        nodes=nodes,
        roads=(*roads, *loops),
        signals=signals_of(streets, ways, beside.crosswalks, seed),
        cut=True,
        cars_first=_CARS_FIRST,
        traffic_side=side,
        heights=heights_of(streets),
        **clear_of_roads(beside.fields, strips.all.values(), loops, nodes),
    )


def _nodes(strips: Strips) -> Mapping[str, Point]:
    found: dict[str, Point] = {}
    for each in strips.all.values():
        for name, place in ((each.start, each.line[0]), (each.end, each.line[-1])):
            found.setdefault(name, point_of(_settled(place[:2])))
    return found


def _settled(values: Floats) -> Floats:
    return np.round(values, _DECIMALS) + 0.0


def _lane(strip: Strip, strips: Strips) -> MapLane:
    line, width_m = strip.line, np.clip(strip.width_m, *_WIDTHS_M)
    same = float(np.ptp(width_m)) < _ALIKE_M
    nodes = {name: (each.start, each.end) for name, each in strips.all.items()}
    left, right = (
        nodes[side] if side in nodes and getattr(strips.all[side], back) == strip.name and side != strip.name else ()
        for side, back in ((strip.left or "", "right"), (strip.right or "", "left"))
    )
    speed_m_s = None if strip.speed_m_s is None else float(np.clip(strip.speed_m_s, *_SPEEDS_M_S))
    return MapLane(
        strip.start,
        strip.end,
        tuple(point_of(place) for place in _settled(line[1:-1, :2])),
        curved=True,
        width_m=round(float(width_m.mean()), _DECIMALS) if same else None,
        widths_m=() if same else tuple(_settled(width_m).tolist()),
        speed_m_s=speed_m_s,
        yields=None if strip.yields is None else tuple(nodes[name] for name in strip.yields if name in nodes),
        left=left,
        right=right,
    )


def _loops(strips: Strips, inner: int) -> list[MapLane]:
    """Return loops at lanes that end, where connected cars could otherwise not stay; lanes end sooner to have room.

    They lead to the inner side of lanes, 1: left, -1: right.
    """
    ending, starting = strips.by_node()
    if _endless_m(strips) >= _ROOM_M:
        return []
    lanes = {each.name: spaced(each.line, 1.0)[:, :2] for each in strips.all.values()}
    exits = [each for node, found in ending.items() if node not in starting for each in found if each.way is None]
    entries = [each for node, found in starting.items() if node not in ending for each in found if each.way is None]
    loops, taken = list[MapLane](), list[Floats]()
    for leaving in exits:
        for coming, back_m in product(entries, (_BEYOND_M, 0.0)):
            if min(leaving.length_m, coming.length_m) < back_m + _LEAST_M:
                continue
            out = part_of(leaving.line, leaving.width_m, 0.0, leaving.length_m - back_m)
            into = part_of(coming.line, coming.width_m, back_m, coming.length_m)
            if not _face(out[0], into[0], inner):
                continue
            (*middle, radius_m), _ = loop_ground(out[0][-1, :2], into[0][0, :2], _SIDE_M)
            others = [lanes[name] for name in lanes if name not in (leaving.name, coming.name)]
            free = not others or float(exact.norm(np.concatenate(others) - middle).min()) > radius_m
            if free and all(float(exact.norm(middle - each)) > 2 * radius_m for each in taken):
                taken.append(np.array(middle))
                loops.append(MapLane(leaving.end, coming.start, turn="around"))
                (leaving.line, leaving.width_m), (coming.line, coming.width_m) = out, into
                entries.remove(coming)
                break
    return loops


def _face(leaving: Floats, coming: Floats, inner: int) -> bool:
    """Return whether a line ends beside the beginning of another one, of opposite direction, on its inner side."""
    heading = heading_of(leaving[-2:])
    across = (coming[0] - leaving[-1])[:2]
    aside_m = float(exact.dot(across, inner * np.array([-exact.sin(heading), exact.cos(heading)])))
    opposite = abs(float(wrap_angle(heading_of(coming[:2]) - heading))) > _OPPOSITE_RAD
    return opposite and _LOOP_M[0] < aside_m < _LOOP_M[1] and float(exact.norm(across)) <= 1.02 * aside_m


def _endless_m(strips: Strips) -> float:
    """Return the length of the strips from which one can drive on without end, m."""
    kept = dict(strips.all)
    while True:
        starts = {each.start for each in kept.values()}
        ended = [name for name, each in kept.items() if each.end not in starts]
        if not ended:
            return sum(each.length_m for each in kept.values())
        for name in ended:
            del kept[name]
