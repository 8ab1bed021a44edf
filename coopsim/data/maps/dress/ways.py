"""People's ways of a map: along roads and footpaths, over crossings."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np

from coopsim.config.annotated import Point
from coopsim.data.maps.dress.field import Field
from coopsim.data.maps.dress.roads import Roads, pieces_of
from coopsim.data.maps.dress.surfaces import area_m2
from coopsim.data.maps.street_map import StreetCrossing, StreetMap
from coopsim.geometry import exact
from coopsim.geometry.outlines import along_of, keep_corners
from coopsim.geometry.se3 import Floats
from coopsim.types import Ints, Mask
from coopsim.world.places.description import MapWays, point_of

WAY_M = 2.6
"""From the edge of the road to the middle of people's way, where the map says nothing."""

_CLOSEST_M = 1.6  # the same on narrow pavements of a map
_BESIDE_M = 5.5  # from the edge of the road to the middle of a pavement along it, at most
_NEAR_M = 3.0  # from a way along a road to the map's pavement
_AROUND_CROSSING_M = 20.0
_GAP_M, _SHORT_M = 40.0, 15.0  # gaps of ways along roads that are closed, and ways that are left out
_ISLAND_M = 60.0  # round ways that are shorter are left out
_ISLAND_M2 = 1500.0  # islands of roundabouts are smaller
_MEDIAN_M = 8.0  # mean width within a round way, at least
_FREE_M = 2.5  # from a footpath to the other ways
_FREE_LEAST_M = 8.0
_STRAIGHT_M, _STEP_M = 0.25, 1.0
_REACH_M = 8.0  # from the end of a crossing or footpath to the way that it leads to
_SAME_M = 0.5

_Place = tuple[int, float]
"""Number of a line, and index of its point plus a share of the way to the next one."""


@dataclass(slots=True, eq=False)
class Lines:
    """Lines (N, 2) m along which people walk, the places where others meet them, and the crossings between these."""

    lines: list[Floats]
    joins: list[tuple[_Place, _Place]] = field(default_factory=list)
    crossings: dict[str, tuple[_Place, _Place]] = field(default_factory=dict)

    def nearest(self, point: Floats, own: int = -1) -> tuple[_Place, float]:
        """Return the place nearest to a point (2,) m, on another line than `own`, and its distance."""
        starts, along, number, index = self._pieces()
        offset = point - starts
        share = np.clip((offset * along).sum(axis=1) / np.maximum((along * along).sum(axis=1), 1e-12), 0.0, 1.0)
        away_m = np.where(number == own, np.inf, exact.norm(offset - share[:, None] * along))
        best = int(away_m.argmin())
        line, length_m = int(number[best]), float(exact.norm(along[best]))
        steps = max(round(length_m / _SAME_M), 1)  # places on a piece are one, or apart
        at = round(float(share[best]) * steps) / steps
        return (line, float(index[best]) + at), float(away_m[best])

    def at(self, place: _Place) -> Floats:
        """Return a place (2,) m."""
        line, (whole, share) = self.lines[place[0]], divmod(place[1], 1.0)
        here = line[int(whole)]
        found: Floats = here if share == 0.0 else here + share * (line[int(whole) + 1] - here)
        return found

    def spans(self) -> list[tuple[Floats, Floats]]:
        """Return the two ends (2,) m of each crossing."""
        return [(self.at(start), self.at(end)) for start, end in self.crossings.values()]

    def without_islands(self) -> Lines:
        """Return the lines without those around islands to which no crossing leads."""
        pairs = (*self.joins, *self.crossings.values())
        met = {place[0] for pair in pairs for place in pair}
        kept = [k for k, line in enumerate(self.lines) if k in met or not -_ISLAND_M2 < area_m2(line) < 0.0]
        number = {old: new for new, old in enumerate(kept)}

        def moved(pair: tuple[_Place, _Place]) -> tuple[_Place, _Place]:
            (start, at_start), (end, at_end) = pair
            return (number[start], at_start), (number[end], at_end)

        crossings = {name: moved(pair) for name, pair in self.crossings.items()}
        return Lines([self.lines[k] for k in kept], [moved(pair) for pair in self.joins], crossings)

    def _pieces(self) -> tuple[Floats, Floats, Ints, Ints]:
        """Return the beginnings (M, 2) of all straight pieces, the ways (M, 2) to their ends, line and index (M,)."""
        return (
            np.concatenate([line[:-1] for line in self.lines]),
            np.concatenate([np.diff(line, axis=0) for line in self.lines]),
            np.repeat(np.arange(len(self.lines)), [len(line) - 1 for line in self.lines]),
            np.concatenate([np.arange(len(line) - 1) for line in self.lines]),
        )


