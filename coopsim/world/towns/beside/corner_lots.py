"""What stands at the corners of junctions, and decides how far one sees into the crossing street."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from coopsim.geometry import exact
from coopsim.geometry.se3 import Floats
from coopsim.support.rng import stream
from coopsim.types import Ints
from coopsim.world.towns.beside.building_shapes import Part
from coopsim.world.towns.beside.lot_kinds import KINDS, draw_style
from coopsim.world.towns.beside.private_ground import PrivateGround
from coopsim.world.towns.beside.site import Frame, Site
from coopsim.world.towns.streets.kerb_sides import CORNER
from coopsim.world.towns.streets.line_kernels import keep_corners

WIDEST_RAD = float(np.radians(150.0))
"""Of a corner; wider ones are built on as straight streets are."""

_SHARPEST_RAD = np.radians(25.0)
_CORNER = Frame(np.zeros(2), np.array([1.0, 0.0]), np.array([0.0, 1.0]))
_ROUND_M = 0.5  # the building's outline stays this close to the rounded border
_SHRINK = (1.0, 0.7, 0.45)  # of its sides, until it fits


def build_corners(site: Site, ground: PrivateGround) -> None:
    """Put a building, a wall or nothing at each corner.

    Args:
        site: the town, changed in place.
        ground: of the town.
    """
    for number, each in enumerate(ground.rounds):
        for k, side in enumerate(each.sides):
            if side.kind != CORNER:
                continue
            junction = ground.plan.junctions[side.number]
            if not _SHARPEST_RAD < junction.gap_rad(side.arm) < WIDEST_RAD:
                continue
            rng = stream(ground.seed, "corner", str(side.number), str(side.arm))
            border = _around(ground.borders[number], np.flatnonzero(each.side == k))
            headings = [junction.arms[(side.arm + turn) % len(junction.arms)].heading_rad for turn in (0, 1)]
            own = float(np.clip(ground.openness + exact.settled(rng.normal(0.0, 0.12)), 0.0, 1.0))
            _build_corner(site, border, np.array([[exact.cos(h), exact.sin(h)] for h in headings]), own, rng)


def _around(border: Floats, index: Ints) -> Floats:
    """Return the border around a corner, from the straight part before it to the one after it."""
    index = np.arange(index[0] - 2, index[-1] + 4)
    around = border[index % len(border)]
    return np.asarray(around[keep_corners(around, _ROUND_M)])


def _build_corner(site: Site, border: Floats, out: Floats, openness: float, rng: np.random.Generator) -> None:
    """Choose and build.

    Args:
        site: the town.
        border: (N, 2) m around the corner.
        out: (2, 2) directions of the two streets, away from the junction.
        openness: of this corner.
        rng: the corner's.
    """
    draw, setback_m = rng.random(), _setback_m(openness, rng)
    sides_m, depth_m = rng.uniform(14.0, 34.0, 2), rng.uniform(10.0, 14.0)
    height_m, bent = 3.2 * rng.integers(2, 6), rng.random() < 0.6
    walled, wall_m = rng.random() < 0.75 - openness, rng.uniform(1.7, 2.4)
    if walled and setback_m > 2.0:
        _wall_around(site, border, rng.uniform(8.0, 25.0, 2), out, wall_m)
    style = draw_style(KINDS["closed"], rng)
    if draw > 1.25 - openness:
        if openness < 0.7:  # a square
            for outline in _corner_parts(border, out, sides_m, None, 0.05):
                if site.room.is_free(outline):
                    site.pave(outline, "yard")
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
    """Return the outlines of a building along both streets, cut where the border rounds the corner; none: no room.

    Args:
        border: (N, 2) m.
        out: (2, 2) directions of the streets.
        sides_m: (2,) lengths along them.
        depth_m: of the wings; None: the whole corner is built over.
        setback_m: from the border.
    """
    first, second = out
    left = np.array([-first[1], first[0]])  # into the corner from the first street; into it from the second one:
    right = np.array([second[1], -second[0]])
    wedge = float(first[0] * second[1] - first[1] * second[0])
    if wedge < 0.1:
        return []
    begin, end = border[0] + setback_m * left, border[-1] + setback_m * right
    corner = begin + first * _cross(end - begin, second) / wedge
    a, b = corner + sides_m[0] * first, corner + sides_m[1] * second
    if depth_m is None:
        parts = [np.array([corner, a, corner + sides_m[0] * first + sides_m[1] * second, b])]
    else:
        inner = corner + depth_m * (first + second) / wedge
        parts = [np.array([corner, a, a + depth_m * left, inner]), np.array([corner, inner, b + depth_m * right, b])]
        if exact.dot(inner - corner, first) > sides_m[0] - 4.0 or exact.dot(inner - corner, second) > sides_m[1] - 4.0:
            parts = [np.array([corner, a, corner + sides_m[0] * first + sides_m[1] * second, b])]
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
    if len(outline) < 3:
        return 0.0
    x, y = outline.T
    return abs(float((x * np.roll(y, -1) - np.roll(x, -1) * y).sum())) / 2
