"""Lots along streets and at corners: buildings, gardens, walls and driveways."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from coopsim.geometry import exact
from coopsim.geometry.outlines import keep_corners
from coopsim.geometry.se3 import Floats
from coopsim.types import Ints
from coopsim.world.places.layout import rectangle
from coopsim.world.towns.buildings import CHURCH, KINDS, LotKind, Part, draw_kind
from coopsim.world.towns.kerbs import CORNER, LOOP, STREET
from coopsim.world.towns.site import Frame, Site, frame_between

_WIDEST_RAD = float(np.radians(150.0))  # of a corner; wider ones are built on as straight streets are
_FAITHFUL = 0.8  # share of lots that are of the street's usual kind
_STEP_M = 3.0  # on along the street where nothing fits
_LEAST_M = 7.0  # of a frontage
_DRIVEWAY_M = 3.2
_MORE_M = (0.0, 1.2, 3.0)  # farther from the street, where the building does not fit
_LESS = (1.0, 0.8, 0.6)  # of its depth

_SHARPEST_RAD = np.radians(25.0)
_CORNER = Frame(np.zeros(2), np.array([1.0, 0.0]), np.array([0.0, 1.0]))
_ROUND_M = 0.5  # the building's outline stays this close to the rounded border
_SHRINK = (1.0, 0.7, 0.45)  # of its sides, until it fits


class Frontage:
    """Border (N, 2) m between a street and private ground, by the distance along it."""

    def __init__(self, border: Floats) -> None:
        steps_m = exact.norm(np.diff(border, axis=0), axis=1)
        self._border, self._along_m = border, np.concatenate([[0.0], np.cumsum(steps_m)])
        self.length_m = float(self._along_m[-1])

    def frame(self, from_m: float, to_m: float) -> Frame:
        """Return the ground between two places along the border."""
        x, y = (np.interp([from_m, to_m], self._along_m, self._border[:, axis]) for axis in (0, 1))
        return frame_between(np.array([x[0], y[0]]), np.array([x[1], y[1]]))


def build_frontages(site: Site) -> None:
    """Build along both sides of all streets, around turning loops, and where a street goes on past a junction."""
    for each, border in zip(site.rounds, site.borders, strict=True):
        for side, index in each.parts(STREET, CORNER, LOOP):
            if side.kind != CORNER or site.plan.junctions[side.number].gap_rad(side.arm) >= _WIDEST_RAD:
                rng = site.stream("frontage", side.kind, side.number, side.arm)
                index = np.append(index, (index[-1] + 1) % len(border))
                _build_along(site, Frontage(border[index]), rng)


def _build_along(site: Site, frontage: Frontage, rng: np.random.Generator) -> None:
    """Build lot after lot along a border."""
    usual, church_m = draw_kind(site.openness, rng), rng.uniform(0.0, 8.0) * frontage.length_m
    along_m = rng.uniform(0.0, 2.0)
    while along_m < frontage.length_m - _LEAST_M:
        name = usual if rng.random() < _FAITHFUL else draw_kind(site.openness, rng)
        kind = KINDS[name]
        if along_m > church_m:
            kind, church_m = CHURCH, np.inf
        width_m, gap_m = rng.uniform(*kind.width_m), rng.uniform(*kind.gap_m)
        width_m = min(width_m, frontage.length_m - along_m)
        gap_m = min(gap_m, frontage.length_m - along_m - width_m)
        driveway = kind.front == "garden" and gap_m > _DRIVEWAY_M and rng.random() < 0.6
        frame = frontage.frame(along_m, along_m + width_m)
        setback_m = _build(site, frame, kind, width_m, rng)
        if setback_m is None:
            along_m += _STEP_M
            continue
        gap = frontage.frame(along_m + width_m, along_m + width_m + gap_m) if driveway else None
        _finish(site, frame, gap, kind, (width_m, setback_m, gap_m), rng)
        along_m += width_m + gap_m


def _build(site: Site, frame: Frame, kind: LotKind, width_m: float, rng: np.random.Generator) -> float | None:
    """Build on a lot if there is space; return the distance from the border, None without."""
    setback_m, depth_m = kind.draw_setback_m(site.openness, rng), rng.uniform(*kind.depth_m)
    height_m, style = kind.draw_height_m(rng), kind.draw_style(rng)
    if not kind.shapes:
        return setback_m
    if width_m < kind.width_m[0] * 0.6:
        return None
    shape = kind.shapes[rng.integers(len(kind.shapes))]
    for more_m, less in zip(_MORE_M, _LESS, strict=True):
        parts = shape(width_m, less * depth_m, rng)
        parts = [part._replace(outline=part.outline + np.array([0.0, setback_m + more_m])) for part in parts]
        if site.build(frame, parts, height_m, 0.04, style):
            return setback_m + more_m
    return None


def _finish(
    site: Site,
    frame: Frame,
    gap: Frame | None,
    kind: LotKind,
    size_m: tuple[float, float, float],
    rng: np.random.Generator,
) -> None:
    """Add a yard or garden before the building, a driveway in the gap to the next one, a wall along the border.

    Args:
        site: town under construction.
        frame: lot before the building.
        gap: ground of the gap; None: there is no driveway.
        kind: kind of the lot.
        size_m: width of the building, distance from the border, width of the gap.
        rng: random numbers of the street.
    """
    width_m, setback_m, gap_m = size_m
    draws, wall_m = rng.random(4), rng.choice([0.6, 0.9, 1.2, 1.8, 2.0])
    if setback_m > 0.4:
        before = frame.place(rectangle((0.0, width_m), (0.02, setback_m - 0.02)))
        site.pave_if_free(before, "yard" if kind.front == "yard" else "grass")
    if kind.front != "garden":
        return
    if gap is not None:
        at = (gap_m - _DRIVEWAY_M) * draws[0]
        drive = gap.place(rectangle((at, at + _DRIVEWAY_M), (0.02, max(setback_m, 1.2) + 5.6)))
        if site.pave_if_free(drive, "yard"):
            site.kerbside.take(gap.place(rectangle((at - 0.5, at + _DRIVEWAY_M + 0.5), (-8.0, 0.0))))
            if draws[1] < 0.6:
                spot = gap.place(np.array([[at + _DRIVEWAY_M / 2, max(setback_m + 2.2, 3.5)]]))[0]
                site.park(spot, gap.heading_rad + np.pi * (draws[2] < 0.5))
            site.taken.take(drive)
    if setback_m > 1.5 and draws[3] < 0.8 - 0.6 * site.openness:
        gate_m = width_m * rng.uniform(0.3, 0.7)
        for low, high in ((0.1, gate_m - 0.6), (gate_m + 0.6, width_m - 0.1)):
            line = frame.place(np.array([[low, 0.2], [high, 0.2]]))
            site.wall(line[0], line[1], float(wall_m))


def build_corners(site: Site) -> None:
    """Put a building, a wall or nothing at each corner, which decides the view into the crossing street."""
    for each, border in zip(site.rounds, site.borders, strict=True):
        for side, index in each.parts(CORNER):
            junction = site.plan.junctions[side.number]
            if not _SHARPEST_RAD < junction.gap_rad(side.arm) < _WIDEST_RAD:
                continue
            rng = site.stream("corner", side.number, side.arm)
            headings = [junction.arms[(side.arm + turn) % len(junction.arms)].heading_rad for turn in (0, 1)]
            out = np.array([[exact.cos(heading), exact.sin(heading)] for heading in headings])
            own = float(np.clip(site.openness + exact.settled(rng.normal(0.0, 0.12)), 0.0, 1.0))
            _build_corner(site, _around(border, index), out, own, rng)


def _around(border: Floats, index: Ints) -> Floats:
    """Return the border around a corner, from the straight part before it to the one after it."""
    index = np.arange(index[0] - 2, index[-1] + 4)
    around = border[index % len(border)]
    return np.asarray(around[keep_corners(around, _ROUND_M)])


def _build_corner(site: Site, border: Floats, out: Floats, openness: float, rng: np.random.Generator) -> None:
    """Build on a corner with a border (N, 2) m between streets of directions (2, 2) away from the junction."""
    draw, setback_m = rng.random(), _setback_m(openness, rng)
    sides_m, depth_m = rng.uniform(14.0, 34.0, 2), rng.uniform(10.0, 14.0)
    height_m, bent = 3.2 * rng.integers(2, 6), rng.random() < 0.6
    walled, wall_m = rng.random() < 0.75 - openness, rng.uniform(1.7, 2.4)
    if walled and setback_m > 2.0:
        _wall_around(site, border, rng.uniform(8.0, 25.0, 2), out, wall_m)
    style = KINDS["closed"].draw_style(rng)
    if draw > 1.25 - openness:
        if openness < 0.7:  # a square
            for outline in _corner_parts(border, out, sides_m, None, 0.05):
                site.pave_if_free(outline, "yard")
        return
    for share in _SHRINK:
        parts = _corner_parts(border, out, share * sides_m, depth_m if bent else None, setback_m)
        if parts and site.build(_CORNER, [Part(outline) for outline in parts], height_m, style=style):
            return


def _setback_m(openness: float, rng: np.random.Generator) -> float:
    """Return the distance from the border to the building: at the pavement in closed towns."""
    reach_m = 0.5 + 24.0 * openness * np.sqrt(openness)
    return float(rng.uniform(0.3 * reach_m, reach_m)) if openness > 0.15 else float(rng.choice([0.02, 0.4, 1.0]))


def _corner_parts(
    border: Floats, out: Floats, sides_m: Floats, depth_m: float | None, setback_m: float
) -> list[Floats]:
    """Return the outlines of a building along both streets, cut where the border rounds the corner; none: no space.

    Args:
        border: (N, 2) m.
        out: (2, 2) directions of the streets.
        sides_m: (2,) lengths along them.
        depth_m: depth of the wings; None: the whole corner is built over.
        setback_m: distance from the border.
    """
    first, second = out
    left = np.array([-first[1], first[0]])  # into the corner from the first street; into it from the second one:
    right = np.array([second[1], -second[0]])
    wedge = _cross(first, second)
    if wedge < 0.1:
        return []
    begin, end = border[0] + setback_m * left, border[-1] + setback_m * right
    corner = begin + first * _cross(end - begin, second) / wedge
    a, b = corner + sides_m[0] * first, corner + sides_m[1] * second
    parts = [np.array([corner, a, corner + sides_m[0] * first + sides_m[1] * second, b])]
    if depth_m is not None:
        inner = corner + depth_m * (first + second) / wedge
        if all(exact.dot(inner - corner, way) <= side_m - 4.0 for way, side_m in zip(out, sides_m, strict=True)):
            ends = a + depth_m * left, b + depth_m * right
            parts = [np.array([corner, a, ends[0], inner]), np.array([corner, inner, ends[1], b])]
    for start, stop in pairwise(border):
        along = stop - start
        length_m = float(exact.norm(along))
        if length_m > 1e-6:
            away = np.array([along[1], -along[0]]) / length_m
            parts = [clip(part, start + min(setback_m, 1.5) * away, away) for part in parts]
    return parts if all(_area_m2(part) > 12.0 for part in parts) else []


def _wall_around(site: Site, border: Floats, lengths_m: Floats, out: Floats, height_m: float) -> None:
    """Add a wall along the border, around the corner and some way along both streets."""
    line = np.vstack([border[:1] + lengths_m[0] * out[0], border, border[-1:] + lengths_m[1] * out[1]])
    away = np.diff(line, axis=0)
    away = np.column_stack([away[:, 1], -away[:, 0]]) / exact.norm(away, axis=1)[:, None]
    moved = line + 0.3 * np.vstack([away[:1], (away[:-1] + away[1:]) / 2, away[-1:]])
    for start, stop in pairwise(moved):
        shortened = 0.15 * (stop - start) / max(float(exact.norm(stop - start)), 1e-9)
        site.wall(start + shortened, stop - shortened, height_m)


def clip(outline: Floats, point: Floats, away: Floats) -> Floats:
    """Return the part of a convex outline (K, 2) m beyond a line through `point` (2,), in direction `away` (2,)."""
    if not len(outline):
        return outline
    beyond_m = exact.dot(outline - point, away)
    kept: list[Floats] = []
    for k in range(len(outline)):
        there = (k + 1) % len(outline)
        if beyond_m[k] >= 0:
            kept.append(outline[k])
        if (beyond_m[k] >= 0) != (beyond_m[there] >= 0):
            share = beyond_m[k] / (beyond_m[k] - beyond_m[there])
            kept.append(outline[k] + share * (outline[there] - outline[k]))
    apart = [point for n, point in enumerate(kept) if exact.norm(point - kept[n - 1]) > 0.1]
    return np.array(apart) if len(apart) > 2 else np.zeros((0, 2))


def _cross(u: Floats, v: Floats) -> float:
    return float(u[0] * v[1] - u[1] * v[0])


def _area_m2(outline: Floats) -> float:
    x, y = outline.T
    return abs(float((x * np.roll(y, -1) - np.roll(x, -1) * y).sum())) / 2
