"""Conflicts of roads, found from their geometry."""

from __future__ import annotations

from itertools import combinations

import numpy as np

from coopsim.geometry.se3 import Floats
from coopsim.world.places.road_network import Lane, Road, RoadNetwork, StraightLane

_CHORD_M = 1.0  # of an arc: 2 cm from it at a radius of 6 m


def conflicting_roads(network: RoadNetwork) -> tuple[Road, ...]:
    """Return roads whose middle line crosses another's or ends where another ends, in the network's order.

    Roads that follow each other, or part at one node, do not conflict there. Of each road its first lane counts.
    """
    lines = {index[:2]: middle_line(lane) for index, lane in network.lanes.items() if index[2] == 0}
    found: set[Road] = set()
    for a, b in combinations(lines, 2):
        if a[0] == b[0] or a[1] == b[0] or b[1] == a[0]:
            continue
        if a[1] == b[1] or _cross(lines[a], lines[b]):
            found |= {a, b}
    return tuple(road for road in lines if road in found)


def middle_line(lane: Lane) -> Floats:
    """Return the corners (K, 2) m of a line that follows the lane's middle."""
    count = 2 if isinstance(lane, StraightLane) else max(2, int(np.ceil(lane.length / _CHORD_M)) + 1)
    return np.array([lane.position(along, 0.0) for along in np.linspace(0.0, lane.length, count)])


def _cross(a: Floats, b: Floats) -> bool:
    """Return whether two polylines meet."""
    if (a.max(axis=0) < b.min(axis=0)).any() or (b.max(axis=0) < a.min(axis=0)).any():
        return False
    p, r = a[:-1, None], np.diff(a, axis=0)[:, None]
    q, s = b[None, :-1], np.diff(b, axis=0)[None]
    area = _cross_product(r, s)
    apart = np.where(area == 0.0, np.inf, area)  # parallel ones do not cross
    along_a, along_b = _cross_product(q - p, s) / apart, _cross_product(q - p, r) / apart
    meets = (area != 0.0) & (along_a >= 0) & (along_a <= 1) & (along_b >= 0) & (along_b <= 1)
    return bool(meets.any())


def _cross_product(u: Floats, v: Floats) -> Floats:
    product: Floats = u[..., 0] * v[..., 1] - u[..., 1] * v[..., 0]
    return product
