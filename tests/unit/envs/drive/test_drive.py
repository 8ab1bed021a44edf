"""Drives along routes: spaces, ends, infos and rewards of one car and of several."""

from __future__ import annotations

import math
import warnings
from dataclasses import replace
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from numpy.typing import NDArray
from pettingzoo.test import parallel_api_test

import coopsim
from coopsim.envs import DriveEnv, DriveParallel, DriveStep, PlannedDriver, RouteReward
from coopsim.envs.drive.observation import observe
from coopsim.errors import EpisodeStateError, InvalidActionError, InvalidValueError, UnknownNameError
from coopsim.geometry.se3 import SE3
from coopsim.interfaces.planner import Occlusions, PlannedCar
from coopsim.metrics.evaluator import FrameCounts
from coopsim.planning.route_follower import RouteFollower
from coopsim.types.driving import CarState
from coopsim.world.snapshot import Actors
from coopsim.world.world import World

FEW = {"place": "crossing", "vehicles": 4, "pedestrians": 0}
STAY = np.float32([-8.0, 0.0])


def pursue(car: CarState) -> NDArray[np.float32]:
    """Return the action of a car that follows its route, whoever is in the way."""
    x, y = car.route.points[max(round(0.6 * car.speed_m_s), 4)].tolist()
    x += car.wheelbase_m / 2
    angle = math.atan(2 * y / (x * x + y * y) * car.wheelbase_m)
    ahead_m = np.arange(len(car.route.points)) * car.route.spacing_m
    allowed = float(np.sqrt(car.route.speed_limit_m_s**2 + 3.0 * ahead_m).min())
    return np.float32([np.clip(2 * (allowed - car.speed_m_s), -4.0, 2.0), np.clip(angle, -0.6, 0.6)])


def driven(env: DriveEnv, seed: int, most: int = 2000) -> tuple[dict[str, Any], list[float]]:
    """Follow the route to the end of the drive; return its last infos and its rewards."""
    env.reset(seed=seed)
    rewards = []
    for _ in range(most):
        _, reward, terminated, truncated, info = env.step(pursue(env.parallel.world.car_ahead("cav_0")))
        rewards.append(reward)
        if terminated or truncated:
            break
    return info, rewards


def test_a_car_that_follows_its_route_alone_arrives_in_time() -> None:
    env = DriveEnv(place="urban_grid", vehicles=1, pedestrians=0, route_m=(150, 150))
    info, rewards = driven(env, 1)
    assert info["arrive_dest"] and info["is_success"] and info["route_completion"] == 1.0
    assert not (info["crash"] or info["out_of_road"] or info["max_step"])
    assert info["reward_parts"]["arrive"] == 5.0 and sum(rewards) > 20


@pytest.mark.parametrize("planner", ["route_follower", "idm_aeb"])
def test_a_planner_drives_in_the_place_of_a_learner(planner: str) -> None:
    env = DriveEnv(place="urban_grid", vehicles=2, pedestrians=0, route_m=(60, 60))
    env.reset(seed=1)
    driver, over, info = PlannedDriver(env.parallel, planner), False, {}
    while not over:
        action = driver.act()
        assert env.action_space.contains(action)
        _, _, terminated, truncated, info = env.step(action)
        over = terminated or truncated
    assert info["arrive_dest"]


def test_a_planner_that_is_aware_of_occlusions_gets_walls_and_lanes_across_from_the_car() -> None:
    told: list[Occlusions | None] = []

    class Aware(RouteFollower):
        occlusion_aware = True

        def plan(self, car: PlannedCar) -> tuple[float, float]:  # type: ignore[override]
            told.append(car.occlusions)
            return super().plan(car)

    env = DriveEnv(place="crossing", vehicles=2, pedestrians=0)
    env.reset(seed=1)
    PlannedDriver(env.parallel, Aware).act()
    PlannedDriver(env.parallel, "route_follower").act()
    (known,) = told
    assert known is not None
    world = env.parallel.world
    body = world.agents()["cav_0"].world_SE3_base
    ends = np.concatenate([known.walls[:, :2], known.walls[:, 2:]])
    there = body.apply(np.column_stack([ends, np.zeros(len(ends))]))[:, :2]
    corners = np.concatenate(world.map.buildings)
    assert len(there) and np.hypot(*(there[:, None] - corners).transpose(2, 0, 1)).min(axis=1).max() < 1e-6
    np.testing.assert_array_equal(known.entries, world.entries("cav_0"))
    assert not len(known.eyes)


def test_a_planner_drives_a_car_that_there_is() -> None:
    env = DriveParallel(**FEW)
    with pytest.raises(UnknownNameError, match="cav_1"):
        PlannedDriver(env, "idm_aeb", "cav_1")


def test_everybody_drives_on_the_surface_of_the_road() -> None:
    env = DriveParallel(place="urban_grid", vehicles=20)
    env.reset(seed=2)
    road = env._judge._area._road
    for _ in range(60):
        env._world.step(0.1, {"cav_0": (-8.0, 0.0)})
        assert road.covers(env._world.fleet.position[:20]).all()


