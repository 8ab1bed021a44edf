"""A learner drives a car by accelerations: its rewards, its observation, and gymnasium's and other people's rules."""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from pettingzoo.test import parallel_api_test
from representatives import all_of

import coopsim
from coopsim.envs.wrappers import BevImage, Driving, DrivingRows, FixedSize, Flatten
from coopsim.envs.wrappers.driving_rows import DrivingRowsView
from coopsim.errors import CoopsimError, EpisodeStateError, UnknownNameError
from coopsim.interfaces.planner import PlannedCar, Planner
from coopsim.support.rng import derived_seed
from coopsim.types.driving import GIVES_WAY, HAS_PRIORITY

CROWDED: dict[str, Any] = {
    "control": "acceleration",
    "driven_agents": ["cav_0"],
    "ends_on_crash": True,
    "reward": "safe_progress",
    "lidar": None,
    "vehicles": 25,
    "connected_cars": 3,
    "max_cycles": 250,
}
TRACKED: dict[str, Any] = CROWDED | {"tracker": "late_fusion", "others": "late_fusion"}
CRASHES = 0
"""A seed with which a car that accelerates, come what may, crashes."""

FULL, NONE, BRAKE = (np.float32([a]) for a in (3.0, 0.0, -8.0))


def single(**options: Any) -> Any:
    return coopsim.single_env("crossing", **(TRACKED | options))


def drive(env: Any, seed: int, action: Any, steps: int = 250) -> list[tuple[Any, float, bool, bool]]:
    """Return observation, reward, terminated and truncated of each step."""
    env.reset(seed=seed)
    history = []
    for _ in range(steps):
        observation, reward, terminated, truncated, _ = env.step(action)
        history.append((observation, reward, terminated, truncated))
        if terminated or truncated:
            break
    return history


def test_the_reward_falls_at_the_crash_which_ends_the_episode() -> None:
    *before, (_, last, terminated, truncated) = drive(single(), CRASHES, FULL)
    assert terminated and not truncated
    assert last < -4.5 < min(reward for _, reward, *_ in before)
    assert sum(reward for _, reward, *_ in before[20:40]) > 1.5  # of 2 s


def test_a_car_that_stands_earns_nothing() -> None:
    history = drive(single(max_cycles=60), CRASHES, BRAKE)
    assert not any(terminated for *_, terminated, _ in history)
    assert [reward for _, reward, *_ in history[-10:]] == [0.0] * 10
    assert min(reward for _, reward, *_ in history) < 0.0  # it came to its stop hard


def test_a_jerky_drive_earns_less_than_a_smooth_one_as_fast() -> None:
    smooth, jerky = single(max_cycles=20, vehicles=3), single(max_cycles=20, vehicles=3)
    smooth.reset(seed=1)
    jerky.reset(seed=1)
    earned = np.zeros(2)
    for k in range(20):
        earned += smooth.step(NONE)[1], jerky.step(np.float32([1.0 if k % 2 else -1.0]))[1]
    speeds = [env.parallel.cars["cav_0"].speed_m_s for env in (smooth, jerky)]
    assert speeds[0] == pytest.approx(speeds[1], abs=0.3)
    assert earned[1] < earned[0] - 0.2


@pytest.mark.parametrize("workers", [0, 2])
def test_vectors_give_the_rewards_of_one_environment_and_begin_again_after_a_crash(workers: int) -> None:
    alone = drive(DrivingRows(single()), CRASHES, FULL)
    options = TRACKED | {"agents": "single", "wrap": [DrivingRows, Flatten]}
    with coopsim.vector("crossing", 2, workers=workers, **options) as vector:
        vector.reset(seed=[CRASHES, CRASHES + 1])
        for k, (observation, reward, terminated, _) in enumerate(alone):
            observations, rewards, terminations, _, _ = vector.step(np.stack([FULL, FULL]))
            assert rewards[0] == reward and terminations[0] == terminated, k
            flat = np.concatenate([observation[name].reshape(-1) for name in sorted(observation)])
            np.testing.assert_array_equal(observations[0], flat)
        assert terminations[0]
        observations, rewards, terminations, _, _ = vector.step(np.stack([FULL, FULL]))
        assert rewards[0] == 0.0 and not terminations[0] and vector.observation_space.contains(observations)


