"""Carriageways: lanes that lie side by side, whichever way they lead, from one junction to the next."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numba import njit

from coopsim.geometry.se3 import Floats
from coopsim.types import Ints
from coopsim.world.places.road_network import CircularLane, Lane, LaneIndex, Road, RoadNetwork, StraightLane
from coopsim.world.relief.crown import normals_of

_SAGITTA_M = 0.1  # between a bend and its chords, from which a crown is 2.5 mm off
_SAMPLE_M = 12.0  # between the places where a carriageway's width is measured
_KINK_RAD = np.radians(20.0)  # at which lanes still lead on; places from files have no sharper ones
_TOUCH_M = 0.3  # largest gap between the edges of two lanes side by side
_ABREAST = 0.9  # cosine of the angle up to which lanes lie side by side
_MOST_LANES = 32


class Carriageway(NamedTuple):
    """A strip of road.

    Attributes:
        line: (K, 2) m, along its middle.
        half_m: from the middle to each edge.
    """

    line: Floats
    half_m: float


def carriageways(network: RoadNetwork, flat: Collection[Road]) -> list[Carriageway]:
    """Return the carriageways of a place.

    Lanes are followed from node to node. Of those side by side the longest decides how far the carriageway goes; where
    lanes join or leave it on the way, it is as wide as at its narrowest.

    Args:
        network: all lanes.
        flat: roads that belong to none, as movements over a junction.
    """
    lanes = network.lanes
    chains = _chains({index: lane for index, lane in lanes.items() if index[:2] not in flat})
    if not chains:
        return []
    points = dict(zip(lanes, lane_points(list(lanes.values())), strict=True))
    length_m = [sum(lanes[index].length for index in chain) for chain in chains]
    rank = dict.fromkeys(lanes, -1)
    for k, number in enumerate(np.argsort(length_m, kind="stable").tolist()):
        rank |= dict.fromkeys(chains[number], k)
    pieces = np.concatenate([_pieces(points[index], lane.width / 2, rank[index]) for index, lane in lanes.items()])
    found = []
    for chain in chains:
        own = pieces[pieces[:, 5] == rank[chain[0]]]
        low, high, longest = _edges(_places(own), pieces)
        edge_m = low.max(), high.min()
        if edge_m[0] < edge_m[1] and longest.min() <= rank[chain[0]]:
            line = np.concatenate([*(points[index][:-1] for index in chain), points[chain[-1]][-1:]])
            found.append(Carriageway(_shifted(line, sum(edge_m) / 2), float(edge_m[1] - edge_m[0]) / 2))
    return found


def lane_points(lanes: Sequence[Lane]) -> list[Floats]:
    """Return points (K, 2) m on the middles of lanes, from the start of each to its end."""
    # A place on a lane is one on the line between two points, plus one on an arc; one of the two is nothing.
    rows = np.array([_shape(lane) for lane in lanes])
    counts = (
        np.maximum(np.ceil(np.array([lane.length for lane in lanes]) / _chord_m(rows[:, 4])), 1).astype(np.int64) + 1
    )
    first = np.cumsum(counts) - counts
    row = np.repeat(rows, counts, axis=0)
    share = (np.arange(len(row)) - np.repeat(first, counts)) / np.repeat(counts - 1, counts)
    phase = row[:, 5] + share * (row[:, 6] - row[:, 5])
    points = row[:, :2] + share[:, None] * (row[:, 2:4] - row[:, :2])
    points += row[:, 4, None] * np.stack([np.cos(phase), np.sin(phase)], axis=1)
    return np.split(points, first[1:])


def _shape(lane: Lane) -> list[float]:
    """Return two points, x and y, and radius, first and last angle of an arc around them."""
    if isinstance(lane, CircularLane):
        return [*lane.center, *lane.center, lane.radius, lane.start_phase, lane.end_phase]
    return [*lane.position(0.0, 0.0), *lane.position(lane.length, 0.0), 0.0, 0.0, 0.0]


def _chord_m(radius_m: Floats) -> Floats:
    """Return the length (L,) of chords that are `_SAGITTA_M` from arcs (L,); a straight lane is one."""
    return np.where(radius_m > 0, np.sqrt(8 * radius_m * _SAGITTA_M), np.inf)


def _pieces(points: Floats, half_m: float, rank: int) -> Floats:
    """Return start, end, half the width and rank of the straight pieces of a lane, (K - 1, 6)."""
    pieces = np.empty((len(points) - 1, 6))
    pieces[:, :2], pieces[:, 2:4], pieces[:, 4], pieces[:, 5] = points[:-1], points[1:], half_m, rank
    return pieces


def _places(pieces: Floats) -> Floats:
    """Return x, y, direction and half the width (P, 5) at places along pieces (S, 6)."""
    along = pieces[:, 2:4] - pieces[:, :2]
    length_m = np.hypot(along[:, 0], along[:, 1])
    counts = np.maximum(np.ceil(length_m / _SAMPLE_M), 1).astype(np.int64)
    own = np.repeat(np.arange(len(pieces)), counts)
    share = (np.arange(len(own)) - np.repeat(np.cumsum(counts) - counts, counts) + 0.5) / counts[own]
    places = np.empty((len(own), 5))
    places[:, :2] = pieces[own, :2] + share[:, None] * along[own]
    places[:, 2:4], places[:, 4] = (along / length_m[:, None])[own], pieces[own, 4]
    return places


def _chains(lanes: Mapping[LaneIndex, Lane]) -> list[list[LaneIndex]]:
    """Return lanes that follow each other; at a fork the straight one does, if there is only one."""
    onward: dict[tuple[str, int], list[LaneIndex]] = {}
    for index in lanes:
        onward.setdefault((index[0], index[2]), []).append(index)
    after: dict[LaneIndex, LaneIndex] = {}
    for index, lane in lanes.items():
        ways = onward.get((index[1], index[2]), [])
        ways = ways if len(ways) == 1 else [way for way in ways if isinstance(lanes[way], StraightLane)]
        if len(ways) == 1 and abs(_turn(lane, lanes[ways[0]])) < _KINK_RAD and ways[0] not in after.values():
            after[index] = ways[0]
    chains = []
    for first in [index for index in lanes if index not in set(after.values())]:
        chain = [first]
        while chain[-1] in after:
            chain.append(after[chain[-1]])
        chains.append(chain)
    return chains


def _turn(lane: Lane, following: Lane) -> float:
    turn = following.heading_at(0.0) - lane.heading_at(lane.length)
    return float((turn + np.pi) % (2 * np.pi) - np.pi)


@njit(cache=True, nogil=True)
def _edges(places: Floats, pieces: Floats) -> tuple[Floats, Floats, Ints]:
    """Return right and left edge (P,) m and the highest rank (P,) at places on lanes.

    Args:
        places: (P, 5) x, y, direction, and half the lane's width.
        pieces: (S, 6) start, end, half the width and rank of straight pieces of all lanes.
    """
    low, high, longest = -places[:, 4], places[:, 4].copy(), np.full(len(places), -1)
    spans = np.empty((_MOST_LANES, 3))
    for n in range(len(places)):
        x, y, ux, uy = places[n, 0], places[n, 1], places[n, 2], places[n, 3]
        met = 0
        for s in range(len(pieces)):
            ahead_a = (pieces[s, 0] - x) * ux + (pieces[s, 1] - y) * uy
            ahead_b = (pieces[s, 2] - x) * ux + (pieces[s, 3] - y) * uy
            if ahead_a * ahead_b > 0 or ahead_a == ahead_b or met == _MOST_LANES:
                continue
            left_a = (pieces[s, 1] - y) * ux - (pieces[s, 0] - x) * uy
            left_b = (pieces[s, 3] - y) * ux - (pieces[s, 2] - x) * uy
            abreast = abs(ahead_b - ahead_a) / np.hypot(ahead_b - ahead_a, left_b - left_a)
            if abreast > _ABREAST:
                aside = left_a + ahead_a / (ahead_a - ahead_b) * (left_b - left_a)
                half = pieces[s, 4] / abreast
                spans[met] = aside - half, aside + half, pieces[s, 5]
                met += 1
        for _ in range(met):
            for k in range(met):
                if spans[k, 0] < high[n] + _TOUCH_M and spans[k, 1] > low[n] - _TOUCH_M:
                    low[n], high[n] = min(low[n], spans[k, 0]), max(high[n], spans[k, 1])
                    longest[n] = max(longest[n], int(spans[k, 2]))
    return low, high, longest


def _shifted(line: Floats, left_m: float) -> Floats:
    """Return a line (K, 2) moved to its left, corners mitred."""
    return line + left_m * normals_of(line)
