"""`control="steering"` and planners that steer, in the environment of all agents and in that of one."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import coopsim
from coopsim import PlannedCar, Planner
from coopsim.envs.ego_step import EgoStep
from coopsim.envs.wrappers import DrivingRows, FixedTracks
from coopsim.errors import InvalidActionError, InvalidValueError, PlannerError
from coopsim.interfaces.planner import Occlusions
from coopsim.types import Tracks
from coopsim.wire.actions import pack_tracks

SMALL = {"lidar": None, "vehicles": 3, "pedestrians": 0, "connected_cars": 1, "rsus": 0, "max_cycles": 30}


def act(steering: Any) -> dict[str, Any]:
    return {"cav_0": {"tracks": pack_tracks(Tracks.empty()), "steering": steering}}


def test_an_action_steers_and_infos_tell_of_the_goal() -> None:
    env = coopsim.parallel_env("urban_grid", control="steering", route_m=(250, 250), **SMALL)
    _, infos = env.reset(seed=1)
    assert env.agent_specs["cav_0"].command == "steering" and env.action_space("cav_0")["steering"].shape == (2,)
    assert infos["cav_0"]["route_completion"] == 0.0 and infos["cav_0"]["arrive_dest"] is False
    for _ in range(10):
        _, _, _, _, infos = env.step(act(np.float32([1.0, 0.3])))
    car = env.cars["cav_0"]
    assert 0.2 < car.steering_rad < 0.3 and 2 < car.wheelbase_m < 4
    assert car.route.length_m == 250 and 0 < infos["cav_0"]["route_completion"] < 0.2
    assert env.episode.frame.agents["cav_0"].command_m_s2 == 1.0


@pytest.mark.parametrize("given", [np.nan, [np.nan, 0.0], [0.0, 0.61], [3.1, 0.0], [0.0], "left", None])
def test_malformed_steering_is_refused_and_changes_nothing(given: Any) -> None:
    env = coopsim.parallel_env("crossing", control="steering", **SMALL)
    env.reset(seed=0)
    before = env.state().tobytes()
    with pytest.raises(InvalidActionError, match="cav_0: steering"):
        env.step(act(given))
    assert env.state().tobytes() == before


@pytest.mark.parametrize(
    ("options", "match"),
    [
        ({"traffic": "highway-env"}, 'needs traffic="arrays"'),
        ({"route_m": (300, 200)}, "route_m must be two distances"),
        ({"route_m": (200, np.nan)}, "route_m must be two distances"),
        ({"grip": 2.0}, "grip must be"),
    ],
)
def test_wrong_options_are_refused(options: dict[str, Any], match: str) -> None:
    with pytest.raises(InvalidValueError, match=match):
        coopsim.parallel_env("crossing", control="steering", **SMALL | options)


def test_a_learner_with_a_tracker_steers_by_its_rows() -> None:
    env = DrivingRows(coopsim.single_env("crossing", control="steering", tracker="no_fusion", **SMALL))
    env.reset(seed=0)
    assert env.action_space.shape == (2,)
    seen, *_ = env.step(np.float32([0.0, 0.1]))
    assert env.observation_space.contains(seen)


def test_tracks_of_fixed_size_have_two_numbers_for_steering() -> None:
    env = FixedTracks(coopsim.single_env("crossing", control="steering", **SMALL), tracks=2)
    env.reset(seed=0)
    action = -np.ones(env.action_space.shape, np.float32)
    action[-2:] = 1.0, 0.5
    for _ in range(8):
        env.step(action)
    car = env.unwrapped.parallel.cars["cav_0"]
    assert car.acceleration_m_s2 == pytest.approx(3.0) and 0.1 < car.steering_rad < 0.3


def test_pictures_caption_both_numbers() -> None:
    assert EgoStep("cav_0", None, (1.0, -0.1)).lines[1] == "action +1.0 m/s², -6 degrees"


class Straight(Planner):
    steers = True

    def plan(self, car: PlannedCar) -> tuple[float, float]:
        assert car.wheelbase_m > 2
        return -1.0, 9.0


class Forgets(Planner):
    steers = True

    def plan(self, car: PlannedCar) -> float:
        return -1.0


class Undecided(Planner):
    def plan(self, car: PlannedCar) -> tuple[float, float]:
        return -1.0, 0.0


def drive(planner: Any, steps: int = 5, place: str = "crossing") -> coopsim.CooperativeEnv:
    env = coopsim.parallel_env(place, control="planner", planner=planner, **SMALL | {"max_cycles": 400})
    policy = coopsim.make_policy("no_fusion")
    observations, _ = env.reset(seed=3)
    policy.reset(env.agent_specs)
    for _ in range(steps):
        observations, *_ = env.step(policy.act(observations))
    return env


def test_a_planner_that_steers_turns_the_wheels_up_to_their_bound() -> None:
    assert 0.1 < drive(Straight).cars["cav_0"].steering_rad < 0.6


@pytest.mark.parametrize(("planner", "accepted"), [(Forgets, "and a finite angle"), (Undecided, "in m/s²$")])
def test_a_planner_must_return_what_it_says(planner: Any, accepted: str) -> None:
    with pytest.raises(PlannerError, match=accepted):
        drive(planner)


SEEN: list[Occlusions] = []


class Aware(Straight):
    occlusion_aware = True

    def plan(self, car: PlannedCar) -> tuple[float, float]:
        assert car.occlusions is not None
        SEEN.append(car.occlusions)
        return 0.0, 0.0


def test_an_occlusion_aware_planner_is_told_of_walls_entries_and_senders_alone() -> None:
    SEEN.clear()
    env = coopsim.parallel_env(
        "crossing", control="planner", planner=Aware, driven_agents=["cav_0"], uplink="detections",
        **SMALL | {"connected_cars": 2, "rsus": 1},
    )  # fmt: skip
    observations, _ = env.reset(seed=3)
    policy = coopsim.make_policy("late_fusion")
    policy.reset(env.agent_specs)
    env.step(policy.act(observations))
    (known,) = SEEN
    me, *others = (env.episode.frame.agents[name].body for name in ("cav_0", "cav_1", "rsu_0"))
    there = [me.world_SE3_base.inverse().apply(each.world_SE3_base.translation)[:2] for each in others]
    apart = np.hypot(*(known.eyes[:, None] - np.array(there)).transpose(2, 0, 1)).min(axis=0)
    assert len(known.eyes) == 2 and (apart < 3.0).all()  # as they say themselves, a step before
    assert len(known.walls) > 4 and (np.abs(known.walls) < 200).all()
    assert (known.entries[:, 2:] > 0).all()


def test_infos_tell_of_leaving_the_route_the_wrong_way_and_red_lights() -> None:
    env = coopsim.parallel_env("crossing", control="steering", **SMALL | {"max_cycles": 200})
    env.reset(seed=1)
    told = []
    while env.agents:
        _, _, _, _, infos = env.step(act(np.float32([2.0, 0.35])))
        told.append((infos["cav_0"]["out_of_route"], infos["cav_0"]["wrong_way"], infos["cav_0"]["red_lights"]))
    assert told[0] == (False, False, 0) and any(wrong for _, wrong, _ in told)


def test_the_route_follower_stays_on_its_route() -> None:
    car = drive("route_follower", 150, "urban_grid").cars["cav_0"]
    assert car.route.completion > 0.03 and not car.crashed and not car.wrong_way
    assert np.hypot(*car.route.points[0]) < 1.0
