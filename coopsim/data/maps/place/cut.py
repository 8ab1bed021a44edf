"""Cut a place out of a map: whole junctions, and lanes as far as a circle."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Mapping
from typing import TypeVar

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from coopsim.data.maps.place.lines import part_of
from coopsim.data.maps.street_map import DRIVEN, StreetJunction, StreetLane, StreetMap, StreetSolid, StreetWay
from coopsim.geometry import exact
from coopsim.geometry.outlines import along_of
from coopsim.geometry.se3 import Floats

MARGIN_M = 20.0
"""Least distance of a junction from the circle: vehicles that come in have to see it, and stop."""

_LEAST_M = 2.0  # of a piece of a lane that the circle leaves
_PASSING_M = 60.0  # least length of lanes that lead to no junction within the circle
_ROUNDING_M = 1e-6

T = TypeVar("T")


def cut_out(streets: StreetMap, around: tuple[float, float], radius_m: float) -> StreetMap:
    """Cut a circle out of a map, and move its centre to (0, 0); heights stay.

    Junctions are kept whole, at least `MARGIN_M` within the circle. Lanes and walls end at the circle; a lane that
    comes in again goes on as "ID/2", "ID/3" and so on. Driven lanes that lead to no junction are kept from 60 m on.
    Crossings, areas and signals are kept where they lie within, other solids where a part does.

    Args:
        streets: the map.
        around: centre of the circle, in the map's plane.
        radius_m: its radius.
    """
    centre = np.array([*around, 0.0])
    near = _near(streets, centre, radius_m)
    ways = {way.id: dataclasses.replace(way, line=way.line - centre) for way in near if isinstance(way, StreetWay)}
    junctions = _whole_junctions(streets, ways, centre[:2], radius_m - MARGIN_M)
    lanes = [lane for lane in near if isinstance(lane, StreetLane)]
    lanes = [lane for lane in lanes if lane.junction is None or lane.junction in junctions]
    pieces = {lane.id: _pieces(dataclasses.replace(lane, line=lane.line - centre), radius_m) for lane in lanes}
    first = {name: found[0].id for name, (found, starts, _) in pieces.items() if found and starts}
    last = {name: found[-1].id for name, (found, _, ends) in pieces.items() if found and ends}
    links = {
        last[start]: tuple(first[end] for end in after if end in first)
        for start, after in streets.links.items()
        if start in last
    }
    ways = {
        way.id: dataclasses.replace(way, start=last[way.start], end=first[way.end])
        for way in ways.values()
        if way.junction in junctions and way.start in last and way.end in first
    }
    kept = _beside({name: found for name, (found, _, _) in pieces.items()})
    kept = _reaching(kept, links, ways)
    inside = {name: piece for name, piece in last.items() if piece in kept}
    crossings = tuple(
        dataclasses.replace(each, line=each.line - centre)
        for each in streets.crossings
        if _reach_m(each.line - centre) < radius_m
    )
    programs = {way.program for way in ways.values()} | {each.program for each in crossings}
    return dataclasses.replace(
        streets,
        lanes=kept,
        links={name: tuple(each for each in after if each in kept) for name, after in links.items() if name in kept},
        ways=ways,
        junctions=junctions,
        programs={name: each for name, each in streets.programs.items() if name in programs},
        signals=tuple(
            dataclasses.replace(each, at=each.at - centre, lanes=_known(each.lanes, inside))
            for each in streets.signals
            if _reach_m(each.at[None] - centre) < radius_m
        ),
        crossings=crossings,
        areas=tuple(
            dataclasses.replace(each, outline=each.outline - centre[:2])
            for each in streets.areas
            if _reach_m(each.outline - centre[:2]) < radius_m
        ),
        solids=tuple(
            part
            for each in streets.solids
            for part in _solid(dataclasses.replace(each, line=each.line - centre), radius_m)
        ),
        offset_m=tuple((np.array(streets.offset_m) + centre).tolist()),
    )


def distances_m(lines: Iterable[Floats], point: Floats) -> Floats:
    """Return the distance (N,) m of a point (2,) from each of N lines (K, 2) or (K, 3), in the plane."""
    lines = list(lines)
    sizes = np.array([len(line) for line in lines])
    if not len(sizes):
        return np.zeros(0)
    points = np.concatenate([line[:, :2] for line in lines]) - point
    step = np.diff(points, axis=0, append=points[-1:])
    step[np.cumsum(sizes) - 1] = 0.0  # no step from one line to the next
    square = np.maximum(exact.dot(step, step), 1e-12)
    share = np.clip(-exact.dot(points, step) / square, 0.0, 1.0)
    apart = exact.norm(points + share[:, None] * step)
    found: Floats = np.minimum.reduceat(apart, np.cumsum(sizes) - sizes)
    return found


def _near(streets: StreetMap, centre: Floats, radius_m: float) -> list[StreetLane | StreetWay]:
    """Return the lanes and ways that come into the circle."""
    every: list[StreetLane | StreetWay] = [*streets.lanes.values(), *streets.ways.values()]
    apart = distances_m((each.line for each in every), centre[:2])
    return [every[k] for k in np.flatnonzero(apart < radius_m).tolist()]


def _reach_m(line: Floats) -> float:
    """Return the distance of the farthest point of a line from (0, 0)."""
    return float(exact.norm(line[:, :2]).max())


def _whole_junctions(
    streets: StreetMap, ways: Mapping[str, StreetWay], centre: Floats, radius_m: float
) -> dict[str, StreetJunction]:
    """Return the junctions that lie within a radius with all their ways, moved."""
    reach: dict[str, float] = {}
    for way in ways.values():
        reach[way.junction] = max(_reach_m(way.line), reach.get(way.junction, 0.0))
    cut = {way.junction for name, way in streets.ways.items() if way.junction in reach and name not in ways}
    found = {}
    for name, junction in streets.junctions.items():
        outline = None if junction.outline is None else junction.outline - centre
        reach_m = reach.get(name, np.inf if outline is None else 0.0)
        if max(reach_m, 0.0 if outline is None else _reach_m(outline)) <= radius_m and name not in cut:
            found[name] = dataclasses.replace(junction, outline=outline)
    return found


def _ranges(line: Floats, radius_m: float) -> list[tuple[float, float]]:
    """Return the parts of a line (K, 3) within a circle around (0, 0), as distances along it in the plane, m."""
    points, step = line[:-1, :2], np.diff(line[:, :2], axis=0)
    square = np.maximum(exact.dot(step, step), 1e-12)
    middle = -exact.dot(points, step) / square
    half = np.sqrt(np.maximum(np.square(middle) - (exact.dot(points, points) - radius_m**2) / square, 0.0))
    low, high = np.clip(middle - half, 0.0, 1.0), np.clip(middle + half, 0.0, 1.0)
    along, length = along_of(line)[:-1], exact.norm(step)
    found: list[tuple[float, float]] = []
    for k in np.flatnonzero(high > low).tolist():
        start, end = float(along[k] + low[k] * length[k]), float(along[k] + high[k] * length[k])
        if found and start - found[-1][1] < _ROUNDING_M:
            start = found.pop()[0]
        found.append((start, end))
    return found


def _pieces(lane: StreetLane, radius_m: float) -> tuple[list[StreetLane], bool, bool]:
    """Return the pieces of a lane within the circle, and whether they have its start and its end."""
    length_m, pieces = lane.length_m, []
    ranges = [
        (start, end)
        for start, end in _ranges(lane.line, radius_m)
        if end - start > _LEAST_M or (start < _ROUNDING_M and end > length_m - _ROUNDING_M)
    ]
    for number, (start, end) in enumerate(ranges, start=1):
        line, width_m = part_of(lane.line, lane.width_m, start, end)
        name = lane.id if number == 1 else f"{lane.id}/{number}"
        pieces.append(dataclasses.replace(lane, id=name, line=line, width_m=width_m))
    starts = bool(ranges) and ranges[0][0] < _ROUNDING_M
    return pieces, starts, bool(ranges) and ranges[-1][1] > length_m - _ROUNDING_M


def _beside(pieces: Mapping[str, list[StreetLane]]) -> dict[str, StreetLane]:
    """Return all pieces by id; beside a lane of as many pieces are its neighbour's, in order."""

    def beside(name: str | None, lane: str, number: int) -> str | None:
        found = pieces.get(name or "", [])
        return found[number].id if len(found) == len(pieces[lane]) else None

    return {
        piece.id: dataclasses.replace(
            piece, left=beside(piece.left, name, number), right=beside(piece.right, name, number)
        )
        for name, found in pieces.items()
        for number, piece in enumerate(found)
    }


