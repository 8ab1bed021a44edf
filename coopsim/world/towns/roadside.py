"""Roadside: paved surfaces, roadside units, trees, sheds, parked vehicles, speed humps and puddles."""

from __future__ import annotations

import numpy as np

from coopsim.geometry import exact
from coopsim.geometry.outlines import convex_pieces, distances_to_lines, keep_corners
from coopsim.geometry.se3 import Floats
from coopsim.world.places.description import MapBay, MapHump, MapPatch, MapTree, MapUnit, line_of, point_of
from coopsim.world.places.layout import rectangle
from coopsim.world.towns.buildings import Part
from coopsim.world.towns.kerbs import CORNER, STREET, STRIP_M, Round, corner_kerb
from coopsim.world.towns.pavements import PeopleWays
from coopsim.world.towns.plan import LANE_M, Street
from coopsim.world.towns.site import Site, frame_between

_BULGE_M = 4.0  # on both sides of a crosswalk's middle the pavement reaches over the parking strip
_STRAIGHT_M = 0.15  # surfaces through fewer points stay this close to the kerb
_UNDER_LANE_M = 0.1  # that pavements reach under the lanes' edge: no slits
_COARSE_M, _BEYOND_M = 0.4, 0.25  # of the surface below a junction's lanes
_STRIP_M = 0.05

_UNIT_FROM_KERB_M = (1.1, 0.9, 0.7)
_FROM_WAY_M = 1.1  # half of a person, their way's breadth, and the mast
_BARELY_M = 0.4  # the same at junctions without enough space, where agents meet
_LEAST = 2  # masts where they meet: the usual number
_CROSSWALK_MORE_M = 1.0  # from the middle of a crosswalk, besides
_SHARES = (0.5, 0.4, 0.6, 0.3, 0.7)  # of the length of the corner's kerb
_ELSEWHERE = 0.6  # share of other corners that have a mast; the first ones are where connected cars meet

_LINED = 0.4  # share of sides of streets with trees at the kerb
_TREE_FROM_KERB_M = 0.7
_APART_M = (9.0, 17.0)
_CROSSWALK_FREE_M = 7.0
_END_FREE_M = 14.0  # from junctions, so that drivers see each other
_TRUNK_M = 0.3
_EVERY_M = (26.0, 7.0)  # of border for each tree behind it, in towns of openness 0 and 1
_BEHIND_M = (3.0, 38.0)
_SHED_EVERY_M, _SHED_BEHIND_M = 70.0, (20.0, 45.0)

_BAY_M = 6.6
_VEHICLE_M = (6.45, 2.45)  # the room that the largest van needs
_ASIDE_M = 0.05  # from the middle of the strip to the pavement: in bends corners come close to the lane
_LEFT_OUT = 0.08  # share of bays
_HUMPS = 0.3  # share of streets of one lane
_HUMP_FREE_M = 18.0  # from stop lines, loops and crosswalks
_RAIN = 0.3  # share of towns with puddles
_PUDDLES = (4, 14)


def pave_junctions(site: Site) -> None:
    """Add the road surface between the stop lines of each junction, and the islands of roundabouts."""
    for junction in site.plan.junctions:
        for arm in range(len(junction.arms)):
            stop_m, half_m = junction.stop_m, junction.half_m
            mouth = np.array([junction.place(arm, stop_m, -half_m), junction.place(arm, stop_m, half_m)])
            kerb = corner_kerb(junction, arm)
            kerb = kerb[keep_corners(kerb, _COARSE_M)]
            out = kerb - junction.centre
            kerb = kerb + _BEYOND_M * out / exact.norm(out, axis=1)[:, None]
            for line in (mouth, kerb):
                middle = np.broadcast_to(junction.centre, line[1:].shape)
                _pave(site, np.stack([middle, line[:-1], line[1:]], axis=1), "road")
        if junction.kind == "roundabout":
            angle = np.arange(16) * np.pi / 8
            circle = np.column_stack([exact.cos(angle), exact.sin(angle)])
            site.pave(junction.centre + (junction.ring_m - LANE_M / 2) * circle, "pavement")


