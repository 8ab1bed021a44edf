"""Made programs of traffic lights: stages by conflict, and their times."""

from __future__ import annotations

from itertools import pairwise, product

import numpy as np
import pytest

from coopsim.world.places.signal_plans import (
    ALL_RED_S,
    GREEN_S,
    LEFT_GREEN_S,
    WALK_S,
    LitCrossing,
    LitMovement,
    all_red_s,
    make_program,
    yellow_time_s,
)

TURN = {1: "right", 2: "straight", 3: "left"}
"""Turns by how many arms on, counter-clockwise, a way leads."""


def junction(
    arms: tuple[int, ...] = (0, 1, 2, 3), lanes: dict[str, tuple[int, ...]] | None = None
) -> tuple[list[tuple[int, int]], list[LitMovement], set[tuple[int, int]], list[LitCrossing]]:
    """Return ends, movements, conflicts and crosswalks of a crossing; `lanes` has the lanes by turn, usually one."""
    lanes = lanes or dict.fromkeys(TURN.values(), (0,))
    ends, found = [], []
    for a, b in product(arms, arms):
        if a == b:
            continue
        turn = TURN[(b - a) % 4]
        for lane in lanes[turn]:
            ends.append((a, b))
            found.append(LitMovement(f"in{a}", str(lane), (a + 2) * np.pi / 2, turn, 13.9, 24.0))
    conflicts = {
        (i, k)
        for i, (a, b) in enumerate(ends)
        for k, (c, d) in enumerate(ends)
        if a != c and (b == d or _alternate(2 * a + 1, 2 * b, 2 * c + 1, 2 * d))
    }
    walks = [
        LitCrossing(
            12.0,
            tuple(k for k, (a, _) in enumerate(ends) if a == arm),
            tuple(k for k, (_, b) in enumerate(ends) if b == arm),
        )
        for arm in arms
    ]
    return ends, found, conflicts, walks


def _alternate(a: int, b: int, c: int, d: int) -> bool:
    low, high = sorted((a, b))
    return (low < c < high) != (low < d < high)


def test_two_stages_where_left_turns_give_way() -> None:
    ends, movements, conflicts, _ = junction()
    phases = make_program(movements, conflicts, seed=1, name="a")
    assert [set(phase.state) for phase in phases] == [set("Ggr"), set("yr"), set("r")] * 2
    for state, own in zip((phases[0].state, phases[3].state), ((0, 2), (1, 3)), strict=True):
        for letter, (a, b) in zip(state, ends, strict=True):
            assert letter == ("r" if a not in own else "g" if (b - a) % 4 == 3 else "G")
    assert all(GREEN_S[0] <= phases[k].seconds <= GREEN_S[1] for k in (0, 3))
    assert {phases[1].seconds, phases[2].seconds} == {yellow_time_s(13.9), all_red_s(13.9, 24.0)}


def test_two_left_lanes_and_a_wish_make_four_stages() -> None:
    _, movements, conflicts, _ = junction(lanes={"left": (0, 1), "straight": (2,), "right": (2,)})
    wide = make_program(movements, conflicts, seed=1, name="a")
    _, movements, conflicts, _ = junction(lanes={"left": (0,), "straight": (1,), "right": (1,)})
    asked = make_program(movements, conflicts, seed=1, name="a", protect_left=True)
    for phases in (wide, asked):
        states = [phase.state for phase in phases if "G" in phase.state]
        assert len(states) == 4 and not any("g" in state for state in states)
    assert LEFT_GREEN_S[0] <= asked[0].seconds <= LEFT_GREEN_S[1]


def test_a_shared_lane_of_protected_left_turns_has_a_stage_for_each_approach() -> None:
    ends, movements, conflicts, _ = junction()
    phases = make_program(movements, conflicts, seed=1, name="a", protect_left=True)
    states = [phase.state for phase in phases if "G" in phase.state]
    assert [{a for (a, _), letter in zip(ends, state, strict=True) if letter == "G"} for state in states] == [
        {0},
        {2},
        {1},
        {3},
    ]


def test_three_arms_have_two_stages() -> None:
    ends, movements, conflicts, walks = junction((0, 1, 2))
    phases = make_program(movements, conflicts, walks, seed=1, name="a")
    states = [phase.state for phase in phases if "G" in phase.state[: len(ends)]]
    assert {state[: len(ends)] for state in states} == {
        "".join("r" if a == 1 else "g" if (b - a) % 4 == 3 else "G" for a, b in ends),
        "".join("G" if a == 1 else "r" for a, b in ends),
    }


