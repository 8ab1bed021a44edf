"""People's ways: a graph of straight ways, some of which cross roads."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from coopsim.config.checked_entry import Entry
from coopsim.errors import UnknownNameError
from coopsim.geometry import exact
from coopsim.geometry.se3 import Floats
from coopsim.support.kernels import njit
from coopsim.types import Mask
from coopsim.world.places.description import MapWays
from coopsim.world.places.layout import Footways
from coopsim.world.places.road_network import RoadNetwork
from coopsim.world.traffic.lane_geometry import distance_to_box, local_coordinates
from coopsim.world.traffic.lanes import LaneArrays, NumberedNetwork

_PAVEMENT_M = 3.0
_CROSSWALK_HALF_M = 1.5
_STRIPE_M, _GAP_M = 0.5, 0.5
_BEYOND_M = 5.0  # the ends of a lane, where a place still is on it
_SLANT = np.sqrt(0.5)
_HALF = _PAVEMENT_M / 2 * np.array([[1.0, 0.0], [_SLANT, _SLANT], [0.0, 1.0], [-_SLANT, _SLANT]])
_CORNER = np.concatenate([_HALF, -_HALF])  # an octagon

_Link = tuple[str, str]


@dataclass(frozen=True, slots=True, eq=False)
class Ways:
    """People's ways of a description.

    Attributes:
        footways: the graph.
        pavements: outlines (K, 2) m.
        crosswalks: outlines (4, 2) m.
        stripes: (4, 2) m.
    """

    footways: Footways
    pavements: list[Floats]
    crosswalks: list[Floats]
    stripes: list[Floats]


def build_ways(walks: MapWays, entry: Entry, network: RoadNetwork, *, one_way: bool = False) -> Ways:
    """Build ways; `entry` is theirs, for errors.

    Stripes are painted where a crosswalk is on a road. With `one_way` people go along each way in one direction only.
    """
    nodes = {name: np.array(place, dtype=np.float64) for name, place in walks.nodes.items()}
    plain = _links(walks.ways, entry.part("ways"), nodes)
    across = _links(walks.crosswalks, entry.part("crosswalks"), nodes)
    if not plain:
        raise entry.part("ways").error("ways must be at least one: people start there, and not on crosswalks")
    footways = _graph(nodes, plain, across, one_way=one_way)
    lanes = NumberedNetwork(network).arrays
    for name, row in zip(nodes, footways.neighbours, strict=True):
        if not (row >= 0).any():
            raise entry.part("nodes", name).error(f"no way leads on from {name!r}")
    corners = [place + _CORNER for place in nodes.values()]
    return Ways(
        footways,
        [_strip(nodes[a], nodes[b], _PAVEMENT_M / 2) for a, b in plain] + corners,
        [_strip(nodes[a], nodes[b], _CROSSWALK_HALF_M) for a, b in across],
        [stripe for a, b in across for stripe in _stripes(nodes[a], nodes[b], lanes)],
    )


def _links(ways: Sequence[Sequence[str]], entry: Entry, nodes: Mapping[str, Floats]) -> list[_Link]:
    """Return pairs of consecutive nodes."""
    links: list[_Link] = []
    for k, names in enumerate(ways):
        for place, name in enumerate(names):
            if name not in nodes:
                raise entry.part(k, place).error(str(UnknownNameError("node", name, nodes)))
        if len(names) < 2 or any(a == b for a, b in pairwise(names)):
            message = f"{entry.name} must lead from node to node, each once, got [{', '.join(names)}]"
            raise entry.part(k).error(message)
        links += pairwise(names)
    return links


def _graph(nodes: Mapping[str, Floats], plain: list[_Link], across: list[_Link], *, one_way: bool) -> Footways:
    number = {name: k for k, name in enumerate(nodes)}
    onward: list[list[int]] = [[] for _ in nodes]
    crossing = np.zeros((len(nodes), len(nodes)), dtype=np.bool_)
    crosswalks = set(across)
    for link in [*plain, *across]:
        a, b = (number[name] for name in link)
        for start, end in ((a, b),) if one_way else ((a, b), (b, a)):
            if end not in onward[start]:
                onward[start].append(end)
            crossing[start, end] |= link in crosswalks
    neighbours = np.full((len(nodes), max(map(len, onward))), -1, dtype=np.int64)
    for row, ends in zip(neighbours, onward, strict=True):
        row[: len(ends)] = ends
    return Footways(np.array(list(nodes.values())), neighbours, crossing)


def _strip(a: Floats, b: Floats, half_m: float) -> Floats:
    """Return a rectangle (4, 2) m along a line, counter-clockwise."""
    along = (b - a) / max(float(exact.norm(b - a)), 1e-9)
    aside = half_m * np.array([-along[1], along[0]])
    return np.array([a - aside, b - aside, b + aside, a + aside])


def _stripes(a: Floats, b: Floats, roads: LaneArrays) -> list[Floats]:
    """Return stripes along the crosswalk where it is on a lane."""
    length_m = float(exact.norm(b - a))
    starts = np.arange(0.0, length_m - _STRIPE_M, _STRIPE_M + _GAP_M)
    along = (b - a) / max(length_m, 1e-9)
    on_road = _are_on_lanes(a + (starts + _STRIPE_M / 2)[:, None] * along, roads)
    return [_strip(a + start * along, a + (start + _STRIPE_M) * along, _CROSSWALK_HALF_M) for start in starts[on_road]]


@njit(cache=True, nogil=True)
def _are_on_lanes(points: Floats, roads: LaneArrays) -> Mask:
    """Return which points (N, 2) m are between the edges of a lane, or up to 5 m beyond its ends."""
    found = np.zeros(len(points), np.bool_)
    for n in range(len(points)):
        for k in range(len(roads.lanes)):
            lane = roads.lanes[k]
            if distance_to_box(lane, points[n, 0], points[n, 1]) > lane.width / 2 + _BEYOND_M:
                continue
            along_m, aside_m = local_coordinates(lane, roads.corners, points[n, 0], points[n, 1])
            if abs(aside_m) <= lane.width / 2 and -_BEYOND_M <= along_m < lane.length + _BEYOND_M:
                found[n] = True
                break
    return found
