"""Surfaces beside the lanes: pavements to the kerb, parking strips, and the middles of junctions."""

from __future__ import annotations

import numpy as np

from coopsim.geometry import exact
from coopsim.geometry.se3 import Floats
from coopsim.world.towns.beside.people_ways import PeopleWays
from coopsim.world.towns.beside.pieces import convex_pieces
from coopsim.world.towns.beside.site import Site
from coopsim.world.towns.streets.kerb_lines import corner_kerb
from coopsim.world.towns.streets.kerb_sides import STREET, Round
from coopsim.world.towns.streets.line_kernels import keep_corners
from coopsim.world.towns.streets.plan import LANE_M, Junction, Plan

BULGE_M = 4.0
"""On both sides of a crosswalk's middle the pavement reaches over the parking strip."""

_STRAIGHT_M = 0.15  # surfaces through fewer points stay this close to the kerb
_UNDER_LANE_M = 0.1  # that pavements reach under the lanes' edge: no slits
_COARSE_M, _BEYOND_M = 0.4, 0.25  # of the surface below a junction's lanes
_STRIP_M = 0.05


def pave_sides(site: Site, rounds: tuple[Round, ...], ways: PeopleWays) -> None:
    """Add parking strips, and pavements between these, or the kerb, and people's ways."""
    for each, way in zip(rounds, ways.lines, strict=True):
        edge, strip = each.kerb - _UNDER_LANE_M * each.right, each.beside(0.0)
        inner = np.where(each.strip_m[:, None] > _STRIP_M, strip, edge)
        lines = np.column_stack([edge, inner, way])
        bulge = _bulges(each, ways)
        kept = keep_corners(np.vstack([lines, lines[:1]]), _STRAIGHT_M)[:-1]
        here = np.flatnonzero(kept | (bulge != np.roll(bulge, 1)))
        there = np.roll(here, -1)
        parked = np.maximum(each.strip_m[here], each.strip_m[there]) > _STRIP_M
        strips = np.stack([edge[here], edge[there], strip[there], strip[here]], axis=1)
        _pave(site, strips[parked & bulge[here]], "pavement")
        _pave(site, strips[parked & ~bulge[here]], "parking")
        _pave(site, np.stack([inner[here], inner[there], way[there], way[here]], axis=1), "pavement")


def pave_junctions(site: Site, plan: Plan) -> None:
    """Add the road surface between the stop lines of each junction, and the islands of roundabouts."""
    for junction in plan.junctions:
        for arm in range(len(junction.arms)):
            stop_m, half_m = junction.stop_m, junction.half_m
            mouth = np.array([junction.place(arm, stop_m, -half_m), junction.place(arm, stop_m, half_m)])
            kerb = corner_kerb(junction, arm)
            kerb = kerb[keep_corners(kerb, _COARSE_M)]
            out = kerb - junction.centre
            kerb = kerb + _BEYOND_M * out / exact.norm(out, axis=1)[:, None]
            _pave(site, _fan(junction.centre, mouth), "road")
            _pave(site, _fan(junction.centre, kerb), "road")
        if junction.kind == "roundabout":
            site.pave(_island(junction), "pavement")


def _island(junction: Junction) -> Floats:
    angle = np.arange(16) * np.pi / 8
    radius_m = junction.ring_m - LANE_M / 2
    return np.asarray(junction.centre + radius_m * np.column_stack([exact.cos(angle), exact.sin(angle)]))


def _bulges(each: Round, ways: PeopleWays) -> np.ndarray[tuple[int], np.dtype[np.bool_]]:
    """Return the mask (N,) of points near a crosswalk between junctions."""
    near = np.zeros(len(each.kerb), np.bool_)
    for k, side in enumerate(each.sides):
        for street, along_m in ways.mid_block:
            if side.kind == STREET and side.number == street:
                near |= (each.side == k) & (np.abs(each.along_m - along_m) < BULGE_M)
    return near


def _fan(middle: Floats, line: Floats) -> Floats:
    """Return triangles (K - 1, 3, 2) m from the middle (2,) to a line of K points."""
    return np.stack([np.broadcast_to(middle, line[1:].shape), line[:-1], line[1:]], axis=1)


def _pave(site: Site, surfaces: Floats, kind: str) -> None:
    """Add surfaces (N, K, 2) m of three or four corners each."""
    corners, count = convex_pieces(np.ascontiguousarray(surfaces))
    for outline, number in zip(corners.tolist(), count.tolist(), strict=True):
        site.add("paved", outline=outline[:number], kind=kind)