def ways_beside(streets: StreetMap, roads: Roads) -> list[Floats]:
    """Return the lines (N, 2) m along roads on which people walk; closed ones end where they begin.

    They go where the map has pavements, or crossings; in a map without pavements along all roads with a limit of
    60 km/h at most. They keep the usual distance of the map's pavements from the road.
    """
    ground, walks = roads.field, [lane for lane in streets.lanes.values() if lane.kind == "walk"]
    parts = [pieces_of(lane.line[:, :2]) for lane in walks]
    parts += [
        pieces_of(np.concatenate([each.outline, each.outline[:1]])) for each in streets.areas if each.kind == "walk"
    ]
    near = ground.of(np.concatenate(parts)) if parts else None
    ends = [each.line[[end, end], :2] for each in streets.crossings for end in (0, -1)]
    crossed = ground.of(np.concatenate([pieces_of(end, _AROUND_CROSSING_M) for end in ends])) if ends else None
    found = list[Floats]()
    for line in ground.lines(usual_m(streets, ground)):
        length_m = float(exact.norm(np.roll(line, -1, axis=0) - line).sum())
        is_median = 0.0 < -2 * area_m2(line) < _MEDIAN_M * length_m  # the line around all has an area above zero
        if length_m < _ISLAND_M or is_median:
            continue
        owner = ground.owner_at(line)
        wanted = roads.calm[owner] if near is None else near.at(line) < _NEAR_M
        if crossed is not None:
            wanted = wanted | (crossed.at(line) < 0.0)
        found += runs(line, wanted & ~roads.beyond[owner], roads.beyond[owner])
    return found


def usual_m(streets: StreetMap, ground: Field) -> float:
    """Return the usual distance of people's ways from the road."""
    walks = [lane for lane in streets.lanes.values() if lane.kind == "walk"]
    if not walks:
        return WAY_M
    away_m = ground.at(np.concatenate([lane.line[:, :2] for lane in walks]))
    beside = away_m[(away_m > 0.0) & (away_m < _BESIDE_M)]
    return float(np.clip(np.median(beside), _CLOSEST_M, WAY_M)) if len(beside) else WAY_M


def runs(line: Floats, wanted: Mask, barred: Mask) -> list[Floats]:
    """Return the parts of a closed line (N, 2) m that are wanted (N,), with short gaps that are not barred (N,)."""
    if not wanted.any():
        return []
    if not wanted.all():
        first = int(np.flatnonzero(~wanted & np.roll(wanted, 1))[0])  # a gap begins
        line, wanted, barred = np.roll(line, -first, axis=0), np.roll(wanted, -first), np.roll(barred, -first)
        gap_m = exact.norm(line - np.roll(line, 1, axis=0))
        for start, end in zip(*_gaps(wanted), strict=True):
            if gap_m[start:end].sum() < _GAP_M and not barred[start:end].any():
                wanted[start:end] = True
    if wanted.all():
        closed = np.concatenate([line, line[:1]])
        return [closed] if _length_m(closed) > _SHORT_M else []
    first = int(np.flatnonzero(~wanted & np.roll(wanted, 1))[0])
    line, wanted = np.roll(line, -first, axis=0), np.roll(wanted, -first)
    starts, ends = _gaps(wanted)
    found = [line[a:b] for a, b in zip(ends, [*starts[1:], len(line)], strict=True)]
    return [run for run in found if _length_m(run) > _SHORT_M]


def _gaps(wanted: Mask) -> tuple[list[int], list[int]]:
    """Return beginnings and ends of the gaps in a closed mask (N,) that begins with one and does not end with it."""
    before = np.roll(wanted, 1)
    return np.flatnonzero(~wanted & before).tolist(), np.flatnonzero(wanted & ~before).tolist()


def _length_m(line: Floats) -> float:
    return float(exact.norm(np.diff(line, axis=0)).sum())