def pave_sides(site: Site) -> None:
    """Add parking strips, and pavements between these, or the kerb, and people's ways."""
    for each, way in zip(site.rounds, site.ways.lines, strict=True):
        edge, strip = each.kerb - _UNDER_LANE_M * each.right, each.offset(0.0)
        inner = np.where(each.strip_m[:, None] > _STRIP_M, strip, edge)
        lines = np.column_stack([edge, inner, way])
        bulge = _bulges(each, site.ways)
        kept = keep_corners(np.vstack([lines, lines[:1]]), _STRAIGHT_M)[:-1]
        here = np.flatnonzero(kept | (bulge != np.roll(bulge, 1)))
        there = np.roll(here, -1)
        parked = np.maximum(each.strip_m[here], each.strip_m[there]) > _STRIP_M
        strips = np.stack([edge[here], edge[there], strip[there], strip[here]], axis=1)
        _pave(site, strips[parked & bulge[here]], "pavement")
        _pave(site, strips[parked & ~bulge[here]], "parking")
        _pave(site, np.stack([inner[here], inner[there], way[there], way[here]], axis=1), "pavement")


def _bulges(each: Round, ways: PeopleWays) -> np.ndarray[tuple[int], np.dtype[np.bool_]]:
    """Return the mask (N,) of points near a crosswalk between junctions."""
    near = np.zeros(len(each.kerb), np.bool_)
    for side, index in each.parts(STREET):
        for street, along_m in ways.mid_block:
            if side.number == street:
                near[index] |= np.abs(each.along_m[index] - along_m) < _BULGE_M
    return near


def _pave(site: Site, surfaces: Floats, kind: str) -> None:
    """Add surfaces (N, K, 2) m with three or four corners each."""
    corners, count = convex_pieces(np.ascontiguousarray(surfaces))
    for outline, number in zip(corners, count.tolist(), strict=True):
        site.pave(outline[:number], kind)


def place_roadside_units(site: Site) -> None:
    """Add masts at corners between kerb and people's way, first at the meeting junction; they look at its middle."""
    spans = np.array(site.ways.spans()).reshape(-1, 2, 2)
    starts = np.concatenate([*site.ways.lines, spans[:, 0]])
    ends = np.concatenate([*(np.roll(line, -1, axis=0) for line in site.ways.lines), spans[:, 1]])
    widths = np.repeat([0.0, _CROSSWALK_MORE_M], [len(starts) - len(spans), len(spans)])
    found, spare = [], []
    for side in (side for each in site.rounds for side in each.sides if side.kind == CORNER):
        spots, from_kerb_m = _unit_spots(side.kerb)
        off_road = distances_to_lines(spots, *site.kerbs) > from_kerb_m - 0.2
        from_way_m = np.where(off_road, distances_to_lines(spots, starts, ends, widths), 0.0)
        clear, meets = from_way_m > _FROM_WAY_M, side.number == site.plan.meeting
        best = int(from_way_m.argmax())
        if clear.any():
            draw = site.stream("mast", side.number, side.arm).random()
            found.append((not meets, draw, spots[int(clear.argmax())], side.number))
        elif meets and from_way_m[best] > _BARELY_M:
            spare.append((from_way_m[best], spots[best], side.number))
    at_meeting = sum(not elsewhere for elsewhere, *_ in found)
    for _, at, number in sorted(spare, key=lambda each: -each[0])[: max(0, _LEAST - at_meeting)]:
        found.append((False, 1.0, at, number))  # people pass close by
    for elsewhere, draw, at, number in sorted(found, key=lambda each: each[:2]):
        if not elsewhere or draw < _ELSEWHERE or "rsus" not in site.parts:
            site.add("rsus", MapUnit(point_of(at), point_of(site.plan.junctions[number].centre)))
            site.kerbside.take(at + np.array([[-0.2, 0.0], [0.2, 0.0]]), 0.2)


