"""Carriageways: lanes that lie side by side, whichever way they lead, from one junction to the next."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import NamedTuple

import numpy as np
from numba import njit

from coopsim.geometry.se3 import Floats
from coopsim.types import Ints
from coopsim.world.places.road_network import CircularLane, Lane, LaneIndex, Road, RoadNetwork, StraightLane
from coopsim.world.relief.crown import normals_of

_CHORD_M = 3.0  # of bends: at a radius of 10 m it is 11 cm from the arc, and a crown's height 3 mm off
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
    lines = [line_of([lanes[index] for index in chain]) for chain in chains]
    length_m = [sum(lanes[index].length for index in chain) for chain in chains]
    rank = dict.fromkeys(lanes, -1)
    for k, number in enumerate(np.argsort(length_m, kind="stable").tolist()):
        rank |= dict.fromkeys(chains[number], k)
    low, high, longest, first = _measured(chains, lanes, rank)
    found = []
    for k, chain in enumerate(chains):
        own = slice(first[k], first[k + 1])
        edge_m = low[own].max(), high[own].min()
        if edge_m[0] < edge_m[1] and longest[own].min() <= rank[chain[0]]:
            found.append(Carriageway(_shifted(lines[k], sum(edge_m) / 2), float(edge_m[1] - edge_m[0]) / 2))
    return found


def line_of(lanes: list[Lane]) -> Floats:
    """Return a line (K, 2) m along the middles of lanes that follow each other."""
    points = [each[:-1] for each in map(_points, lanes)]
    return np.concatenate([*points, _points(lanes[-1])[-1:]])


def _points(lane: Lane) -> Floats:
    if isinstance(lane, StraightLane):
        return np.array([lane.start, lane.end])
    if not isinstance(lane, CircularLane):
        return np.array([lane.position(along, 0.0) for along in np.linspace(0.0, lane.length, 2)])
    phase = np.linspace(lane.start_phase, lane.end_phase, max(2, int(np.ceil(lane.length / _CHORD_M)) + 1))
    points: Floats = lane.center + lane.radius * np.column_stack([np.cos(phase), np.sin(phase)])
    return points


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


def _measured(
    chains: list[list[LaneIndex]], lanes: Mapping[LaneIndex, Lane], rank: dict[LaneIndex, int]
) -> tuple[Floats, Floats, Ints, list[int]]:
    """Measure carriageways at places (P,) along the lanes of all chains.

    Returns:
        Right and left edge (P,), m to the left of the lane's middle; the highest rank (P,) of the lanes side by side;
        and the first place of each chain and, last, the number of places.
    """
    places, first = [], [0]
    for chain in chains:
        for lane in (lanes[index] for index in chain):
            count = int(np.ceil(lane.length / _SAMPLE_M))
            for along in (np.arange(count) + 0.5) * lane.length / count:
                heading = lane.heading_at(along)
                places.append([*lane.position(along, 0.0), np.cos(heading), np.sin(heading), lane.width / 2])
        first.append(len(places))
    pieces = []
    for index, lane in lanes.items():
        points = _points(lane)
        ends = np.column_stack([points[:-1], points[1:]])
        pieces.append(np.column_stack([ends, np.full((len(ends), 2), [lane.width / 2, rank[index]])]))
    return *_edges(np.array(places), np.concatenate(pieces)), first


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
