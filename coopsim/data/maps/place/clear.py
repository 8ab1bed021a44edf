"""Clear ways: nothing may stand on lanes of a place that are not quite those of the map."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from itertools import pairwise
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from coopsim.data.maps.dress.spots import vehicle_at
from coopsim.data.maps.place.lines import spaced
from coopsim.data.maps.place.strips import Strip
from coopsim.geometry import exact
from coopsim.geometry.se3 import Floats
from coopsim.support.arrays import Ints, numbered
from coopsim.world.places.description import MapBay, MapLane, MapWays
from coopsim.world.places.streets import turning_loop

_LEAST_M = {"buildings": 2.3, "walls": 2.3, "trees": 2.3, "rsus": 2.3, "parked": 2.05, "paved": 0.8}
"""Least distances from the middles of lanes, by the field of a description; somewhat more than places accept.

Those of parked vehicles are to their sides.
"""

_STEP_M = 0.6
_SIDE_M = 3.5  # from the middle of a loop's lanes to what stands there


def clear_of_roads(
    fields: Mapping[str, Any], strips: Iterable[Strip], loops: Sequence[MapLane], nodes: Mapping[str, Any]
) -> dict[str, Any]:
    """Return fields of a description without parts that are too near to lanes, or to loops to turn round in.

    People's ways over loops are left out, too.
    """
    tree = cKDTree(np.concatenate([spaced(each.line, _STEP_M)[:, :2] for each in strips]))
    discs = np.array([disc for loop in loops for disc in _ground(loop, nodes)]).reshape(-1, 3)
    found = {name: part for name, part in fields.items() if name != "furniture"}  # drawn in full detail, all of it
    for name, least_m in _LEAST_M.items():
        parts = [each for each in fields.get(name, ()) if name != "paved" or each.kind == "pavement"]
        if not parts:
            continue
        points, owner = _along([_corners(each) for each in parts])
        beside = np.asarray(tree.query(points, distance_upper_bound=least_m)[0]) < least_m
        near = beside | (exact.norm(points[:, None] - discs[None, :, :2]) < discs[:, 2]).any(axis=1)
        barred = {id(parts[k]) for k in np.unique(owner[near]).tolist()}
        found[name] = tuple(each for each in fields[name] if id(each) not in barred)
    if found.get("walks") is not None and len(discs):
        found["walks"] = _beside_loops(found["walks"], discs)
    return found


def _beside_loops(walks: MapWays, discs: Floats) -> MapWays:
    """Return people's ways without those over discs (D, 3), x, y and radius: there nobody gives way to them."""
    runs = list[tuple[str, ...]]()
    for way in walks.ways:
        line = np.array([walks.nodes[name] for name in way])
        step, offset = np.diff(line, axis=0)[:, None], discs[:, :2] - line[:-1, None]
        share = np.clip(exact.dot(offset, step) / np.maximum(exact.dot(step, step), 1e-12), 0.0, 1.0)
        barred = np.asarray((exact.norm(offset - share[..., None] * step) < discs[:, 2]).any(axis=1))
        ends = [-1, *np.flatnonzero(barred).tolist(), len(barred)]
        runs += [way[first + 1 : last + 1] for first, last in pairwise(ends)]
    ways = tuple(run for run in runs if len(run) > 1)
    kept = {name for run in (*ways, *walks.crosswalks) for name in run}
    nodes = {name: at for name, at in walks.nodes.items() if name in kept}
    return MapWays(nodes, ways, walks.crosswalks) if ways else walks


def _ground(loop: MapLane, nodes: Mapping[str, Any]) -> Floats:
    return loop_ground(np.array(nodes[loop.start]), np.array(nodes[loop.end]), _SIDE_M)


def loop_ground(start: Floats, end: Floats, side_m: float) -> Floats:
    """Return the ground (2, 3) that a loop from a point (2,) to another takes: discs, x, y and radius, m.

    `side_m` is from the middle of its lanes to their side. The first disc is that of the bend.
    """
    wide_m = float(exact.norm(end - start))
    ahead = np.array([end[1] - start[1], start[0] - end[0]]) / max(wide_m, 1e-9)
    (reach_m, _), (radius_m, *_) = turning_loop(wide_m / 2)[1]
    far, near = (start + end) / 2 + reach_m * ahead, (start + end) / 2 + reach_m / 2 * ahead
    return np.array([[*far, radius_m + side_m], [*near, max(wide_m / 2, reach_m / 2) + side_m]])


def _along(outlines: Sequence[Floats]) -> tuple[Floats, Ints]:
    """Return points (N, 2) at most `_STEP_M` apart along closed outlines, and the outline's number (N,) of each."""
    counts = np.array([len(each) for each in outlines])
    owner, place = numbered(counts)
    corners = np.concatenate(outlines)
    following = np.arange(len(corners)) + np.where(place + 1 < counts[owner], 1, 1 - counts[owner])
    step = corners[following] - corners
    edge, part = numbered(np.maximum(np.ceil(exact.norm(step) / _STEP_M), 1).astype(np.int64))
    share = part / np.bincount(edge)[edge]
    return corners[edge] + share[:, None] * step[edge], owner[edge]


def _corners(part: Any) -> Floats:
    """Return the corners (N, 2) of a part: its place, its line, its outline or that of its vehicle."""
    if isinstance(part, MapBay):
        return vehicle_at(np.array(part.at), float(np.radians(part.heading_deg)))[:, :2]
    line = getattr(part, "outline", None) or getattr(part, "along", None)
    return np.array(line or [part.at], dtype=np.float64)