@pytest.mark.parametrize("mode", all_of(["sync", "async"], "sync"))
def test_gymnasium_makes_vectors_of_a_driver(mode: str) -> None:
    alone = drive(Flatten(DrivingRows(single())), CRASHES, FULL)
    envs = gymnasium.make_vec(
        "coopsim/crossing-v3", num_envs=2, vectorization_mode=mode, wrappers=[DrivingRows, Flatten], **TRACKED
    )
    try:
        envs.reset(seed=[CRASHES, CRASHES])
        for observation, reward, terminated, _ in alone:
            observations, rewards, terminations, _, _ = envs.step(np.stack([FULL, FULL]))
            assert rewards.tolist() == [reward, reward] and terminations.tolist() == [terminated] * 2
            np.testing.assert_array_equal(observations, np.stack([observation, observation]))
        assert not envs.step(np.stack([FULL, FULL]))[2].any()
    finally:
        envs.close()


@pytest.mark.filterwarnings("ignore:.*is different from the unwrapped version")
@pytest.mark.filterwarnings("ignore:.*For Box action spaces, we recommend using a symmetric")
@pytest.mark.filterwarnings("ignore:.*We recommend you to use a symmetric")
def test_checkers_of_others_accept_a_driver() -> None:
    driver = {name: TRACKED[name] for name in ("control", "tracker", "others", "reward", "lidar")}
    made = gymnasium.make("coopsim/occluded_pedestrian-v3", **driver, max_cycles=5)
    check_env(Flatten(DrivingRows(made)), skip_render_check=True)
    check_env(BevImage(FixedSize(DrivingRows(made)), size=16), skip_render_check=True)
    again = gymnasium.make(Flatten(DrivingRows(made, tracks=3)).spec)
    assert again.observation_space.shape == (4 + 10 * 4 + 3 * 21,)
    pytest.importorskip("stable_baselines3", exc_type=ImportError)
    from stable_baselines3.common.env_checker import check_env as check_for_sb3

    check_for_sb3(Flatten(DrivingRows(made)))


@pytest.mark.filterwarnings("ignore:reset option 'options' is ignored")
def test_pettingzoo_accepts_drivers() -> None:
    env = coopsim.parallel_env("crossing", **(CROWDED | {"driven_agents": ["cav_0", "cav_2"], "max_cycles": 6}))
    parallel_api_test(Flatten(DrivingRows(Driving(env))), num_cycles=8)


def test_one_driver_sees_what_it_sees_among_all() -> None:
    among = DrivingRows(Driving(coopsim.parallel_env("crossing", **CROWDED)))
    alone = DrivingRows(single())
    history = drive(alone, CRASHES, FULL)
    among.reset(seed=CRASHES)
    for observation, reward, terminated, _ in history:
        observations, rewards, terminations, _, _ = among.step({"cav_0": FULL})
        assert rewards == {"cav_0": reward} and terminations == {"cav_0": terminated}
        for name, array in observation.items():
            np.testing.assert_array_equal(array, observations["cav_0"][name])


def test_rows_show_the_car_its_route_and_its_nearest_tracks() -> None:
    """The numbers times their bounds are those of the car's state and of the policy's tracks."""
    env = DrivingRows(single(max_cycles=40), tracks=6, points=7, ahead_m=30.0, reach_m=40.0)
    env.reset(seed=3)
    for _ in range(25):
        observation, *_ = env.step(NONE)
        assert env.observation_space.contains(observation)
        car, tracks = env.unwrapped.parallel.cars["cav_0"], env.unwrapped.reported_tracks("cav_0")
        assert observation["car"][:2] == pytest.approx([car.speed_m_s / 40, car.acceleration_m_s2 / 8], abs=1e-6)
        x, y, limit, right = observation["route"].T
        np.testing.assert_allclose(np.column_stack([x, y]) * 30, car.route.points[:31:5], atol=1e-4)
        np.testing.assert_allclose(limit * 40, car.route.speed_limit_m_s[:31:5], atol=1e-4)
        assert set(right) <= {GIVES_WAY, 0, HAS_PRIORITY}
        near = tracks.boxes.center[(np.abs(tracks.boxes.center[:, :2]) <= 40).all(axis=1), :2]
        near = near[np.argsort(np.hypot(*near.T))][:6]
        assert observation["tracks_mask"].sum() == len(near)
        np.testing.assert_allclose(observation["tracks"][: len(near), :2] * 40, near, atol=1e-4)
        assert not observation["tracks"][len(near) :].any()
        assert len(near) > 0