def test_a_car_that_leaves_the_road_is_out_of_it() -> None:
    env = DriveEnv(**FEW)
    env.reset(seed=0)
    for _ in range(100):
        _, _, terminated, _, info = env.step(np.float32([1.0, 0.5]))
        if terminated:
            break
    assert terminated and (info["out_of_road"] or info["crash_building"]) and not info["is_success"]
    assert info["reward_parts"]["leave"] + info["reward_parts"]["crash"] == -5.0


def test_time_is_over_for_a_car_that_stands() -> None:
    env = DriveEnv(**FEW, route_m=(10, 10), seconds_per_m=0.1)
    env.reset(seed=0)
    truncated, steps = False, 0
    while not truncated:
        _, _, terminated, truncated, info = env.step(STAY)
        steps += 1
    assert truncated and not terminated and info["max_step"] and info["is_success"] is False and steps == 60


def test_a_crash_says_what_was_hit() -> None:
    env = DriveParallel(**FEW)
    env.reset(seed=3)
    rows = env._world.fleet.rows
    me = env._world._traffic.connected[0]
    other = (me + 1) % 4
    rows["x"][me] = rows["x"][other] - 5.2 * math.cos(rows["heading"][other])
    rows["y"][me] = rows["y"][other] - 5.2 * math.sin(rows["heading"][other])
    rows["heading"][me], rows["speed"][me], rows["speed"][other] = rows["heading"][other], 15.0, 0.0
    for _ in range(5):
        _, rewards, terminated, _, infos = env.step({"cav_0": np.float32([0.0, 0.0])})
        if terminated["cav_0"]:
            break
    info = infos["cav_0"]
    assert info["crash"] and info["crash_vehicle"] and not info["crash_human"] and not info["crash_building"]
    assert rewards["cav_0"] < -4 and not env.agents


def test_gymnasiums_and_pettingzoos_checks_pass() -> None:
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message=".*symmetric and normalized")
        check_env(gymnasium.make("coopsim/drive-v1", **FEW, render_mode="rgb_array").unwrapped, skip_close_check=True)
    parallel_api_test(DriveParallel(**FEW, cars=3), num_cycles=30)


def test_stable_baselines_check_passes() -> None:
    checker = pytest.importorskip("stable_baselines3.common.env_checker")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        checker.check_env(DriveEnv(**FEW), skip_render_check=True)


def test_each_car_has_a_route_of_its_own_and_leaves_when_it_is_done() -> None:
    env = DriveParallel(**FEW | {"vehicles": 6}, cars=3)
    env.reset(seed=1)
    lengths = {env.world.car_ahead(name).route.length_m for name in env.agents}
    assert len(lengths) == 3 and all(200 <= length <= 1000 for length in lengths)
    env._trips["cav_1"].steps = 1
    *_, truncated, _ = env.step(dict.fromkeys(env.agents, STAY))
    assert truncated == {"cav_0": False, "cav_1": True, "cav_2": False} and env.agents == ["cav_0", "cav_2"]
    seen, *_ = env.step(dict.fromkeys(env.agents, STAY))
    assert set(seen) == {"cav_0", "cav_2"}


def test_the_same_seed_gives_the_same_bits_also_in_a_vector() -> None:
    def episode(env: Any) -> bytes:
        seen, _ = env.reset(seed=5)
        rows = [seen]
        for _ in range(15):
            seen, *_ = env.step(np.float32([0.5, 0.02]))
            rows.append(seen)
        return b"".join(row.tobytes() for row in rows)

    assert episode(DriveEnv(**FEW)) == episode(DriveEnv(**FEW))
    with coopsim.vector(lambda **options: DriveEnv(**options), 2, workers=0, **FEW) as vector:
        seen, _ = vector.reset(seed=[5, 6])
        for _ in range(15):
            seen, *_ = vector.step(np.float32([[0.5, 0.02], [0.5, 0.02]]))
    alone = DriveEnv(**FEW)
    alone.reset(seed=5)
    for _ in range(15):
        last, *_ = alone.step(np.float32([0.5, 0.02]))
    np.testing.assert_array_equal(seen[0], last)


@pytest.mark.parametrize(
    "action", [[np.nan, 0.0], [0.0, 0.7], [-9.0, 0.0], [0.0], [0.0, 0.0, 0.0], None, "left", [0.0, np.inf]]
)
def test_malformed_actions_are_refused_and_change_nothing(action: Any) -> None:
    env = DriveEnv(**FEW)
    env.reset(seed=0)
    before = env.parallel.world.fleet.rows.tobytes()
    with pytest.raises(InvalidActionError, match="cav_0"):
        env.step(action)
    assert env.parallel.world.fleet.rows.tobytes() == before


