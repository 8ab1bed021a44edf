"""Places beside the roads of a map for parked vehicles and roadside units."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from coopsim.data.maps.dress.field import Field
from coopsim.data.maps.dress.roads import Roads, driven_middles
from coopsim.data.maps.dress.surfaces import convex_parts
from coopsim.data.maps.rectangles import along_rectangle
from coopsim.data.maps.street_map import StreetArea, StreetLane, StreetMap
from coopsim.geometry import exact
from coopsim.geometry.se3 import Floats
from coopsim.geometry.taken_ground import TakenGround
from coopsim.types import Mask
from coopsim.world.places.description import MapBay, MapUnit, point_of

_VEHICLE_M = np.array([6.45, 2.45])  # the room of the largest van
_BAY_M, _SIDE_M, _MIDDLE_M = 6.9, 1.8, 3.1  # along a street; least distances of its side and middle from lanes' middles
_MOVED_M = 1.2  # aside, at most
_ROW_M, _AISLE_M = 3.0, 6.5  # between vehicles side by side, and two rows
_SMALL_M = (9.0, 5.0)  # areas up to this size are for one vehicle
_UNIT_M = (1.1, 3.4)  # from the edge of the road
_FROM_WAY_M, _BARELY_M = 1.1, 0.4
_MOST_UNITS, _FEWEST_WAYS, _BEYOND_M = 8, 4, 8.0


def bays(streets: StreetMap, roads: Roads, taken: TakenGround) -> tuple[MapBay, ...]:
    """Return places for vehicles on lanes and areas for parking, and take their ground."""
    found = list[MapBay]()
    spots = [spot for lane in streets.lanes.values() if lane.kind == "park" for spot in _along(lane)]
    spots += [spot for area in streets.areas if area.kind == "park" for spot in _within(area)]
    if not spots:
        return ()
    middles = roads.field.of(driven_middles(streets))
    for place, heading in spots:
        outline = vehicle_at(place, heading)
        short_m = max(_SIDE_M - middles.at(outline).min(), _MIDDLE_M - middles.at(place[None])[0], 0.0)
        moved = short_m * middles.away(place[None])[0]
        if (
            short_m < _MOVED_M
            and _is_off(outline + moved, place + moved, middles)
            and taken.try_take([outline + moved], 0.3)
        ):
            found.append(MapBay(point_of(place + moved), float(np.degrees(heading))))
    return tuple(found)


def vehicle_at(place: Floats, heading: float) -> Floats:
    """Return the outline (4, 2) m of the largest vehicle that may park at a place (2,), with a heading in rad."""
    ahead = np.array([exact.cos(heading), exact.sin(heading)])
    left = np.array([-ahead[1], ahead[0]])
    corners = np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]]) * _VEHICLE_M / 2
    return np.asarray(place + corners[:, :1] * ahead + corners[:, 1:] * left)


def _is_off(outline: Floats, place: Floats, middles: Field) -> bool:
    sides = np.concatenate([outline, (outline + np.roll(outline, -1, axis=0)) / 2])
    return bool(middles.at(sides).min() > _SIDE_M - 0.05 and middles.at(place[None])[0] > _MIDDLE_M - 0.05)


def _along(lane: StreetLane) -> Iterator[tuple[Floats, float]]:
    """Yield middles (2,) m and headings (rad) of bays along a lane."""
    steps_m = exact.norm(np.diff(lane.line[:, :2], axis=0))
    along_m = np.concatenate([[0.0], np.cumsum(steps_m)])
    count = int(along_m[-1] // _BAY_M)
    for at_m in (np.arange(count) + 0.5) * along_m[-1] / max(count, 1):
        k = min(int(np.searchsorted(along_m, at_m, "right")) - 1, len(steps_m) - 1)
        ahead = lane.line[k + 1, :2] - lane.line[k, :2]
        place = lane.line[k, :2] + (at_m - along_m[k]) / max(steps_m[k], 1e-9) * ahead
        yield place, float(exact.arctan2(ahead[1], ahead[0]))


def _within(area: StreetArea) -> Iterator[tuple[Floats, float]]:
    """Yield middles (2,) m and headings (rad) of bays on an area: one, or rows of bays with aisles between them."""
    line, width_m = along_rectangle(np.column_stack([area.outline, np.zeros(len(area.outline))]), 0.0)
    start, along = line[0, :2], line[1, :2] - line[0, :2]
    length_m = float(exact.norm(along))
    along = along / max(length_m, 1e-9)
    heading = float(exact.arctan2(along[1], along[0]))
    if length_m < _SMALL_M[0] and width_m < _SMALL_M[1]:
        yield start + length_m / 2 * along, heading
        return
    left, parts = np.array([-along[1], along[0]]), convex_parts(area.outline)
    row_m = _VEHICLE_M[0] + _AISLE_M
    rows = np.arange(_VEHICLE_M[0] / 2 - width_m / 2, width_m / 2, row_m)
    for aside_m in rows.tolist():
        for at_m in np.arange(_ROW_M / 2, length_m - _ROW_M / 2, _ROW_M).tolist():
            place = start + at_m * along + aside_m * left
            ends = place + np.array([[-0.5], [0.5]]) * _VEHICLE_M[0] * left
            if all(any(_holds(part, end) for part in parts) for end in ends):
                yield place, heading + np.pi / 2


def _holds(outline: Floats, point: Floats) -> bool:
    ahead, there = np.roll(outline, -1, axis=0) - outline, point - outline
    return bool((ahead[:, 0] * there[:, 1] - ahead[:, 1] * there[:, 0] >= 0.0).all())


def units(streets: StreetMap, roads: Roads, people: Field | None) -> tuple[MapUnit, ...]:
    """Return places for roadside units at junctions, those with the most ways first; they face its middle.

    The first junction has two, at opposite corners. They stand at the edge of the road, off `people`'s ways.
    """
    spots = np.concatenate([line for away_m in _UNIT_M for line in roads.field.lines(away_m)])
    spots = spots[~roads.beyond[roads.field.owner_at(spots)]]
    clear_m = np.full(len(spots), np.inf) if people is None else people.at(spots)
    found = list[MapUnit]()
    for centre, reach_m in junctions(streets):
        offset = spots - centre
        away_m = exact.norm(offset)
        for least_m in (_FROM_WAY_M, _BARELY_M):
            fits = (away_m < reach_m) & (clear_m > least_m)
            if fits.any():
                break
        else:
            continue
        first = int(np.where(fits, away_m, np.inf).argmin())
        chosen = [first]
        if not found:
            chosen.append(_opposite(offset, away_m, fits, first))
        found += [MapUnit(point_of(spots[k]), point_of(centre)) for k in dict.fromkeys(chosen)]
    return tuple(found[:_MOST_UNITS])


def _opposite(offset: Floats, away_m: Floats, fits: Mask, first: int) -> int:
    """Return the place on the far side of a junction that is about as near as the first."""
    cosine = exact.dot(offset, offset[first]) / np.maximum(away_m * away_m[first], 1e-9)
    return int(np.where(fits & (away_m < 1.5 * away_m[first] + 2.0), cosine, np.inf).argmin())


def junctions(streets: StreetMap) -> list[tuple[Floats, float]]:
    """Return the middles (2,) m and radii of junctions, m, those with the most ways first."""
    ways: dict[str, list[Floats]] = {}
    for way in streets.ways.values():
        ways.setdefault(way.junction, []).append(way.line[:, :2])
    found = []
    for _, lines in sorted(ways.items(), key=lambda each: (-len(each[1]), each[0])):
        centre = np.mean([line[len(line) // 2] for line in lines], axis=0)
        if len(lines) >= _FEWEST_WAYS:
            found.append((centre, float(exact.norm(np.concatenate(lines) - centre).max()) + _BEYOND_M))
    return found
