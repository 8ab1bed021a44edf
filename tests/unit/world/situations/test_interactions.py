"""Interactions: the same for a seed, a crash if nobody reacts, the same agents, in any place with a site."""

from __future__ import annotations

from collections import Counter
from contextlib import closing
from typing import Any

import numpy as np
import pytest

import coopsim
from coopsim.errors import CoopsimError, InvalidValueError
from coopsim.types.driving import HAS_PRIORITY
from coopsim.world.places.layout import Layout
from coopsim.world.places.road_network import Road
from coopsim.world.situations import junction_sites
from coopsim.world.situations.interactions import INTERACTIVE, PRE_CRASH, ROWS
from coopsim.world.situations.junction_sites import turn_of
from coopsim.world.situations.situation import SITUATIONS, Situation
from coopsim.world.world import World

YIELDING = ("four_way", "opposing_right_and_left", "joins_traffic")
"""Rows in which others may give way."""


def situation(name: str = "interaction", **options: Any) -> Situation:
    return SITUATIONS.get(name)(**options)


def world(kind: str, seed: int, **options: Any) -> World:
    scenario = situation(kind=kind, **options).of(seed)
    return World(scenario, seed, control="acceleration", driven=("cav_0",))


def test_a_site_for_many_others_looks_at_each_pair_of_ways_once(monkeypatch: pytest.MonkeyPatch) -> None:
    looked, layouts = Counter[tuple[int, Road, Road]](), dict[int, Layout]()
    meeting = junction_sites._meeting

    def counted(layout: Layout, road: Road, other: Road) -> tuple[float, float] | None:
        layouts[id(layout)] = layout
        looked[id(layout), road, other] += 1
        return meeting(layout, road, other)

    monkeypatch.setattr(junction_sites, "_meeting", counted)
    situation(kind="four_way", place="town").of(1000)
    assert looked
    assert max(looked.values()) == 1


def test_there_are_twelve_pre_crash_types_and_ten_interactions() -> None:
    assert (len(PRE_CRASH), len(INTERACTIVE), len(ROWS)) == (12, 10, 22)


@pytest.mark.parametrize("kind", ROWS)
def test_without_a_reaction_the_ego_crashes_into_what_the_script_names(kind: str) -> None:
    crashes, agents = Counter[bool](), set()
    for seed in range(4):
        made = world(kind, seed)
        agents.add(tuple(made.agents()))
        ego = made.agents()["cav_0"].actor_id
        for _ in range(80):
            made.step(0.1, {"cav_0": 0.0})
            if ego in made.crashed():
                break
        crashes[ego in made.crashed()] += 1
    assert crashes[True] >= (1 if kind in YIELDING else 2)
    assert len(agents) == 1, "all seeds have agents of the same names"


def test_the_same_seed_is_the_same_interaction_and_another_is_another() -> None:
    boxes = []
    for seed in (5, 5, 6):
        made = world("left_turn_opposite", seed)
        for _ in range(5):
            made.step(0.1, {"cav_0": 0.0})
        boxes.append(made.actors().boxes.array.tolist())
    assert boxes[0] == boxes[1] != boxes[2]


@pytest.mark.parametrize(("kind", "turn"), [("joins_traffic", "right"), ("unprotected_left", "left")])
def test_the_ego_turns_as_its_row_says(kind: str, turn: str) -> None:
    scenario = situation(kind=kind).of(1)
    assert scenario.script is not None
    roads = [road for road in scenario.script.ego.route if road in scenario.layout.movements]
    assert turn_of(scenario.layout, roads[0]) == turn


def test_who_has_the_right_of_way_is_the_rows() -> None:
    ways = [
        world(kind, 1).car_ahead("cav_0").route.right_of_way for kind in ("emergency_vehicle", "left_turn_opposite")
    ]
    assert HAS_PRIORITY in ways[0] and HAS_PRIORITY not in ways[1]


def test_sites_are_found_in_drawn_towns_and_a_list_ends_with_the_own_place() -> None:
    town = situation(kind="straight_crossing", place=["town", "named"]).of(3)
    assert town.name == "town" and town.place_seed is not None
    assert situation(kind="roundabout_entry", place=["town", "named"]).of(3).name == "roundabout"
    assert situation("merge_barrier", place=["town", "named"]).of(3).name == "merge"
    several = situation(kind="walker_crosses", place=["crossing", "t_junction", "named"])
    assert {several.of(seed).name for seed in range(6)} == {"crossing", "t_junction"}


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"kind": "cut-in"}, "unknown kind 'cut-in'"),
        ({"kind": "cut_in", "place": "town"}, "unknown place 'town'. Accepted: named"),
        ({"place": ["town", "nowhere"]}, "unknown place 'nowhere'"),
        ({"place": []}, "place must be at least one"),
        ({"place": ["crossing"], "place_seed": 3}, "place_seed must be left out"),
    ],
)
def test_wrong_options_give_one_line(options: dict[str, Any], message: str) -> None:
    with pytest.raises(CoopsimError) as caught:
        situation(**options)
    assert message in str(caught.value) and "\n" not in str(caught.value)


def test_names_of_environments_may_have_options() -> None:
    with closing(coopsim.parallel_env("interaction(kind=lead_stopped)", lidar=None, penetration=1)) as env:
        assert env.possible_agents[0] == "cav_0"
    with pytest.raises(InvalidValueError, match="name=value"):
        coopsim.parallel_env("interaction(lead_stopped)")


def test_a_route_has_the_same_agents_in_all_places_and_ends_at_its_goal() -> None:
    route = situation("route", place=["town", "crossing"], vehicles=8, pedestrians=2)
    agents = {name: tuple(World(route.of(seed), seed).agents()) for seed in range(4) for name in [route.of(seed).name]}
    assert set(agents) == {"town", "crossing"} and len(set(agents.values())) == 1
    options: dict[str, Any] = {"place": "crossing", "vehicles": 2, "pedestrians": 0, "lidar": None}
    with closing(coopsim.parallel_env("route(route_m=[20, 25])", penetration=0, **options)) as env:
        episode = coopsim.run_episode(env, coopsim.make_policy("no_fusion"), seed=2)
        assert episode.frame.end == "arrived" and not env.agents
        values = env.score().values
    assert values["route_completion"] == values["success"] == 100
    assert values["driving_score"] == pytest.approx(100)


def test_the_goal_of_a_situation_is_nobodys() -> None:
    with closing(coopsim.parallel_env("interaction", planner="route_follower", lidar=None, max_cycles=3)) as env:
        coopsim.run_episode(env, coopsim.make_policy("no_fusion"), seed=0)
        values = env.score().values
    assert np.isnan(values["route_completion"]) and np.isnan(values["success"])


def test_only_driven_cars_can_arrive() -> None:
    with pytest.raises(InvalidValueError, match="ends_on_arrival needs cars that agents drive"):
        coopsim.parallel_env("crossing", ends_on_arrival=True)