@pytest.mark.parametrize(
    ("options", "error"),
    [
        ({"place": "moon"}, UnknownNameError),
        ({"vehicle": 3}, UnknownNameError),
        ({"cars": 0}, InvalidValueError),
        ({"route_m": (300, 200)}, InvalidValueError),
        ({"route_m": 300}, InvalidValueError),
        ({"grip": 0.0}, InvalidValueError),
        ({"reward": "mota"}, InvalidValueError),
        ({"weather": "hail"}, UnknownNameError),
    ],
)
def test_wrong_options_are_refused(options: dict[str, Any], error: type[Exception]) -> None:
    with pytest.raises(error):
        DriveParallel(**options)


def test_nobody_steps_before_a_reset_and_weights_are_checked() -> None:
    with pytest.raises(EpisodeStateError, match="call reset"):
        DriveParallel(**FEW).step({"cav_0": STAY})
    with pytest.raises(InvalidValueError, match="arrive"):
        RouteReward(arrive=-1)


def test_observations_lie_in_their_bounds_and_show_who_is_near() -> None:
    env = DriveEnv(place="urban_grid", vehicles=20)
    seen, _ = env.reset(seed=4)
    assert env.observation_space.contains(seen)
    others = seen[68:].reshape(12, 10)
    apart = np.hypot(*others[others[:, 9] > 0, :2].T)
    assert len(apart) and (np.diff(apart) >= 0).all() and apart.max() <= 1.0


def test_a_step_makes_nothing_that_only_pictures_and_sensors_need(monkeypatch: pytest.MonkeyPatch) -> None:
    env = DriveEnv(**FEW)
    env.reset(seed=0)
    made, steps = [], 5
    for kind, name in (
        (World, "actors"),
        (World, "agents"),
        (World, "road_users"),
        (Actors, "trusted"),
        (SE3, "inverse"),
    ):
        usual = getattr(kind, name)

        def counted(*given: Any, usual: Any = usual, name: str = name) -> Any:
            made.append(name)
            return usual(*given)

        monkeypatch.setattr(kind, name, counted)
    for _ in range(steps):
        env.step(np.float32([0.0, 0.0]))
    assert made == ["road_users"] * steps


def test_road_users_are_where_actors_are() -> None:
    env = DriveEnv(place="urban_grid", vehicles=8, pedestrians=4, bicycles=2)
    env.reset(seed=4)
    users, actors = env.parallel.world.road_users(), env.parallel.world.actors()
    np.testing.assert_array_equal(users.position, actors.boxes.center[:, :2])
    np.testing.assert_array_equal(users.velocity, actors.velocity)
    np.testing.assert_array_equal(users.label, actors.label)
    np.testing.assert_array_equal(users.size, actors.boxes.size)
    assert actors.id[env.parallel.world.row_of("cav_0")] == env.parallel.world.agents()["cav_0"].actor_id


def test_others_are_seen_from_the_car_by_hand() -> None:
    env = DriveEnv(**FEW)
    env.reset(seed=4)
    world = env.parallel.world
    me = world.row_of("cav_0")
    rows, other = world.fleet.rows, (me + 1) % 4
    rows["x"][me], rows["y"][me], rows["heading"][me] = 0.0, 0.0, math.pi / 2
    rows["x"][other], rows["y"][other], rows["heading"][other], rows["speed"][other] = -3.0, 12.0, math.pi, 4.0
    rows["steering"][other] = 0.0
    seen = observe(world.car_ahead("cav_0"), me, world.road_users(), 0.5)
    first = seen[68:78]
    length, width, _ = world.models[rows["model"][other]].size_m
    wanted = [12 / 60, 3 / 60, 0, 4 / 40, 0, 1, length / 20, width / 4, 0, 1]
    np.testing.assert_allclose(first, wanted, atol=1e-6)


def test_a_red_light_is_told_in_its_step_and_costs() -> None:
    env = DriveEnv(**FEW)
    env.reset(seed=0)
    env.parallel.world.fleet.rows["red_lights"][env.parallel.world.row_of("cav_0")] += 1
    told = [env.step(env.action_space.low)[4] for _ in range(2)]
    assert [each["red_light"] for each in told] == [True, False]
    assert [each["reward_parts"]["red_light"] for each in told] == [-2.5, 0.0]


def test_there_is_no_progress_from_a_red_light_on() -> None:
    env = DriveEnv(**FEW)
    env.reset(seed=0)
    car = env.parallel.world.car_ahead("cav_0")
    stop = replace(car, route=replace(car.route, speed_limit_m_s=np.zeros(len(car.route.points))))
    along = np.array([1.0, 0.0])
    counts = FrameCounts(0, 0, 0, 0, 0)
    assert RouteReward().parts(DriveStep(counts, 0.1, car, car, along))["progress"] > 0
    assert RouteReward().parts(DriveStep(counts, 0.1, stop, car, along))["progress"] == 0


def test_wet_roads_are_slippery() -> None:
    dry, wet = (DriveParallel(**FEW, weather=weather) for weather in (None, "rain"))
    assert dry._grip == 0.85 and wet._grip == pytest.approx(0.6)
    assert DriveParallel(**FEW, grip=0.2)._grip == 0.2