def test_tracks_lie_along_and_aside_of_the_route() -> None:
    """The place on the route as far along as a track is as far from it as the track is aside."""
    env = DrivingRows(single(tracker="truth", max_cycles=30))
    env.reset(seed=5)
    ahead = 0
    for _ in range(30):
        observation, *_ = env.step(NONE)
        car = env.unwrapped.parallel.cars["cav_0"]
        for row in observation["tracks"][observation["tracks_mask"] > 0]:
            along, aside = row[4:6] * 80
            if 2 < along < 60:
                apart = np.hypot(*(car.route.points[round(along)] - row[:2] * 80))
                assert apart == pytest.approx(abs(aside), abs=0.8)
                ahead += 1
        if not env.unwrapped.parallel.agents:
            break
    assert ahead > 0


def linear(rows: dict[str, Any]) -> float:
    """Return the acceleration of a network of one layer with weights that nobody trained."""
    flat = np.concatenate([rows[name].reshape(-1) for name in sorted(rows)])
    return float(2.0 * np.tanh(np.random.default_rng(0).normal(size=len(flat)) @ flat))


class Linear(Planner):
    def plan(self, car: PlannedCar) -> float:
        return linear(DrivingRowsView(tracks=5).rows(car, car.tracks))


def test_a_network_drives_the_same_way_as_a_planner() -> None:
    """It is shown the same; and the others share what they detect, with or without a policy."""
    options = CROWDED | {"max_cycles": 40}
    env = DrivingRows(coopsim.single_env("crossing", tracker="late_fusion", **options), tracks=5)
    observation, _ = env.reset(seed=CRASHES)
    planned = coopsim.parallel_env("crossing", **(options | {"control": "planner", "planner": Linear}))
    policy = coopsim.make_policy("late_fusion")
    observations, _ = planned.reset(seed=CRASHES)
    policy.reset(planned.agent_specs, seed=derived_seed(CRASHES, "policy"))
    while planned.agents:
        observation, reward, *_ = env.step(np.float64([linear(observation)]))
        observations, rewards, *_ = planned.step(policy.act(observations))
        np.testing.assert_array_equal(env.unwrapped.parallel.state(), planned.state())
        assert rewards == {name: reward if name == "cav_0" else 0.0 for name in rewards}


def test_looking_at_the_tracks_changes_nothing() -> None:
    looking, other = single(max_cycles=12), single(max_cycles=12)
    for env in (looking, other):
        env.reset(seed=4)
    for _ in range(12):
        looking.reported_tracks("cav_0")
        one, two = looking.step(NONE), other.step(NONE)
        assert one[1:4] == two[1:4]
    assert looking.parallel.score().to_dict() == other.parallel.score().to_dict()
    assert one[3] and len(looking.reported_tracks("cav_0")) > 0  # those of the last observation, too
    with pytest.raises(EpisodeStateError, match="over"):
        looking.step(NONE)


def test_tracks_are_told_of_whom_has_a_tracker() -> None:
    with pytest.raises(EpisodeStateError, match="call reset"):
        single().reported_tracks("cav_0")
    with pytest.raises(UnknownNameError, match=r"agent with a policy 'cav_9'.*cav_1"):
        single().reported_tracks("cav_9")
    driving = Driving(coopsim.parallel_env("crossing", **CROWDED))
    driving.reset(seed=0)
    with pytest.raises(UnknownNameError, match="unknown agent 'cav_9'"):
        driving.reported_tracks("cav_9")


@pytest.mark.parametrize(
    ("make", "says"),
    [
        (lambda: DrivingRows(single(), track=3), "unknown option 'track'"),
        (lambda: DrivingRows(single(), tracks=0), "tracks must be an integer >= 1"),
        (lambda: DrivingRows(single(), ahead_m=-1), "ahead_m must be"),
        (lambda: DrivingRows(coopsim.single_env("crossing", **CROWDED)), "and a tracker"),
        (lambda: DrivingRows(coopsim.single_env("crossing", others="late_fusion", **CROWDED)), "and a tracker"),
        (lambda: DrivingRows(coopsim.parallel_env("crossing", **CROWDED)), "and be within Driving"),
        (
            lambda: DrivingRows(single(control="policy", driven_agents=None, reward=None)),
            'cars that control="acceleration" or "steering" drives',
        ),
        (lambda: DrivingRows(DrivingRows(single())), "env has such a wrapper already: car"),
    ],
)
def test_rows_need_a_driver_with_a_tracker(make: Any, says: str) -> None:
    with pytest.raises(CoopsimError, match=says):
        make()
