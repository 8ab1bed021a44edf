"""Sites of interactions: where ways over a junction meet the ego's, and lanes on which one can follow."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import chain, product

import numpy as np

from coopsim.geometry import exact
from coopsim.geometry.se3 import Floats, wrap_angle
from coopsim.world.places.layout import Layout
from coopsim.world.places.road_network import Road, StraightLane
from coopsim.world.situations.sites import Reach, Way, find_way

_STRAIGHT_RAD = math.radians(25.0)  # a movement that turns less goes straight on
_SIDE_RAD = (math.radians(50.0), math.radians(130.0))  # from the ego's heading to that of one from a side
_STEP_M, _MEET_M = 0.5, 1.5  # ways meet where points that are `_STEP_M` apart come closer than `_MEET_M`
_TRIES = 40  # pairs of ways that are looked at for an episode
_EXIT_M = 3.0  # from a movement's end to where a walk crosses


@dataclass(frozen=True, slots=True)
class Met:
    """Relation of another way over a junction to the ego's.

    Attributes:
        comes: side from which it comes, seen by the ego: "left", "right", "ahead" or "any".
        goes: its turn, "left", "straight" or "right".
    """

    comes: str
    goes: str


@dataclass(frozen=True, slots=True, eq=False)
class Site:
    """A site.

    Attributes:
        way: the ego's way; places count from the place of the conflict.
        ways: ways of others; places count from where each meets the ego's.
        along_m: places on the ego's way where they do.
        beside: way in the lane to the ego's right, with the same place; None: nobody asked for it.
        movement: movement of the ego over the junction, one or none.
        others: movements of the others.
    """

    way: Way
    ways: tuple[Way, ...] = ()
    along_m: tuple[float, ...] = ()
    beside: Way | None = None
    movement: tuple[Road, ...] = ()
    others: tuple[Road, ...] = ()


def turn_of(layout: Layout, road: Road) -> str:
    """Return the turn of a movement: "left", "straight" or "right"."""
    lane = layout.network.get_lane((*road, 0))
    turned = float(wrap_angle(lane.heading_at(lane.length) - lane.heading_at(0.0)))
    return "straight" if abs(turned) < _STRAIGHT_RAD else "left" if turned > 0 else "right"


def junction_sites(
    layout: Layout, rng: np.random.Generator, turn: str, reach: Reach, others: Sequence[tuple[Met, Reach]]
) -> Iterator[Site]:
    """Yield sites where the ego turns over a junction and meets others, in drawn order.

    Args:
        layout: the place.
        rng: draws the order.
        turn: the ego's turn.
        reach: needs of the ego's way.
        others: relations and needs of the other ways; the first is that of the conflict. None: the place is just after
            the junction.
    """
    movements = list(layout.movements)
    own = [road for road in movements if turn_of(layout, road) == turn]
    order = [own[k] for k in rng.permutation(len(own)).tolist()]
    goes = {road: turn_of(layout, road) for road in movements} if others else {}
    tried = 0
    for road in order:
        choices = [[other for other in movements if _is_met(layout, road, other, met, goes)] for met, _ in others]
        # Each pair is looked at once, however many combinations it is part of.
        where = {other: _meeting(layout, road, other) for other in dict.fromkeys(chain(*choices))}
        meet_m = {other: at for other, at in where.items() if at is not None}
        for chosen in product(*([other for other in each if other in meet_m] for each in choices)):
            met_m = [meet_m[other] for other in chosen]
            tried += 1
            if tried > _TRIES:
                return
            first_m = met_m[0][0] if met_m else layout.network.get_lane((*road, 0)).length + _EXIT_M
            way = find_way(layout.network, (*road, 0), first_m, reach, turns=True)
            ways = [
                find_way(layout.network, (*other, 0), at[1], each, turns=True)
                for other, at, (_, each) in zip(chosen, met_m, others, strict=True)
            ]
            known = tuple(each for each in ways if each is not None)
            if way is not None and len(known) == len(ways):
                yield Site(
                    way, known, tuple(at[0] - first_m for at in met_m), None, (road,), tuple(dict.fromkeys(chosen))
                )
                break


def lane_sites(layout: Layout, rng: np.random.Generator, reach: Reach, *, beside: bool = False) -> Iterator[Site]:
    """Yield sites on straight lanes outside junctions, in drawn order; `beside`: with another lane to their right."""
    lanes = list(layout.network.lanes.items())
    for k in rng.permutation(len(lanes)).tolist():
        index, lane = lanes[k]
        share = float(rng.random())
        if not isinstance(lane, StraightLane) or index[:2] in layout.movements:
            continue
        right = (*index[:2], index[2] + 1)
        if beside and right not in layout.network.lanes:
            continue
        ways = [
            find_way(layout.network, each, share * lane.length, reach) for each in (index, *([right] if beside else []))
        ]
        if all(way is not None for way in ways):
            assert ways[0] is not None
            yield Site(ways[0], beside=ways[1] if beside else None)


def _is_met(layout: Layout, road: Road, other: Road, met: Met, goes: dict[Road, str]) -> bool:
    if other[0] == road[0] or goes[other] != met.goes:
        return False
    own, its = (layout.network.get_lane((*each, 0)).heading_at(0.0) for each in (road, other))
    turned = float(wrap_angle(its - own))
    low, high = _SIDE_RAD
    side = "right" if low < turned < high else "left" if low < -turned < high else "ahead" if abs(turned) > high else ""
    return met.comes in ("any", side)


def _meeting(layout: Layout, road: Road, other: Road) -> tuple[float, float] | None:
    """Return how far along two movements they first come close, m; None: they do not."""
    lines = [_line(layout, each) for each in (road, other)]
    apart = exact.norm(lines[0][:, None] - lines[1], axis=2)
    close = np.flatnonzero(apart.min(axis=1) < _MEET_M)
    if not len(close):
        return None
    # Between where they come close and where they part again, the nearest two points.
    first = int(close[0])
    last = min(first + int(2 * _MEET_M / _STEP_M) + 1, len(apart))
    k, n = np.unravel_index(int(apart[first:last].argmin()), apart[first:last].shape)
    return float((first + k) * _STEP_M), float(n * _STEP_M)


def _line(layout: Layout, road: Road) -> Floats:
    """Return points (N, 2) m along a movement, `_STEP_M` apart."""
    lane = layout.network.get_lane((*road, 0))
    return lane.positions(np.arange(0.0, lane.length, _STEP_M), 0.0)
