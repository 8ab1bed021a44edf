"""Plan of a town from its sketch: kinds of junctions, numbers of lanes, stop lines, cross-sections, bends."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from itertools import combinations, pairwise

import numpy as np

from coopsim.errors import InvalidValueError
from coopsim.geometry import exact
from coopsim.geometry.se3 import Floats
from coopsim.support.rng import stream
from coopsim.world.drawn_options import TownOptions
from coopsim.world.towns.plan import (
    INNER_M,
    LANE_M,
    LOOP_RADIUS_M,
    LOOP_REACH_M,
    ROUNDABOUT_MEDIAN_M,
    Arm,
    Junction,
    Plan,
    Station,
    Street,
    StreetEnd,
    rounded,
)
from coopsim.world.towns.sketch import LEAST_ANGLE_RAD, Link, Measures, draw_sketch

MERGE_M = 28.0
"""Length over which a lane splits off or joins; its kinks have 8 degrees."""

_COUNTS = (0.08, 0.2, 0.24, 0.2, 0.13, 0.07, 0.04, 0.02, 0.02)  # shares of towns with 1, 2 ... junctions
_LANES = (0.5, 0.38, 0.12)  # shares of towns with at most 1, 2, 3 lanes
_COUNT_BY_LANES = {1: 9, 2: 5, 3: 3}  # most junctions, where their number is not given
_SPACING_M = {1: (78.0, 108.0), 2: (92.0, 122.0), 3: (100.0, 130.0)}  # by most lanes
_OUTER_M = (50.0, 64.0, 96.0)  # least length of streets that lead out: of six junctions or more, of fewer, of one
_ROUNDABOUTS, _PRIORITIES = 0.28, 0.5  # shares of junctions that could be
_STRAIGHT_ON_RAD = math.radians(25.0)
_TURN_M = (11.0, 14.0)  # least radius of right turns
_LEAST_STOP_M = 14.0
_LEAST_RAD = {1: LEAST_ANGLE_RAD, 2: math.radians(72.0), 3: math.radians(76.0)}  # between arms, by lanes
_RINGS = ((20.0, 22.0), (18.0, 18.0), (22.0, 18.0), (25.0, 17.0))  # of roundabouts: radius, and that of the bends
_RING_PIECE_M = 6.0  # least distance from a way in to the next way out
_BRAKING_M = 28.0  # before a stop line
_STORAGE_M, _BETWEEN_M, _MARGIN_M = 24.0, 20.0, 6.0  # before the first change of lanes, between two, behind the last
_MEDIAN_END_M = 20.0  # length over which a roundabout's median ends
_SPEEDS_M_S = (8.3, 9.7, 11.1)
_MAIN_SPEED_M_S = 12.5  # with two lanes or more
_ATTEMPTS, _CALM = 300, 24  # tries, and from which one on streets are as regular as can be
_REPAIRS = 24
_PARKING = 0.45  # share of street sides


@dataclass(slots=True)
class _JunctionDraw:
    """Properties drawn for a junction, applied as far as there is space; `turn_m` is the least radius of turns."""

    lanes: int
    round_about: bool
    priority: bool
    turn_m: float

    @staticmethod
    def draw(rng: np.random.Generator, most: int) -> _JunctionDraw:
        lanes, (first, second) = int(rng.integers(1, most + 1)), rng.random(2)
        return _JunctionDraw(lanes, first < _ROUNDABOUTS, second < _PRIORITIES, rng.uniform(*_TURN_M))


@dataclass(frozen=True, slots=True)
class _StreetDraw:
    """Properties drawn for a street: the limit of speed, and parking on its left and right."""

    speed_m_s: float
    parking: tuple[bool, bool]

    @staticmethod
    def draw(rng: np.random.Generator) -> _StreetDraw:
        speed, (left, right) = float(rng.choice(_SPEEDS_M_S)), (rng.random(2) < _PARKING).tolist()
        return _StreetDraw(speed, (left, right))


def _gaps(arms: tuple[Arm, ...]) -> list[float]:
    """Return the angles between arms and the next ones, counter-clockwise."""
    headings = [arm.heading_rad for arm in arms]
    return [(b - a) % (2 * math.pi) for a, b in zip(headings, headings[1:] + headings[:1], strict=True)]


def draw_plan(seed: int, options: TownOptions) -> Plan:
    """Draw streets and junctions.

    Raises:
        InvalidValueError: no such town was found.
    """
    rng = stream(seed, "town")
    count = int(rng.choice(len(_COUNTS), p=_COUNTS)) + 1
    most = int(rng.choice(len(_LANES), p=_LANES)) + 1
    turn_rad = float(rng.uniform(-np.pi, np.pi))
    count = options.junctions or min(count, _COUNT_BY_LANES[options.lanes or most])
    most = options.lanes or most
    for attempt in range(_ATTEMPTS):
        # The more often streets came too close, the more regular the next sketch is.
        freedom = max(0.0, 1.0 - attempt / _CALM)
        plan = _attempt(stream(seed, "streets", str(attempt)), count, most, freedom)
        if plan is not None:
            return replace(plan, turn_rad=turn_rad)
    raise InvalidValueError(
        f"no town with junctions={count} and lanes={most} was found for place_seed={seed} in {_ATTEMPTS} attempts: "
        f"use fewer junctions or lanes, or another place_seed"
    )


def _attempt(rng: np.random.Generator, count: int, most: int, freedom: float) -> Plan | None:
    """Draw a town; None where streets came too close, or a junction got too few arms."""
    low, high = _SPACING_M[most]
    spacing_m = (low, high if count > 4 else high + 20.0)
    outer_m = _OUTER_M[(count < 6) + (count == 1)]
    sketch = draw_sketch(rng, count, Measures(spacing_m, outer_m, _LEAST_RAD[most], freedom))
    arms = [sketch.arms(number) for number in range(count)]
    if any(not 3 <= len(each) <= 5 or min(_gaps(each)) < LEAST_ANGLE_RAD for each in arms):
        return None
    away_m = exact.norm(sketch.centres - sketch.centres.mean(axis=0), axis=1) + rng.uniform(0, 30, count)
    meeting = int(np.where([min(_gaps(each)) < _LEAST_RAD[most] for each in arms], np.inf, away_m).argmin())
    sketch.links = [replace(link, points=link.points - sketch.centres[meeting]) for link in sketch.links]
    sketch.centres = sketch.centres - sketch.centres[meeting]
    draws = [_JunctionDraw.draw(rng, most) for _ in range(count)]
    if rng.random() > freedom:
        draws = [replace(drawn, lanes=most, round_about=False) for drawn in draws]
    draws[meeting].lanes, draws[meeting].round_about = most, draws[meeting].round_about and most == 1
    street_draws = [_StreetDraw.draw(rng) for _ in sketch.links]
    for _ in range(_REPAIRS):
        arms = [sketch.arms(number) for number in range(count)]
        if min(min(_gaps(each)) for each in arms) < LEAST_ANGLE_RAD or min(_gaps(arms[meeting])) < _LEAST_RAD[most]:
            return None
        junctions = [_junction(k, sketch.centres[k], arms[k], drawn) for k, drawn in enumerate(draws)]
        streets, failed = list[Street](), None
        for number, link in enumerate(sketch.links):
            street = _street(number, link, junctions, street_draws[number])
            if street is None:
                failed = link
                break
            streets.append(street)
        if failed is None:
            plan = Plan(tuple(streets), tuple(junctions), meeting)
            return plan if are_apart(plan) else None
        if not _repair(failed, junctions, draws, meeting):
            return None
    return None


def _repair(link: Link, junctions: list[Junction], draws: list[_JunctionDraw], meeting: int) -> bool:
    """Ask less of a street that has no space for its bends and changes of lanes; return whether that is possible."""
    ends = [end for end in (link.begin, link.end) if end is not None]
    if len(link.points) > 2 and link.end is not None:
        link.points = link.points[[0, -1]]
        return True
    for end in ends:
        if junctions[end].kind == "roundabout":
            draws[end].round_about = False
            return True
    if len({junctions[end].lanes for end in ends}) > 1:
        less, more = sorted(ends, key=lambda end: junctions[end].lanes)
        if more != meeting:
            draws[more].lanes = junctions[more].lanes - 1
            return True
        asked, draws[less].lanes = draws[less].lanes, junctions[less].lanes + 1
        return asked <= junctions[less].lanes  # else its arms are too close for more lanes
    return False


def _junction(number: int, centre: Floats, arms: tuple[Arm, ...], drawn: _JunctionDraw) -> Junction:
    """Decide a junction's kind, its lanes and its stop lines: as drawn where that is possible."""
    lanes, least = drawn.lanes, min(_gaps(arms))
    while lanes > 1 and least < _LEAST_RAD[lanes]:
        lanes -= 1
    if drawn.round_about and len(arms) <= 4 and lanes == 1:
        for ring_m, entry_m in _RINGS:
            aside_m = entry_m + INNER_M + ROUNDABOUT_MEDIAN_M / 2
            if least - 2 * exact.arcsin(aside_m / (ring_m + entry_m)) > _RING_PIECE_M / ring_m:
                stop_m = math.sqrt(np.square(ring_m + entry_m) - np.square(aside_m))
                return Junction(number, centre, "roundabout", arms, stop_m, lanes, None, ring_m, entry_m)
    bend, main = min(
        (abs(math.remainder(arms[j].heading_rad - arms[i].heading_rad - math.pi, 2 * math.pi)), (i, j))
        for i, j in combinations(range(len(arms)), 2)
    )
    outer_m = (lanes - 0.5) * LANE_M
    stop_m = max(_LEAST_STOP_M, *((drawn.turn_m + outer_m) / exact.tan(min(gap, 3.0) / 2) for gap in _gaps(arms)))
    if drawn.priority and bend < _STRAIGHT_ON_RAD:
        return Junction(number, centre, "priority", arms, stop_m, lanes, main)
    return Junction(number, centre, "equal", arms, stop_m, lanes)


