"""Traffic lights of a town's junctions, with programs made for them."""

from __future__ import annotations

import math
from itertools import combinations
from typing import Literal

from coopsim.geometry import exact
from coopsim.support.rng import stream
from coopsim.world.places.description import MapSignal, MapWays
from coopsim.world.places.signal_plans import LitCrossing, LitMovement, make_program
from coopsim.world.towns.pavements import PeopleWays
from coopsim.world.towns.plan import Junction, Plan
from coopsim.world.towns.roads import TownRoads, Turn, meet, turns_of

_STRAIGHT_RAD = math.radians(35.0)  # as lanes are chosen by


def light_junctions(plan: Plan, roads: TownRoads, ways: PeopleWays, walks: MapWays, seed: int) -> tuple[MapSignal, ...]:
    """Put lights at junctions of main roads and at the one where connected cars meet, except at roundabouts.

    Main roads have priority, or two lanes or more in each direction. `walks` is the description of `ways`.
    """
    return tuple(
        _signal(junction, plan, roads, ways, walks, seed)
        for junction in plan.junctions
        if junction.kind != "roundabout"
        and (junction.kind == "priority" or junction.lanes > 1 or junction.number == plan.meeting)
    )


def _signal(junction: Junction, plan: Plan, roads: TownRoads, ways: PeopleWays, walks: MapWays, seed: int) -> MapSignal:
    turns, name = turns_of(junction), str(junction.number)
    arms = [arm for arm in range(len(junction.arms)) if (junction.number, arm) in ways.at_arm]
    crosswalks = [ways.at_arm[junction.number, arm] for arm in arms]
    phases = make_program(
        [_movement(junction, plan, turn) for turn in turns],
        {(a, b) for a, b in combinations(range(len(turns)), 2) if meet(junction, turns[a], turns[b])},
        [_crossing(ways, number, arm, turns) for number, arm in zip(crosswalks, arms, strict=True)],
        seed=seed,
        name=name,
        protect_left=junction.lanes > 2,
    )
    cycle_s = sum(phase.seconds for phase in phases)
    return MapSignal(
        tuple(
            (roads.stops[junction.number, turn.arm][turn.lane], roads.exits[junction.number, turn.other][turn.lane])
            for turn in turns
        ),
        phases,
        tuple(walks.crosswalks[number] for number in crosswalks),
        float(stream(seed, "signal offset", name).integers(int(cycle_s))),
    )


def _movement(junction: Junction, plan: Plan, turn: Turn) -> LitMovement:
    arm = junction.arms[turn.arm]
    speed_m_s = plan.streets[arm.street].speed_m_s
    return LitMovement(
        str(turn.arm), str(turn.lane), arm.heading_rad + math.pi, _kind(turn), speed_m_s, 2 * junction.stop_m
    )


def _kind(turn: Turn) -> Literal["left", "straight", "right"]:
    if abs(turn.angle - math.pi) < _STRAIGHT_RAD:
        return "straight"
    return "right" if turn.angle < math.pi else "left"


def _crossing(ways: PeopleWays, number: int, arm: int, turns: list[Turn]) -> LitCrossing:
    start, end = ways.spans()[number]
    return LitCrossing(
        float(exact.norm(end - start)),
        tuple(k for k, turn in enumerate(turns) if turn.arm == arm),
        tuple(k for k, turn in enumerate(turns) if turn.other == arm),
    )
