"""Places of a map: where vehicles meet, in an order that spreads them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from coopsim.data.maps.check import driven_lanes
from coopsim.data.maps.place.lines import spaced
from coopsim.data.maps.street_map import StreetMap, StreetWay
from coopsim.geometry import exact
from coopsim.geometry.se3 import Floats

_FEWEST_WAYS, _FEWEST_ROADS = 4, 2
_LONG_M = 60.0  # lanes of a map without such junctions
_STEP_M, _NEAR_M, _ABOVE_M = 4.0, 5.0, 3.0
TWO_LEVELS = "places where roads cross on two levels"


@dataclass(frozen=True, slots=True, eq=False)
class Places:
    """Places of a map.

    Attributes:
        centres: middles (N, 2) m, the first in the middle of all, each next one the farthest from those before it.
        left_out: numbers of places that were left out, by the reason.
    """

    centres: Floats
    left_out: Mapping[str, int]


def places_of(streets: StreetMap, radius_m: float) -> Places:
    """Find the places of a map: junctions with several ways in and out; without any, the middles of long lanes.

    Places with roads on two levels within `radius_m` are left out.
    """
    ways: dict[str, list[StreetWay]] = {}
    for way in streets.ways.values():
        ways.setdefault(way.junction, []).append(way)
    centres = [_middle(each) for each in ways.values() if _is_met(streets, each)]
    if not centres:
        long = [lane for lane in driven_lanes(streets) if lane.length_m >= _LONG_M]
        centres = [lane.line[len(lane.line) // 2, :2] for lane in long]
    found = np.array(centres).reshape(-1, 2)
    bridges = _bridges(streets)
    flat = np.ones(len(found), np.bool_)
    if len(bridges) and len(found):
        flat = cKDTree(bridges).query(found)[0] > radius_m
    count = int((~flat).sum())
    return Places(_spread(found[flat]), {TWO_LEVELS: count} if count else {})


def _is_met(streets: StreetMap, ways: list[StreetWay]) -> bool:
    """Return whether vehicles from several roads meet in a junction, and may leave it by several."""
    roads = [{streets.lanes[getattr(way, end)].road for way in ways} for end in ("start", "end")]
    return len(ways) >= _FEWEST_WAYS and min(map(len, roads)) >= _FEWEST_ROADS


def _middle(ways: list[StreetWay]) -> Floats:
    ends = np.concatenate([way.line[[0, -1], :2] for way in ways])
    middle: Floats = (ends.min(axis=0) + ends.max(axis=0)) / 2
    return middle


def _bridges(streets: StreetMap) -> Floats:
    """Return points (N, 2) m of driven lanes and ways with others above or below them."""
    lines = [each.line for each in (*driven_lanes(streets), *streets.ways.values())]
    if not lines or max(line[:, 2].max() for line in lines) - min(line[:, 2].min() for line in lines) < _ABOVE_M:
        return np.zeros((0, 2))
    points = np.concatenate([spaced(line, _STEP_M) for line in lines])
    pairs = cKDTree(points[:, :2]).query_pairs(_NEAR_M, output_type="ndarray")
    apart = np.abs(points[pairs[:, 0], 2] - points[pairs[:, 1], 2]) > _ABOVE_M
    return points[np.unique(pairs[apart]), :2]


def _spread(points: Floats) -> Floats:
    """Return points (N, 2) in another order: that nearest to the middle of all, then each time the farthest one."""
    if not len(points):
        return points
    order = [int(np.argmin(exact.norm(points - points.mean(axis=0))))]
    apart = exact.norm(points - points[order[0]])
    while len(order) < len(points):
        order.append(int(np.argmax(apart)))
        apart = np.minimum(apart, exact.norm(points - points[order[-1]]))
        apart[order] = -1.0
    return points[order]
