"""Starts of vehicles in a town, and the order in which vehicles and roadside units become agents."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from coopsim.config.annotated import Point
from coopsim.geometry import exact
from coopsim.geometry.se3 import Floats
from coopsim.world.places.description import MapLane, MapStart, MapUnit
from coopsim.world.towns.plan import LANE_M, Plan
from coopsim.world.towns.roads import TownLane, TownRoads

FIRST = 6
"""Number of starts that are near each other, as far as there is room: the first to have connected cars."""

_NEAR_M = 78.0  # between any two of them; vehicles start up to a metre before or behind
_SPACING_M, _LEAST_M = 15.5, 6.0  # between starts on a lane, and from its beginning
_STOPPING_M = 14.5  # before a stop line


@dataclass(frozen=True, slots=True, eq=False)
class _Start:
    """Start at a place (2,) m, a distance from the beginning of a road that leads to an arm of the meeting junction."""

    road: tuple[str, str]
    at_m: float
    place: Floats
    arm: int | None


def place_starts(plan: Plan, roads: TownRoads) -> tuple[list[MapStart], Floats]:
    """Return the starts, all that fit in the order in which cars become connected, and their places (N, 2) m."""
    lines = {name for names in roads.stops.values() for name in names}
    lines |= {lane.road[0] for lane in roads.lanes if lane.piece.joins}
    inwards = {
        name: arm for (junction, arm), names in roads.stops.items() if junction == plan.meeting for name in names
    }
    ways = dict[tuple[int, bool, int], list[TownLane]]()
    for lane in roads.lanes:
        number = max(lane.piece.begin[0], lane.piece.end[0])
        ways.setdefault((lane.way.street.number, lane.way.forwards, number), []).append(lane)
    for lanes in ways.values():
        lanes.sort(key=lambda lane: lane.piece.begin[1], reverse=not lanes[0].way.forwards)
    starts = [start for lanes in ways.values() for start in _on_lane(lanes, lines, inwards)]
    ranked = _ranked(starts, plan)
    found = [MapStart(start.road, start.at_m, connected=place + 1) for place, start in enumerate(ranked)]
    return found, np.array([start.place for start in ranked])


def _on_lane(lanes: list[TownLane], lines: set[str], inwards: dict[str, int]) -> list[_Start]:
    """Return starts on the pieces of a lane, from its end backwards; none where it shifts, or where others join.

    Vehicles may have to wait at the nodes `lines`; `inwards` are arms of the meeting junction by nodes at stop lines.
    """
    found, next_m, arm = list[_Start](), 0.0, None
    for lane in reversed(lanes):
        piece, street, length_m = lane.piece, lane.way.street, lane.length_m
        if lane.road[1] in lines:
            next_m, arm = max(next_m, _STOPPING_M), inwards.get(lane.road[1])
        shifts = piece.begin[0] != piece.end[0]
        # In a bend a start on the next lane would seem to be in this one.
        bends = lane.way.stretch(piece).curvature_1_m != 0.0 and min(each.lanes for each in street.stations) > 1
        if piece.joins or shifts or bends:
            next_m = max(next_m - length_m, _LEAST_M)
            continue
        next_m = max(next_m, 0.1)  # where pieces meet the vehicle is on the one behind
        while next_m < length_m - (_LEAST_M if lane is lanes[0] else 0.0):
            share = 1.0 - next_m / length_m
            along_m = piece.begin[1] + share * (piece.end[1] - piece.begin[1])
            place = street.position(along_m, lane.way.aside_m((piece.end[0], along_m)))[0]
            found.append(_Start(lane.road, round(share * length_m, 3), place, arm))
            next_m += _SPACING_M
        next_m -= length_m
    return found


def _ranked(starts: list[_Start], plan: Plan) -> list[_Start]:
    """Return the starts in the order in which their cars become connected.

    The first ones are near each other and about to meet, from different arms where possible: they see different parts
    of the junction, so cooperation helps.
    """
    centre = plan.junctions[plan.meeting].centre
    spots = np.array([start.place for start in starts])
    apart_m = exact.norm(spots[:, None] - spots, axis=2)
    away_m = exact.norm(spots - centre, axis=1)
    chosen = list[int]()
    for _ in range(min(FIRST, len(starts))):
        left = [k for k in range(len(starts)) if k not in chosen]
        far_m = apart_m[:, chosen].max(axis=1, initial=0.0)
        used = [starts[k].arm for k in chosen]

        def cost(k: int, far_m: Floats = far_m, used: list[int | None] = used) -> tuple[float, bool, int, float]:
            arm = starts[k].arm
            return max(far_m[k], _NEAR_M), arm is None, used.count(arm), away_m[k]

        chosen.append(min(left, key=cost))
    left = [k for k in range(len(starts)) if k not in chosen]
    chosen += sorted(left, key=lambda k: (starts[k].arm is None, away_m[k]))
    return [starts[k] for k in chosen]


CARS, MASTS = 3, 2
"""Usual numbers of connected cars and of roadside units."""

_AGENTS_NEAR_M = 77.0  # between any two; cars start up to a metre before or behind their places
_CHOICE = 16  # starts, and a quarter as many masts: those tried with each other where the usual ones are too far apart


def bring_near(
    starts: Sequence[MapStart], spots: Floats, masts: Sequence[MapUnit]
) -> tuple[list[MapStart], list[MapUnit]]:
    """Reorder starts and masts such that the first ones are near each other, where possible.

    Usual orders are kept as far as possible: first comes each next mast that is near the first cars and the masts so
    far. If the first ones are still too far apart, other cars come first, as far apart from each other as possible.

    Args:
        starts: starts by rank.
        spots: (N, 2) m, places of the starts.
        masts: places for roadside units.
    """
    feet = np.array([mast.at for mast in masts]).reshape(-1, 2)
    order = _near_first(feet, spots[:CARS])
    if _widest_m(np.vstack([spots[:CARS], feet[order[:MASTS]]])) < _AGENTS_NEAR_M:
        return list(starts), [masts[k] for k in order]
    cars, units = _widest_near(spots, feet) or (tuple(range(len(starts)))[:CARS], tuple(order)[:MASTS])
    ranked = [*cars, *(k for k in range(len(starts)) if k not in cars)]
    kept = [*units, *(k for k in order if k not in units)]
    return [replace(starts[k], connected=rank + 1) for rank, k in enumerate(ranked)], [masts[k] for k in kept]


def _near_first(feet: Floats, cars: Floats) -> list[int]:
    """Return indices of masts (M, 2), those near the cars and each other first."""
    left, chosen, agents = list(range(len(feet))), list[int](), cars
    while left:
        near = [k for k in left if exact.norm(agents - feet[k], axis=1).max(initial=0.0) < _AGENTS_NEAR_M]
        if not near:
            break
        left.remove(near[0])
        chosen.append(near[0])
        agents = np.vstack([agents, feet[near[0]]])
    return chosen + left


def _widest_near(spots: Floats, feet: Floats) -> tuple[tuple[int, ...], tuple[int, ...]] | None:
    """Return cars and masts that are near each other, the cars as far apart as possible; None if there are none."""
    best, widest_m = None, -1.0
    for units in combinations(range(min(len(feet), _CHOICE // 4)), min(MASTS, len(feet))):
        away_m = exact.norm(spots[:, None] - feet[list(units)], axis=2).max(axis=1)
        reached = np.argsort(away_m, kind="stable")[:_CHOICE].tolist()
        for cars in combinations([k for k in reached if away_m[k] < _AGENTS_NEAR_M], CARS):
            apart_m = [float(exact.norm(spots[a] - spots[b])) for a, b in combinations(cars, 2)]
            near = max(apart_m) < _AGENTS_NEAR_M and _widest_m(feet[list(units)]) < _AGENTS_NEAR_M
            if near and min(apart_m) > widest_m:
                best, widest_m = (cars, units), min(apart_m)
    return best


def _widest_m(places: Floats) -> float:
    """Return the greatest distance between any two places (N, 2)."""
    return float(exact.norm(places[:, None] - places, axis=2).max(initial=0.0))


_CLEAR_M = LANE_M / 2 + 0.02  # more than coordinates are rounded


def off_roads(masts: Iterable[MapUnit], nodes: Mapping[str, Point], roads: Iterable[MapLane]) -> list[MapUnit]:
    """Return the masts that stand on no lane: wide turns may pass nearer to a corner than its kerb.

    Turning loops are not checked: no mast stands beside them.
    """
    feet = {k: (mast, np.asarray(mast.at, dtype=np.float64)) for k, mast in enumerate(masts)}
    for road in roads:
        if road.turn == "around":
            continue
        start, end = (np.asarray(nodes[name], dtype=np.float64) for name in (road.start, road.end))
        for k, (_, foot) in list(feet.items()):
            away_m = _from_line(foot, start, end) if road.centre is None else _from_arc(foot, road, start, end)
            if away_m < _CLEAR_M:
                del feet[k]
    return [mast for mast, _ in feet.values()]


def _from_line(foot: Floats, start: Floats, end: Floats) -> float:
    """Return the distance (m) of a place (2,) from a line between two."""
    along = end - start
    share = np.clip(exact.dot(foot - start, along) / exact.dot(along, along), 0.0, 1.0)
    return float(exact.hypot(*(foot - start - share * along)))


def _from_arc(foot: Floats, road: MapLane, start: Floats, end: Floats) -> float:
    """Return the distance (m) of a place (2,) from a bend between two."""
    centre, sense = np.asarray(road.centre, dtype=np.float64), 1.0 if road.turn == "left" else -1.0
    first, last, own = (exact.arctan2(*(each - centre)[::-1]) for each in (start, end, foot))
    passed, swept = (sense * (own - first)) % (2 * np.pi), (sense * (last - first)) % (2 * np.pi)
    if passed <= swept:
        return float(abs(exact.hypot(*(foot - centre)) - exact.hypot(*(start - centre))))
    return float(min(exact.hypot(*(foot - start)), exact.hypot(*(foot - end))))
