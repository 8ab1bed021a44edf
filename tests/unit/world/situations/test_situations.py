"""What situations promise: the same for a seed, hidden until near, a crash if nobody reacts, whoever is connected."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import coopsim
from coopsim.errors import InvalidValueError
from coopsim.types.taxonomy import ObjectClass
from coopsim.world.models.catalogue import make_models
from coopsim.world.people.scripted import ScriptedPeople
from coopsim.world.script import WalkRole
from coopsim.world.situations.situation import SITUATIONS, Situation
from coopsim.world.world import World

MINE = ("occluded_pedestrian", "child_between_cars", "crossing_path", "red_light_runner")


def situation(name: str, **options: Any) -> Situation:
    return SITUATIONS.get(name)(**options)


def world(name: str, seed: int, control: str = "acceleration", **options: Any) -> World:
    return World(
        situation(name, **options).of(seed), seed, control=control, driven=("cav_0",) if control != "traffic" else None
    )


def crashed_after(made: World, time_s: float) -> tuple[int, ...]:
    """Let everybody go on, the ego without a reaction, until it crashes."""
    ego = made.agents()["cav_0"].actor_id
    for _ in range(round(time_s / 0.1)):
        made.step(0.1, {"cav_0": 0.0})
        if ego in made.crashed():
            break
    return made.crashed()


@pytest.mark.parametrize("name", MINE)
def test_the_same_seed_is_the_same_situation(name: str) -> None:
    first, again, other = (world(name, seed, "traffic") for seed in (5, 5, 6))
    for _ in range(5):
        for each in (first, again, other):
            each.step(0.1)
    np.testing.assert_array_equal(first.actors().boxes.array, again.actors().boxes.array)
    assert first.actors().boxes.array.tolist() != other.actors().boxes.array.tolist()


@pytest.mark.parametrize("name", MINE)
def test_without_a_reaction_the_ego_crashes_into_what_the_script_names(name: str) -> None:
    for seed in range(12):
        made = world(name, seed)
        ego = made.agents()["cav_0"].actor_id
        crashed = crashed_after(made, 6.0)
        assert ego in crashed, seed
        vehicles = [each for each in made.conflict_ids if each < 1_000]
        assert set(crashed) == {ego, *vehicles}, "nobody else crashes before"


@pytest.mark.parametrize("name", MINE)
def test_penetration_changes_who_is_connected_and_nothing_else(name: str) -> None:
    alone, some, everybody = (world(name, 3, "traffic", penetration=share) for share in (0.0, 0.4, 1.0))
    for _ in range(30):
        for each in (alone, some, everybody):
            each.step(0.1)
    for each in (some, everybody):
        np.testing.assert_array_equal(alone.actors().boxes.array, each.actors().boxes.array)
    connected = [
        {body.actor_id for body in each.agents().values() if body.kind == "cav"} for each in (alone, some, everybody)
    ]
    assert len(connected[0]) == 1 < len(connected[1]) < len(connected[2])
    assert connected[0] < connected[1] < connected[2]


@pytest.mark.parametrize(("share", "count"), [(0.05, 1), (0.1, 2), (0.5, 4), (1.0, 6)])
def test_all_seeds_have_agents_of_the_same_names(share: float, count: int) -> None:
    made = [world("occluded_pedestrian", seed, "traffic", penetration=share, rsus=1) for seed in range(4)]
    assert {tuple(each.agents()) for each in made} == {(*(f"cav_{k}" for k in range(count)), "rsu_0")}


def test_the_mast_is_drawn_near_the_conflict() -> None:
    masts = set()
    for seed in range(12):
        units = [
            body for body in world("crossing_path", seed, "traffic", rsus=1).agents().values() if body.kind == "rsu"
        ]
        x, y = units[0].world_SE3_base.translation[:2]
        masts.add((round(x, 1), round(y, 1)))
        assert np.hypot(x, y) < 30
    assert len(masts) > 1


@pytest.mark.parametrize("name", MINE)
def test_the_conflict_is_hidden_from_the_ego_until_it_is_near(name: str) -> None:
    env = coopsim.parallel_env(name, penetration=0.0, rsus=0, expose_ground_truth=True, detector="none")
    tracker = coopsim.make_policy("no_fusion")
    for seed in (0, 1, 2):
        (conflict,) = world(name, seed, "traffic").conflict_ids
        observations, infos = env.reset(seed=seed)
        tracker.reset(env.agent_specs, seed=seed)
        returns, over = [], {}
        while env.agents:
            truth = infos["cav_0"]["ground_truth"]
            returns.append(int(truth["returns"][truth["id"] == conflict, 0][0]))
            observations, _, over, _, infos = env.step(tracker.act(observations))
        assert over["cav_0"], "nothing is detected, so nobody brakes"
        assert max(returns[-3:]) >= 3, "in view in the end"
        assert np.mean(np.array(returns[:-20]) > 5) < 0.25, "but for glimpses through gaps, hidden until near"
    env.close()


@pytest.mark.parametrize("name", ["child_between_cars", "crossing_path"])
def test_sites_are_found_in_drawn_towns(name: str) -> None:
    scenario = situation(name, place="town").of(3)
    assert scenario.place_seed is not None
    made = World(scenario, 3, control="acceleration", driven=("cav_0",))
    assert made.agents()["cav_0"].actor_id in crashed_after(made, 6.0)


def test_a_place_without_a_site_is_named_in_one_line() -> None:
    with pytest.raises(InvalidValueError, match="site for 'crossing_path', but there is none in 'highway'"):
        situation("crossing_path", place="highway").of(0)
    with pytest.raises(InvalidValueError, match="place_seed must be left out"):
        situation("crossing_path", place_seed=3)


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("speed_m_s", "fast"),
        ("speed_m_s", (9, 8)),
        ("gap_m", (1, 2, 3)),
        ("penetration", 1.5),
        ("rsus", 2),
        ("over_s", 0),
    ],
)
def test_a_wrong_value_is_named(field: str, value: object) -> None:
    with pytest.raises(InvalidValueError, match=f"^{field} must be"):
        situation("occluded_pedestrian", **{field: value})


def test_scripted_people_stand_walk_and_stand_again() -> None:
    path = np.array([[0.0, 0.0], [3.0, 0.0], [3.0, 2.0]])
    roles = [WalkRole("late", ObjectClass.CHILD, path, 2.0, 1.0), WalkRole("early", ObjectClass.CHILD, path, 2.0, -1.0)]
    people = ScriptedPeople(roles, make_models(), 0)
    np.testing.assert_allclose(people.position, [[0, 0], [2, 0]])
    np.testing.assert_allclose(people.velocity, [[0, 0], [2, 0]], atol=1e-12)
    for _ in range(10):
        people.step(0.1)
    np.testing.assert_allclose(people.position, [[0, 0], [3, 1]], atol=1e-9)
    for _ in range(40):
        people.step(0.1)
    np.testing.assert_allclose(people.position, [[3, 2], [3, 2]])
    np.testing.assert_allclose(people.velocity, 0.0)
    np.testing.assert_allclose(people.yaw, np.pi / 2)