def _unit_spots(kerb: Floats) -> tuple[Floats, Floats]:
    """Return places (N, 2) m to the right of a kerb (K, 2) m, best first, and their distances (N,) from it, m."""
    steps = np.diff(kerb, axis=0)
    length_m = exact.hypot(steps[:, 0], steps[:, 1])
    passed_m = np.concatenate([[0.0], np.cumsum(length_m)])
    at_m = np.array(_SHARES) * passed_m[-1]
    which = np.searchsorted(passed_m, at_m, side="right").clip(1, len(steps)) - 1
    right = np.column_stack([steps[which, 1], -steps[which, 0]]) / length_m[which, None]
    on_kerb = np.column_stack([np.interp(at_m, passed_m, kerb[:, axis]) for axis in (0, 1)])
    away_m = np.repeat(_UNIT_FROM_KERB_M, len(at_m))
    count = len(_UNIT_FROM_KERB_M)
    return np.tile(on_kerb, (count, 1)) + away_m[:, None] * np.tile(right, (count, 1)), away_m


def line_streets(site: Site) -> None:
    """Plant rows of trees between kerb and people's way, where no vehicle and nobody passes."""
    for each in site.rounds:
        places = each.offset(_TREE_FROM_KERB_M)
        for side, own in each.parts(STREET):
            rng = site.stream("street trees", side.kind, side.number, side.arm)
            apart_m, size = rng.uniform(*_APART_M), rng.uniform(0.8, 1.15)
            if rng.random() > _LINED:
                continue
            along = each.along_m[own]
            for at_m in np.arange(along.min() + _END_FREE_M, along.max() - _END_FREE_M, apart_m):
                if site.ways.crosses(side.number, at_m, _CROSSWALK_FREE_M):
                    continue
                at = places[own[int(np.abs(along - at_m).argmin())]]
                trunk = at + rectangle((-_TRUNK_M, _TRUNK_M), (-_TRUNK_M, _TRUNK_M))
                if site.kerbside.try_take([trunk]):
                    height_m, crown_m = size * rng.uniform(8.0, 10.5), size * rng.uniform(3.0, 3.9)
                    site.add("trees", MapTree(point_of(at), round(height_m, 2), round(crown_m, 2)))


def plant_behind(site: Site) -> None:
    """Plant trees on private ground and on the islands of roundabouts, and put sheds behind the buildings."""
    for junction in site.plan.junctions:
        if junction.kind == "roundabout" and junction.ring_m - LANE_M / 2 > 5.0:
            site.add("trees", MapTree(point_of(junction.centre), 7.5, 4.5))
    for number, (each, border) in enumerate(zip(site.rounds, site.borders, strict=True)):
        length_m = float(exact.norm(np.diff(border, axis=0), axis=1).sum())
        rng = site.stream("sheds", number)
        for at in _behind(each, border, int(length_m / _SHED_EVERY_M), _SHED_BEHIND_M, rng):
            size, angle = rng.uniform([4.0, 4.0], [12.0, 8.0]), rng.uniform(0.0, np.pi)
            frame = frame_between(at, at + np.array([exact.cos(angle), exact.sin(angle)]))
            shed = rectangle((0.0, size[0]), (0.0, size[1]))
            if site.taken.is_free(frame.place(shed), 3.0):
                site.build(frame, [Part(shed)], float(rng.uniform(2.6, 5.0)))
        rng = site.stream("trees", number)
        count = int(length_m / np.interp(site.openness, (0.0, 1.0), _EVERY_M))
        for at in _behind(each, border, count, _BEHIND_M, rng):
            height_m, crown_m = rng.uniform(5.0, 13.0), rng.uniform(3.0, 6.5)
            site.plant(at, round(height_m, 2), round(crown_m, 2))


def _behind(each: Round, border: Floats, count: int, away_m: tuple[float, float], rng: np.random.Generator) -> Floats:
    """Draw places (N, 2) m on the far side of a border (M, 2) m."""
    index = rng.integers(len(border), size=count)
    places: Floats = border[index] + rng.uniform(*away_m, count)[:, None] * each.right[index]
    return places