def footpaths(streets: StreetMap, ground: Field, beside: list[Floats]) -> list[Floats]:
    """Return the parts (N, 2) m of a map's pavements and footpaths that lie away from the ways along roads."""
    walks = [_dense(lane.line[:, :2]) for lane in streets.lanes.values() if lane.kind == "walk"]
    others = ground.of(np.concatenate([pieces_of(line) for line in beside])) if beside else None
    found = list[Floats]()
    for line in walks:
        away_m = ground.at(line)
        free = away_m > 0.0
        if others is not None:
            free &= others.at(line) > _FREE_M
        moved = line + np.maximum(_CLOSEST_M - away_m, 0.0)[:, None] * ground.away(line)
        cuts = np.flatnonzero(np.diff(free)) + 1
        parts = [part for part, own in zip(np.split(moved, cuts), np.split(free, cuts), strict=True) if own[0]]
        found += [part for part in parts if _length_m(part) > _FREE_LEAST_M]
    return found


def _dense(line: Floats) -> Floats:
    """Return a line (N, 2) m with more points, 1 m apart."""
    along_m = along_of(line)
    at_m = np.unique(np.concatenate([along_m, np.arange(0.0, along_m[-1], _STEP_M)]))
    return np.column_stack([np.interp(at_m, along_m, axis) for axis in line.T])


def joined(beside: list[Floats], paths: list[Floats], crossings: Iterable[StreetCrossing], ground: Field) -> Lines:
    """Join ways along roads, footpaths and crossings; crossings that lead to no way are left out."""
    found = Lines([line[keep_corners(line, _STRAIGHT_M)] for line in (*beside, *paths)])
    for number, line in enumerate(found.lines):
        for index in (0, len(line) - 1) if not np.array_equal(line[0], line[-1]) else ():
            place, away_m = found.nearest(line[index], number)
            if away_m < _REACH_M and _is_clear(line[index], found.at(place), ground):
                found.joins.append(((number, float(index)), place))
    for crossing in crossings if found.lines else ():
        (start, start_m), (end, end_m) = (found.nearest(crossing.line[k, :2]) for k in (0, -1))
        if max(start_m, end_m) < _REACH_M and exact.norm(found.at(end) - found.at(start)) > _SAME_M:
            found.crossings[crossing.id] = start, end
    return found.without_islands()


def _is_clear(start: Floats, end: Floats, ground: Field) -> bool:
    """Return whether no road lies between two points (2,) m."""
    return bool((ground.at(start + np.linspace(0.0, 1.0, 9)[:, None] * (end - start)) > 0.0).all())


def describe(lines: Lines) -> tuple[MapWays | None, dict[str, tuple[str, str]]]:
    """Return people's ways of a description, and the two nodes of each crossing by its id."""
    same, names, nodes = dict[_Place, _Place](), dict[_Place, str](), dict[str, Point]()
    last = [len(line) - 1 for line in lines.lines]
    closed = [np.array_equal(line[0], line[-1]) for line in lines.lines]

    def root(place: _Place) -> _Place:
        number, at = place
        found = (number, at % last[number] if closed[number] else at)
        return root(same[found]) if found in same else found

    def name(place: _Place) -> str:
        if root(place) not in names:
            names[root(place)] = f"w{len(nodes)}"
            nodes[names[root(place)]] = point_of(lines.at(root(place)))
        return names[root(place)]

    for one, other in lines.joins:
        if root(one) != root(other) and exact.norm(lines.at(one) - lines.at(other)) < _SAME_M:
            same[root(one)] = root(other)
    met = [place for pair in (*lines.joins, *lines.crossings.values()) for place in pair]
    ways = list[tuple[str, ...]]()
    for number in range(len(lines.lines)):
        places = {float(k) for k in range(last[number] + 1)} | {at for own, at in met if own == number}
        ways.append(_once([name((number, at)) for at in sorted(places)]))
    ways += [_once([name(one), name(other)]) for one, other in lines.joins]
    across = {each: (name(start), name(end)) for each, (start, end) in lines.crossings.items()}
    across = {each: pair for each, pair in across.items() if pair[0] != pair[1]}
    ways = [way for way in ways if len(way) > 1]
    return (MapWays(nodes, tuple(ways), tuple(across.values())) if ways else None), across


def _once(names: list[str]) -> tuple[str, ...]:
    """Return names without those that repeat the one before."""
    return tuple(each for k, each in enumerate(names) if not k or each != names[k - 1])