def _reaching(
    lanes: Mapping[str, StreetLane], links: Mapping[str, tuple[str, ...]], ways: Mapping[str, StreetWay]
) -> dict[str, StreetLane]:
    """Return the lanes without driven ones that lead to no way, and are too short to be streets of their own."""
    driven = {name: k for k, name in enumerate(name for name, lane in lanes.items() if lane.kind in DRIVEN)}
    pairs = [(start, end) for start, after in links.items() for end in after]
    pairs += [(way.start, way.end) for way in ways.values()]
    pairs += [(name, side) for name in driven for side in (lanes[name].left, lanes[name].right) if side is not None]
    if not driven:
        return dict(lanes)
    rows = np.array([(driven[a], driven[b]) for a, b in pairs], dtype=np.int64).reshape(-1, 2)
    size = len(driven)
    _, part = connected_components(coo_matrix((np.ones(len(rows)), (rows[:, 0], rows[:, 1])), shape=(size, size)))
    length_m = np.bincount(part, [lanes[name].length_m for name in driven])
    met = {int(part[driven[way.start]]) for way in ways.values()}
    kept = {name for name, k in driven.items() if int(part[k]) in met or length_m[part[k]] >= _PASSING_M}
    return {name: lane for name, lane in lanes.items() if name in kept or name not in driven}


def _known(names: Iterable[str], pieces: Mapping[str, str]) -> tuple[str, ...]:
    return tuple(pieces[name] for name in names if name in pieces)


def _solid(solid: StreetSolid, radius_m: float) -> list[StreetSolid]:
    """Return what the circle leaves of a solid: parts of walls, others whole."""
    if solid.thickness_m is None:
        reaches = float(exact.norm(solid.line[:, :2]).min()) < radius_m
        return [solid] if reaches else []
    none = np.zeros(len(solid.line))
    parts = [part_of(solid.line, none, *span)[0] for span in _ranges(solid.line, radius_m)]
    return [dataclasses.replace(solid, line=part) for part in parts]