def _street(number: int, link: Link, junctions: list[Junction], drawn: _StreetDraw) -> Street | None:
    """Return the street of a link, or None where it has no space for its bends and changes of lanes."""
    ends = [junctions[link.begin], None if link.end is None else junctions[link.end]]
    lanes = [end.lanes if end else 1 for end in ends]
    core = min(lanes)
    straight_m = (_straight_m(ends[0], core), _straight_m(ends[1], core))
    points = link.points if link.end is not None else _long_enough(link, straight_m[0])
    line = rounded(points, straight_m, max(lanes))
    if line is None:
        return None
    length_m = sum(stretch.length_m for stretch in line)
    stations = _stations(ends[0], core, 0.0, 1) + _stations(ends[1], core, length_m, -1)[::-1]
    if any(after.along_m - station.along_m < _MARGIN_M for station, after in pairwise(stations)) or not _can_stop(
        stations, loops=link.end is None
    ):
        return None
    begin, end = (
        StreetEnd(None)
        if end is None
        else StreetEnd(end.number, [arm.street for arm in end.arms].index(number), end.stop_m)
        for end in ends
    )
    speed = _MAIN_SPEED_M_S if core > 1 else drawn.speed_m_s
    return Street(number, line, begin, end, stations, speed, *drawn.parking)