def mark_bays(site: Site) -> None:
    """Add bays on all parking strips, away from crosswalks and driveways."""
    for each in site.rounds:
        line = each.offset(-STRIP_M / 2)
        for side, index in each.parts(STREET):
            full = index[each.strip_m[index] > STRIP_M - 1e-6]
            if not len(full):
                continue
            rng = site.stream("bays", side.number, side.arm)
            strips = np.split(full, np.flatnonzero(np.diff(full) > 1) + 1)  # one is interrupted where lanes split
            along = np.concatenate([_bays_along(each.along_m[strip], line[strip]) for strip in strips])
            keep = rng.random(len(along)) > _LEFT_OUT
            for street, at_m in site.ways.mid_block:
                keep &= (street != side.number) | (np.abs(along - at_m) > _BULGE_M + _BAY_M / 2)
            if keep.any():
                _mark(site, site.plan.streets[side.number], side.arm, along[keep])


def _bays_along(along_m: Floats, line: Floats) -> Floats:
    """Return places (M,) along the street, evenly spaced on a line (N, 2) m beside it that has points at `along_m`."""
    steps_m = exact.norm(np.diff(line, axis=0), axis=1)
    passed_m = np.concatenate([[0.0], np.cumsum(steps_m)])
    count = int(passed_m[-1] // _BAY_M)
    middles_m = (np.arange(count) + 0.5) * passed_m[-1] / max(count, 1)
    return np.asarray(np.interp(middles_m, passed_m, along_m))


def _mark(site: Site, street: Street, way: int, along: Floats) -> None:
    places = street.position(along, -way * (street.half_m(along) + STRIP_M / 2 + _ASIDE_M))
    headings = street.heading(along) + (0.0 if way > 0 else np.pi)
    for at, heading in zip(places, headings, strict=True):
        cos, sin = exact.cos(heading), exact.sin(heading)
        a, b = _VEHICLE_M[0] / 2 * np.array([cos, sin]), _VEHICLE_M[1] / 2 * np.array([-sin, cos])
        if site.kerbside.try_take([at + np.array([-a - b, a - b, a + b, b - a])]):
            site.add("parked", MapBay(point_of(at), float(np.degrees(heading))))


def add_humps(site: Site) -> None:
    """Add a hump to some streets of one lane in each direction."""
    for street in site.plan.streets:
        rng = site.stream("hump", street.number)
        wanted, share, height_m = rng.random() < _HUMPS, rng.uniform(0.3, 0.7), rng.uniform(0.07, 0.1)
        first, last = street.span_m
        along_m = first + share * (last - first)
        crossed = site.ways.crosses(street.number, along_m, _HUMP_FREE_M)
        half_m = street.half_m([along_m - 4.0, along_m + 4.0])
        if not wanted or crossed or min(along_m - first, last - along_m) < _HUMP_FREE_M or half_m.max() > LANE_M + 0.01:
            continue
        at, heading_deg = point_of(street.position(along_m, -0.02)[0]), float(np.degrees(street.heading(along_m)[0]))
        site.add("humps", MapHump(at, heading_deg, 2 * LANE_M, 3.7, round(float(height_m), 3)))


def add_puddles(site: Site) -> None:
    """Add wet patches along the gutters, in some towns."""
    rng = site.stream("puddles")
    if rng.random() > _RAIN:
        return
    angle = np.arange(7) * 2 * np.pi / 7
    for _ in range(int(rng.integers(*_PUDDLES))):
        street = site.plan.streets[rng.integers(len(site.plan.streets))]
        along_m, way = rng.uniform(*street.span_m), rng.choice([-1, 1])
        half_m, long_m, wide_m = float(street.half_m(along_m)), rng.uniform(1.2, 4.0), rng.uniform(0.4, 0.9)
        reach = rng.uniform(0.8, 1.0, 7)
        along = along_m + long_m * exact.cos(angle) * reach
        aside = way * (half_m - 0.1 - wide_m + wide_m * exact.sin(angle) * reach)
        outline = street.position(along, aside)
        sides = np.roll(outline, -1, axis=0) - outline
        after = np.roll(sides, -1, axis=0)
        turns = way * (sides[:, 0] * after[:, 1] - sides[:, 1] * after[:, 0])
        if turns.min() > 0.0:  # in sharp bends some are not convex
            site.add("wet", MapPatch(line_of(outline)))