@pytest.mark.parametrize("lanes", [None, {"left": (0, 1), "straight": (2,), "right": (2,)}])
def test_green_ends_by_yellow_and_conflicting_ways_never_are_green_together(
    lanes: dict[str, tuple[int, ...]] | None,
) -> None:
    _, movements, conflicts, walks = junction(lanes=lanes)
    phases = make_program(movements, conflicts, walks, seed=3, name="b")
    states = [phase.state for phase in phases]
    for here, there in pairwise([*states, states[0]]):
        changes = set(zip(here[: len(movements)], there[: len(movements)], strict=True))
        assert not changes & {("G", "r"), ("g", "r"), ("y", "G"), ("y", "g"), ("r", "y")}
        for i, k in conflicts:
            assert here[i] + here[k] != "GG" and here[i] + there[k] not in ("yG", "GG")
    assert all(set("Gg") & {state[n] for state in states} for n in range(len(states[0])))


def test_crosswalks_go_with_parallel_traffic_and_are_cleared_in_time() -> None:
    ends, movements, conflicts, walks = junction()
    walks = [LitCrossing(30.0, walk.entered, walk.left) for walk in walks]
    phases = make_program(movements, conflicts, walks, seed=3, name="b")
    first = phases[0].state
    assert first[12:] == "rGrG" and first[ends.index((0, 2))] == "G"
    for walk in range(4):
        letters = [(phase.seconds, phase.state[12 + walk]) for phase in phases]
        others = [n for n, (a, b) in enumerate(ends) if a == walk or (b == walk and (a - b) % 4 == 2)]
        open_s, red_s = 0.0, 0.0
        for (seconds, letter), phase in zip(letters * 2, [*phases, *phases], strict=True):
            if letter == "G":
                open_s, red_s = open_s + seconds, 0.0
                continue
            if open_s and {phase.state[n] for n in others} & set("Gg"):
                assert open_s >= WALK_S and red_s >= 30.0 / 1.2
                break
            red_s += seconds
        else:
            pytest.fail("the crosswalk never is green")


def test_a_crosswalk_that_no_stage_lets_go_has_one_of_its_own() -> None:
    movements = [LitMovement("a", "0", 0.0, "straight", 8.3, 10.0), LitMovement("b", "0", np.pi, "straight", 8.3, 10.0)]
    phases = make_program(movements, (), [LitCrossing(9.0, (0,), (1,))], seed=1, name="walk")
    assert [phase.state for phase in phases] == ["GGr", "yyr", "rrr", "rrG", "rrr"]
    assert phases[3].seconds == WALK_S and phases[4].seconds == 8.0
    assert [phase.state for phase in make_program(movements, (), seed=1, name="")] == ["GG"]
    assert make_program((), (), seed=1, name="") == ()


def test_controllers_have_stages_of_their_own() -> None:
    ends, movements, conflicts, _ = junction()
    groups = [[n for n, (a, _) in enumerate(ends) if a == arm] for arm in (3, 1)]
    phases = make_program(movements, conflicts, seed=1, name="a", groups=groups)
    green = [
        {a for (a, _), letter in zip(ends, phase.state, strict=True) if letter in "Gg"}
        for phase in phases
        if "G" in phase.state
    ]
    assert green == [{3}, {1}, {0, 2}]
    together = make_program(movements, conflicts, seed=1, name="a", groups=[range(len(ends))])
    assert together == make_program(movements, conflicts, seed=1, name="a")


def test_approaches_that_would_cross_straight_on_are_not_green_together() -> None:
    movements = [LitMovement("a", "0", 0.0, "straight", 8.3, 10.0), LitMovement("b", "0", 2.9, "straight", 8.3, 10.0)]
    assert [phase.state for phase in make_program(movements, {(0, 1)}, seed=1, name="")][::3] == ["Gr", "rG"]


def test_times_by_speed_and_length() -> None:
    assert [yellow_time_s(speed) for speed in (5.0, 12.5, 16.7, 40.0)] == [3.0, 3.5, 4.0, 5.0]
    assert [all_red_s(10.0, length) for length in (1.0, 20.0, 200.0)] == [ALL_RED_S[0], 3.0, ALL_RED_S[1]]


def test_green_times_are_those_of_the_seed_and_the_junction() -> None:
    _, movements, conflicts, _ = junction()
    drawn = {
        key: make_program(movements, conflicts, seed=key[0], name=key[1]) for key in ((1, "a"), (1, "b"), (2, "a"))
    }
    assert len({phases[0].seconds + 100 * phases[3].seconds for phases in drawn.values()}) == 3
    assert make_program(movements, conflicts, seed=1, name="a") == drawn[1, "a"]