def _can_stop(stations: tuple[Station, ...], *, loops: bool) -> bool:
    """Return whether a street is long enough between a junction or a place where lanes join, and the next stop line.

    A vehicle asks for its way over a junction when it has passed the one before.
    """
    free_m = stations[-1].along_m - stations[0].along_m
    for order, leads_on in ((1, loops), (-1, False)):
        joined = [after.along_m for before, after in pairwise(stations[::order]) if before.lanes > after.lanes]
        if joined and not leads_on:
            free_m = min(free_m, abs(stations[::order][-1].along_m - joined[-1]))
    return free_m > _BRAKING_M


def _straight_m(junction: Junction | None, core: int) -> float:
    """Return the length from a street's end where it must be straight, for changes of its cross-section."""
    if junction is None:
        return 0.0
    changes = _changes(junction, core)
    return junction.stop_m + _MARGIN_M + (changes[-1].along_m if changes else 0.0)


def _changes(junction: Junction, core: int) -> list[Station]:
    """Return the cross-sections of a street behind a stop line, by the distance from it, until it has `core` lanes."""
    if junction.kind == "roundabout":
        return [Station(_MEDIAN_END_M, core)]
    found, along_m = list[Station](), _STORAGE_M
    for lanes in range(junction.lanes, core, -1):
        found += [Station(along_m, lanes), Station(along_m + MERGE_M, lanes - 1)]
        along_m += MERGE_M + _BETWEEN_M
    return found


