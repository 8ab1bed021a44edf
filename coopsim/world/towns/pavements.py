"""Pavements: people's ways along the rounds of streets, around corners, and crosswalks over streets."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from coopsim.config.annotated import Point
from coopsim.geometry import exact
from coopsim.geometry.outlines import keep_corners
from coopsim.geometry.se3 import Floats
from coopsim.support.rng import stream
from coopsim.types import Ints
from coopsim.world.places.description import MapWays, point_of
from coopsim.world.towns.kerbs import CORNER, STREET, Round
from coopsim.world.towns.plan import Junction, Plan, Street

_INWARDS_M = 4.0  # from the stop line to a junction's crosswalk
_BEFORE_BEND_M = 0.5
_STRAIGHT_M = 0.2  # a way through fewer points stays this close to the line beside the kerb
_POINTS_OUT = 8  # along the street beyond the corner, that a crosswalk may be at
_MERGE = 0.3  # places this close by number of points are one node
_LONG_M = 75.0  # streets with a crosswalk between junctions
_STEADY_M = 15.0  # on both sides of it lanes neither split nor join

End = tuple[int, float]
"""Place on the way along a round: number of the round, and index of a point plus a share of the way to the next one."""


@dataclass(frozen=True, slots=True, eq=False)
class PeopleWays:
    """Ways of people: a closed line (N, 2) m along each round, and crosswalks between these.

    `mid_block` has the street and the place along it, m, of crosswalks between junctions; `at_arm` the numbers of those
    over arms, by junction and arm.
    """

    lines: tuple[Floats, ...]
    crossings: list[tuple[End, End]] = field(default_factory=list)
    mid_block: list[tuple[int, float]] = field(default_factory=list)
    at_arm: dict[tuple[int, int], int] = field(default_factory=dict)

    def place(self, end: End) -> Floats:
        """Return the place (2,) m of an end of a crosswalk."""
        line, (whole, share) = self.lines[end[0]], divmod(end[1], 1.0)
        here, there = line[int(whole) % len(line)], line[(int(whole) + 1) % len(line)]
        return np.asarray(here + share * (there - here))

    def crosses(self, street: int, along_m: float, within_m: float) -> bool:
        """Return whether there is a crosswalk near a place of a street."""
        return any(number == street and abs(at - along_m) < within_m for number, at in self.mid_block)

    def spans(self) -> list[tuple[Floats, Floats]]:
        """Return the two ends (2,) m of each crosswalk."""
        return [(self.place(one), self.place(other)) for one, other in self.crossings]


def cross_at_junctions(ways: PeopleWays, rounds: tuple[Round, ...], plan: Plan) -> None:
    """Add a crosswalk over every arm, inwards of the stop line as far as the corners beside it leave space."""
    corners = _sides_of(rounds, CORNER)
    for junction in plan.junctions:
        for arm in range(len(junction.arms)):
            number, own = corners[junction.number, arm]
            other_number, other = corners[junction.number, (arm - 1) % len(junction.arms)]
            right = np.concatenate([own[0] - np.arange(_POINTS_OUT, 0, -1), own])
            left = np.concatenate([other, other[-1] + np.arange(1, _POINTS_OUT + 2)])[::-1]
            pair = (number, right, len(own)), (other_number, left, len(other))
            out_m = [_out_m(junction, arm, ways.lines[k][index % len(ways.lines[k])]) for k, index, _ in pair]
            least_m = max(out[-1 - count // 2] for out, (_, _, count) in zip(out_m, pair, strict=True))
            at_m = max(junction.stop_m - _INWARDS_M, least_m + _BEFORE_BEND_M)
            right_end, left_end = (
                _place_at(k, index, out, at_m) for out, (k, index, _) in zip(out_m, pair, strict=True)
            )
            if right_end is not None and left_end is not None:
                ways.at_arm[junction.number, arm] = len(ways.crossings)
                ways.crossings.append((right_end, left_end))


def cross_between(ways: PeopleWays, rounds: tuple[Round, ...], plan: Plan, seed: int) -> None:
    """Add a crosswalk over half of the long streets, about their middle."""
    sides = _sides_of(rounds, STREET)
    for street in plan.streets:
        rng = stream(seed, "crosswalk between junctions", str(street.number))
        wanted, share = rng.random() < 0.5, rng.uniform(0.4, 0.6)
        first, last = street.span_m
        along_m = first + share * (last - first)
        if not wanted or last - first < _LONG_M or not _is_steady(street, along_m):
            continue
        ends = []
        for way in (1, -1):
            number, index = sides[street.number, way]
            along = rounds[number].along_m[index][::way]
            ends.append((number, float(np.interp(along_m, along, index[::way]))))
        ways.crossings.append((ends[0], ends[1]))
        ways.mid_block.append((street.number, along_m))


def _sides_of(rounds: tuple[Round, ...], kind: int) -> dict[tuple[int, int], tuple[int, Ints]]:
    """Return the sides of a kind by number and arm: the number of their round, and their points in it."""
    return {
        (side.number, side.arm): (number, index)
        for number, each in enumerate(rounds)
        for side, index in each.parts(kind)
    }


def describe_ways(ways: PeopleWays) -> MapWays:
    """Return the ways of a description."""
    nodes: dict[str, Point] = {}
    names: dict[End, str] = {}
    round_ways = []
    for number, line in enumerate(ways.lines):
        closed = np.vstack([line, line[:1]])
        plain = np.flatnonzero(keep_corners(closed, _STRAIGHT_M))[:-1]
        ends = [place % len(line) for crossing in ways.crossings for k, place in crossing if k == number]
        apart = np.abs(plain[:, None] - np.array([*ends, np.inf])).min(axis=1) > _MERGE
        circle = []
        for place in sorted({*ends, *plain[apart].astype(float).tolist()}):
            name = f"w{len(nodes)}"
            at = ways.place((number, place)) if place % 1.0 else line[int(place)]
            nodes[name], names[number, place] = point_of(at), name
            circle.append(name)
        round_ways.append((*circle, circle[0]))
    across = (tuple(names[k, place % len(ways.lines[k])] for k, place in crossing) for crossing in ways.crossings)
    return MapWays(nodes, tuple(round_ways), tuple(across))


def _is_steady(street: Street, along_m: float) -> bool:
    around = street.half_m([along_m - _STEADY_M, along_m + _STEADY_M])
    return bool(abs(around[0] - around[1]) < 1e-6)


def _out_m(junction: Junction, arm: int, points: Floats) -> Floats:
    """Return the distances (N,) of points (N, 2) m from the junction's centre, outwards along an arm."""
    heading = junction.arms[arm].heading_rad
    return exact.dot(points - junction.centre, np.array([exact.cos(heading), exact.sin(heading)]))


def _place_at(number: int, index: Ints, out_m: Floats, at_m: float) -> End | None:
    """Return the place `at_m` out on a way that leads inwards."""
    beyond = np.flatnonzero((out_m[:-1] >= at_m) & (out_m[1:] < at_m))
    if not len(beyond):
        return None
    k = int(beyond[0])
    share = (out_m[k] - at_m) / (out_m[k] - out_m[k + 1])
    return number, float(index[k] + share * (index[k + 1] - index[k]))
