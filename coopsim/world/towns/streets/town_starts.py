"""Where vehicles start in a town, and which of them become connected first."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from coopsim.geometry import exact
from coopsim.geometry.se3 import Floats
from coopsim.world.towns.streets.plan import Plan
from coopsim.world.towns.streets.town_roads import TownLane, TownRoads

FIRST = 6
"""Number of starts that are near each other, as far as there is room: the first to have connected cars."""

_NEAR_M = 78.0  # between any two of them; vehicles start up to a metre before or behind
_SPACING_M, _LEAST_M = 15.5, 6.0  # between starts on a lane, and from its beginning
_STOPPING_M = 14.5  # before a stop line


@dataclass(frozen=True, slots=True, eq=False)
class _Start:
    """A start: the road, the distance from its beginning, the place (2,) m, and the arm of the meeting junction."""

    road: tuple[str, str]
    at_m: float
    place: Floats
    arm: int | None


def place_starts(plan: Plan, roads: TownRoads) -> tuple[list[dict[str, Any]], Floats]:
    """Return the key `starts` of a description: all that fit, in the order in which their cars become connected.

    Returns:
        The key's content, and the places (N, 2) m in the same order.
    """
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
    entries = [
        {"road": list(start.road), "at_m": start.at_m, "connected": place + 1} for place, start in enumerate(ranked)
    ]
    return entries, np.array([start.place for start in ranked])


def _on_lane(lanes: list[TownLane], lines: set[str], inwards: dict[str, int]) -> list[_Start]:
    """Return starts on the pieces of a lane, from its end backwards; none where it shifts, or where others join.

    Args:
        lanes: the pieces, in order.
        lines: nodes where vehicles may have to wait.
        inwards: arms of the meeting junction by the nodes at their stop lines.
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

    The first ones are about to meet, from different arms as far as there are, and near each other; these cars see
    different parts of the junction that they are about to share, which is the use of cooperation.
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
