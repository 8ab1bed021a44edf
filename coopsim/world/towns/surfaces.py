"""Surfaces beside the lanes: pavements to the kerb, parking strips, and the middles of junctions."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from coopsim.geometry.se3 import Floats
from coopsim.world.towns.kerb_lines import corner_kerb
from coopsim.world.towns.kerb_sides import STREET, Round
from coopsim.world.towns.line_kernels import keep_corners
from coopsim.world.towns.people_ways import PeopleWays
from coopsim.world.towns.plan import LANE_M, Junction, Plan
from coopsim.world.towns.site import Site

BULGE_M = 4.0
"""On both sides of a crosswalk's middle the pavement reaches over the parking strip."""

_STRAIGHT_M = 0.1  # surfaces through fewer points stay this close to the kerb
_UNDER_LANE_M = 0.06  # that pavements reach under the lanes' edge: no slits
_COARSE_M, _BEYOND_M = 0.4, 0.25  # of the surface below a junction's lanes
_LEAST_M, _LEAST_M2 = 0.03, 0.01  # of an edge and of a surface
_STRIP_M = 0.05


def pave_sides(site: Site, rounds: tuple[Round, ...], ways: PeopleWays) -> None:
    """Add parking strips, and pavements between these, or the kerb, and people's ways."""
    for each, way in zip(rounds, ways.lines, strict=True):
        edge, strip = each.kerb - _UNDER_LANE_M * each.right, each.beside(0.0)
        inner = np.where(each.strip_m[:, None] > _STRIP_M, strip, edge)
        lines = np.column_stack([edge, inner, way])
        bulge = _bulges(each, ways)
        kept = keep_corners(np.vstack([lines, lines[:1]]), _STRAIGHT_M)[:-1]
        index = np.flatnonzero(kept | (bulge != np.roll(bulge, 1)))
        for here, there in zip(index, np.roll(index, -1), strict=True):
            if max(each.strip_m[here], each.strip_m[there]) > _STRIP_M:
                kind = "pavement" if bulge[here] else "parking"
                _pave(site, [edge[here], edge[there], strip[there], strip[here]], kind)
            _pave(site, [inner[here], inner[there], way[there], way[here]], "pavement")


def pave_junctions(site: Site, plan: Plan) -> None:
    """Add the road surface between the stop lines of each junction, and the islands of roundabouts."""
    for junction in plan.junctions:
        for arm in range(len(junction.arms)):
            stop_m, half_m = junction.stop_m, junction.half_m
            mouth = [junction.place(arm, stop_m, -half_m), junction.place(arm, stop_m, half_m)]
            _pave(site, [junction.centre, *mouth], "road")
            kerb = corner_kerb(junction, arm)
            kerb = kerb[keep_corners(kerb, _COARSE_M)]
            out = kerb - junction.centre
            kerb = kerb + _BEYOND_M * out / np.linalg.norm(out, axis=1)[:, None]
            for here, there in pairwise(kerb):
                _pave(site, [junction.centre, here, there], "road")
        if junction.kind == "roundabout":
            site.pave(_island(junction), "pavement")


def _island(junction: Junction) -> Floats:
    angle = np.arange(16) * np.pi / 8
    radius_m = junction.ring_m - LANE_M / 2
    return np.asarray(junction.centre + radius_m * np.column_stack([np.cos(angle), np.sin(angle)]))


def _bulges(each: Round, ways: PeopleWays) -> np.ndarray[tuple[int], np.dtype[np.bool_]]:
    """Return the mask (N,) of points near a crosswalk between junctions."""
    near = np.zeros(len(each.kerb), np.bool_)
    for k, side in enumerate(each.sides):
        for street, along_m in ways.mid_block:
            if side.kind == STREET and side.number == street:
                near |= (each.side == k) & (np.abs(each.along_m - along_m) < BULGE_M)
    return near


def _pave(site: Site, corners: list[Floats], kind: str) -> None:
    """Add a surface of three or four corners (2,) m if it is convex, else its triangles."""
    apart = [corner for k, corner in enumerate(corners) if np.abs(corner - corners[k - 1]).max() > _LEAST_M]
    if len(apart) < 3:
        return
    outline = np.array(apart)
    turns = np.round(turning(outline), 4)
    if len(apart) == 4 and not ((turns > _LEAST_M2).all() or (turns < -_LEAST_M2).all()):
        for triangle in (outline[:3], outline[[0, 2, 3]]):
            _pave(site, list(triangle), kind)
    elif (np.abs(turns) > _LEAST_M2).all():
        site.pave(outline, kind)


def turning(outline: Floats) -> Floats:
    """Return twice the areas (K,) of the triangles of each corner of an outline (K, 2) and its neighbours, m2."""
    edges = np.roll(outline, -1, axis=0) - outline
    following = np.roll(edges, -1, axis=0)
    return np.asarray(edges[:, 0] * following[:, 1] - edges[:, 1] * following[:, 0])