def _stations(junction: Junction | None, core: int, from_m: float, sign: int) -> tuple[Station, ...]:
    """Return the cross-sections from one end of a street inwards."""
    if junction is None:
        return (Station(from_m, core),)
    first = Station(from_m + sign * junction.stop_m, junction.lanes, junction.inner_m)
    changes = _changes(junction, core)
    return (first, *(replace(each, along_m=from_m + sign * (junction.stop_m + each.along_m)) for each in changes))


def _long_enough(link: Link, straight_m: float) -> Floats:
    """Return the points of a street that leads out, its first leg not shorter than it must be."""
    first, second = link.points[:2]
    leg = second - first
    length_m = float(exact.hypot(*leg))
    spare_m = 25.0 if len(link.points) > 2 else 5.0
    further = leg / length_m * max(0.0, straight_m + spare_m - length_m)
    return np.vstack([link.points[:1], link.points[1:] + further])


BETWEEN_M = 14.0
"""Least width between the lanes of two streets, for pavements on both sides and something between them."""

_STEP_M = 6.0
_LARGEST_M = {1: 400.0, 2: 480.0, 3: 640.0}  # extent of the streets along either side, by most lanes
_NEAR_M = 16.0  # this far beyond the stop lines streets of one junction may be closer


def are_apart(plan: Plan) -> bool:
    """Return whether streets keep their distance from others, and the town is not too large."""
    spots, half_m, street = _samples(plan)
    extent = spots.max(axis=0) - spots.min(axis=0)
    if (extent > _LARGEST_M[max(junction.lanes for junction in plan.junctions)]).any():
        return False
    gap_m = exact.norm(spots[:, None] - spots, axis=2) - half_m[:, None] - half_m
    close = (gap_m < BETWEEN_M) & (street[:, None] != street)
    for junction in plan.junctions:
        incident = np.zeros(len(plan.streets), dtype=np.bool_)
        incident[[arm.street for arm in junction.arms]] = True
        own = incident[street]
        away_m = exact.norm(spots - junction.centre, axis=1)
        if (away_m - half_m)[~own].min(initial=np.inf) < junction.stop_m + BETWEEN_M / 2:
            return False
        near = own & (away_m < junction.stop_m + junction.half_m + _NEAR_M)
        close &= ~((near[:, None] | near) & own[:, None] & own)
    return not bool(close.any())


def _samples(plan: Plan) -> tuple[Floats, Floats, np.ndarray[tuple[int], np.dtype[np.int64]]]:
    """Return places (N, 2) m on all streets and loops, half the widths there (N,) m, and the street (N,)."""
    spots, half_m, number = [], [], []
    for street in plan.streets:
        first, last = street.span_m
        along = np.linspace(first, last, max(2, int((last - first) / _STEP_M)))
        spots.append(street.position(along))
        half_m.append(street.half_m(along))
        if street.end.junction is None:
            spots.append(street.position(street.length_m + LOOP_REACH_M))
            half_m.append(np.array([LOOP_RADIUS_M + LANE_M / 2]))
        number.append(np.full(len(along) + (street.end.junction is None), street.number))
    return np.concatenate(spots), np.concatenate(half_m), np.concatenate(number)
