"""Programs of traffic lights for junctions whose lights have none, made from their movements.

Approaches that face each other are green together, and their left turns give way. Left turns have a stage of their own
where they come from two lanes or more, or where that is asked for. Times follow the Traffic Signal Timing Manual of
the Federal Highway Administration (FHWA-HOP-08-024, 2008, chapter 5), except where a constant is called ours.

A junction of a map whose file has lights but no times: one `LitMovement` for every way with a light, in the order of
`MapSignal.roads`, one `LitCrossing` for each of its `crosswalks`, and in `groups` the numbers of the ways of each
controller, which are green together. Ways without a light are left out. The result is `MapSignal.phases`.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple

from coopsim.support.rng import stream
from coopsim.world.places.description import MapPhase
from coopsim.world.places.signals import GIVE_WAY, PRIORITY, RED, YELLOW

GREEN_S, LEFT_GREEN_S = (14, 30), (7, 14)
"""Ranges that green times are drawn from, in whole seconds: of stages, and of those for left turns alone. Ours."""

YELLOW_S, ALL_RED_S = (3.0, 5.0), (1.0, 6.0)
"""Accepted ranges; yellow may have up to 6 s there."""

WALK_S = 7.0
"""Least green of crosswalks."""

WALKING_M_S = 1.2
"""Speed at which people clear a crosswalk."""

_REACTION_S, _BRAKING_M_S2, _VEHICLE_M = 1.0, 3.05, 6.1  # equations 5-1 and 5-2
_FACING_RAD = math.radians(35.0)  # two approaches face each other up to this angle
_RANK = {"straight": 0, "right": 1, "left": 2, "around": 3}  # of movements that meet, the lower one goes first
_LATE = ("left", "around")

Pairs = Collection[tuple[int, int]]


@dataclass(frozen=True, slots=True)
class LitMovement:
    """Way over a junction with a light.

    Attributes:
        approach: name of the road that it comes from, in this direction.
        lane: name of the lane that it comes from.
        heading_rad: direction of travel on the approach.
        turn: direction in which it leaves.
        speed_m_s: limit on the approach.
        length_m: from the stop line to the end of the way.
    """

    approach: str
    lane: str
    heading_rad: float
    turn: Literal["left", "straight", "right", "around"]
    speed_m_s: float
    length_m: float


@dataclass(frozen=True, slots=True)
class LitCrossing:
    """Crosswalk with a light.

    Attributes:
        length_m: over the road.
        entered: numbers of the movements that cross it as they enter the junction.
        left: numbers of those that cross it as they leave. Turning ones may be green at the same time.
    """

    length_m: float
    entered: tuple[int, ...] = ()
    left: tuple[int, ...] = ()


class _Stage(NamedTuple):
    """Movements that are green together; `late`: left turns alone."""

    green: tuple[int, ...]
    late: bool = False


def make_program(
    movements: Sequence[LitMovement],
    conflicts: Pairs,
    crossings: Sequence[LitCrossing] = (),
    *,
    seed: int,
    name: str,
    groups: Sequence[Collection[int]] = (),
    protect_left: bool = False,
) -> tuple[MapPhase, ...]:
    """Make a program for the lights of a junction.

    Args:
        movements: ways with a light.
        conflicts: pairs of numbers of movements that cross or join, each in one order or both.
        crossings: crosswalks with a light.
        seed: decides the green times.
        name: name of the junction; another one has other times.
        groups: numbers of movements that controllers let go together, each in stages of its own; empty: all are one.
            Movements in no group are one more. Movements of a group that must not be green together are divided.
        protect_left: left turns have stages of their own wherever others cross them.

    Returns:
        Phases; states have a letter for every movement, then one for every crosswalk. One phase where nobody meets;
        none without movements.
    """
    pairs = {frozenset(pair) for pair in conflicts}
    grouped = {number for group in groups for number in group}
    rest = [number for number in range(len(movements)) if number not in grouped]
    stages = [
        stage
        for group in [*map(sorted, groups), rest]
        for axis in _axes(movements, group)
        for stage in _divided(movements, axis, pairs, protect_left=protect_left)
    ]
    if not stages:
        return ()
    walks = [_crossings_of(stage, movements, crossings) for stage in stages]
    if len(set().union(*walks)) < len(crossings):
        stages, walks = [*stages, _Stage(())], [*walks, set(range(len(crossings)))]
    rng = stream(seed, "signal program", name)
    ranges_s = [LEFT_GREEN_S if stage.late else GREEN_S if stage.green else (0, 0) for stage in stages]
    drawn = [int(rng.integers(*range_s, endpoint=True)) for range_s in ranges_s]
    letters = [_letters(stage, movements, pairs) for stage in stages]
    phases = list[MapPhase]()
    for k in range(len(stages)):
        after = (k + 1) % len(stages)
        here, there = (_Shown(letters[each], walks[each]) for each in (k, after))
        phases += _phases(here, there, drawn[k], movements, crossings)
    return tuple(phases)


def _axes(movements: Sequence[LitMovement], numbers: Sequence[int]) -> list[list[int]]:
    """Return movements by approaches that face each other, and those of the others alone."""
    heading = {movements[n].approach: movements[n].heading_rad for n in reversed(numbers)}
    names = list(dict.fromkeys(movements[n].approach for n in numbers))
    facing = sorted(
        (abs(math.remainder(heading[a] - heading[b] - math.pi, 2 * math.pi)), i, k)
        for i, a in enumerate(names)
        for k, b in enumerate(names[:i])
    )
    axis = {name: name for name in names}
    for off_rad, i, k in facing:
        pair = names[i], names[k]
        if off_rad < _FACING_RAD and all(list(axis.values()).count(axis[name]) == 1 for name in pair):
            axis[pair[0]] = pair[1]
    found = dict.fromkeys(axis[name] for name in names)
    return [[n for n in numbers if axis[movements[n].approach] == each] for each in found]


def _divided(
    movements: Sequence[LitMovement], axis: list[int], pairs: set[frozenset[int]], *, protect_left: bool
) -> list[_Stage]:
    """Divide an axis into stages whose movements may be green together."""
    late = [n for n in axis if movements[n].turn in _LATE]
    others = [n for n in axis if n not in late]
    alone = [
        _Stage(tuple(n for n in axis if movements[n].approach == name))
        for name in dict.fromkeys(movements[n].approach for n in axis)
    ]

    def meet(some: Iterable[int], more: Iterable[int]) -> bool:
        return any(
            frozenset((a, b)) in pairs and movements[a].approach != movements[b].approach for a in some for b in more
        )

    straight = [n for n in others if movements[n].turn == "straight"]
    if meet(straight, straight):
        return alone
    lanes = {(movements[n].approach, movements[n].lane) for n in late}
    wide = len(lanes) > len({approach for approach, _ in lanes})
    if not (wide or protect_left) or not meet(late, others):
        return [_Stage(tuple(axis))]
    if lanes & {(movements[n].approach, movements[n].lane) for n in others}:
        return alone  # who turns left would stop those behind, at green
    return [_Stage(tuple(late), late=True), _Stage(tuple(others))]


def _crossings_of(stage: _Stage, movements: Sequence[LitMovement], crossings: Sequence[LitCrossing]) -> set[int]:
    """Return the numbers of the crosswalks that are green in a stage."""
    green = set(stage.green)
    through = {n for n in green if stage.late or movements[n].turn == "straight"}
    return {k for k, each in enumerate(crossings) if not green & set(each.entered) and not through & set(each.left)}


def _letters(stage: _Stage, movements: Sequence[LitMovement], pairs: set[frozenset[int]]) -> str:
    """Return the letters of all movements in a stage."""
    rank = [_RANK[movement.turn] for movement in movements]
    approach = [movement.approach for movement in movements]
    late = {
        n
        for n in stage.green
        for other in stage.green
        if frozenset((n, other)) in pairs and approach[n] != approach[other] and rank[n] >= rank[other]
    }
    return "".join(GIVE_WAY if n in late else PRIORITY if n in stage.green else RED for n in range(len(movements)))


class _Shown(NamedTuple):
    """Letters of movements, and numbers of the crosswalks that are green."""

    letters: str
    walks: set[int]


def _phases(
    here: _Shown, there: _Shown, green_s: float, movements: Sequence[LitMovement], crossings: Sequence[LitCrossing]
) -> list[MapPhase]:
    """Return the phases of a stage, and of the change to the next one."""
    ends = [n for n, pair in enumerate(zip(here.letters, there.letters, strict=True)) if pair[0] != RED == pair[1]]
    yellow_s = max((yellow_time_s(movements[n].speed_m_s) for n in ends), default=0.0)
    red_s = max((all_red_s(movements[n].speed_m_s, movements[n].length_m) for n in ends), default=0.0)
    clearing_s = {k: crossings[k].length_m / WALKING_M_S - yellow_s - red_s for k in here.walks - there.walks}
    green_s = max([green_s, *(math.ceil(WALK_S + max(left_s, 0.0)) for left_s in clearing_s.values())])
    off_s = {k: green_s - math.ceil(max(left_s, 0.0)) for k, left_s in clearing_s.items()}
    found, before_s = list[MapPhase](), 0.0
    for at_s in sorted({*off_s.values(), green_s}):
        walks = {k for k in here.walks if off_s.get(k, at_s) >= at_s}
        found.append(MapPhase(float(at_s - before_s), here.letters + _walk_letters(walks, crossings)))
        before_s = at_s
    kept = _walk_letters(here.walks & there.walks, crossings)
    for seconds, last in ((yellow_s, YELLOW), (red_s, RED)):
        if seconds:
            letters = (_between(*pair, last) for pair in zip(here.letters, there.letters, strict=True))
            found.append(MapPhase(seconds, "".join(letters) + kept))
    return found


def _between(here: str, there: str, last: str) -> str:
    """Return the letter of a movement between two stages; `last` is that of movements whose green ends."""
    if RED in (here, there):
        return RED if here == RED else last
    return PRIORITY if here == there == PRIORITY else GIVE_WAY


def _walk_letters(walks: Collection[int], crossings: Sequence[LitCrossing]) -> str:
    return "".join(PRIORITY if k in walks else RED for k in range(len(crossings)))


def yellow_time_s(speed_m_s: float) -> float:
    """Return the yellow time of an approach by its speed, in half seconds: to react, and to brake (equation 5-1)."""
    return _bounded(_REACTION_S + speed_m_s / (2 * _BRAKING_M_S2), YELLOW_S)


def all_red_s(speed_m_s: float, length_m: float) -> float:
    """Return the time for a vehicle to clear a way that it entered at the end of yellow (equation 5-2)."""
    return _bounded((length_m + _VEHICLE_M) / speed_m_s, ALL_RED_S)


def _bounded(seconds: float, limits_s: tuple[float, float]) -> float:
    """Return a time in limits, rounded up to half seconds."""
    return min(max(math.ceil(2 * seconds) / 2, limits_s[0]), limits_s[1])
