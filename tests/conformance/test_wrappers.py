"""Wrappers for learners keep the rules of PettingZoo and gymnasium, in every environment, and show no truth."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import gymnasium
import numpy as np
import pytest
from codec_samples import some_queries
from gymnasium.utils.env_checker import check_env
from pettingzoo.test import parallel_api_test, parallel_seed_test
from pettingzoo.utils import BaseParallelWrapper
from small_env import SMALL

import coopsim
from coopsim.comms.uplinks.share_features import ShareQueries
from coopsim.envs.wrappers import BevImage, Driving, FixedSize, FixedTracks, Flatten, WithoutInfos
from coopsim.errors import CoopsimError, EpisodeStateError, InvalidActionError, UnknownNameError

Make = Callable[..., Any]

OBSERVING: dict[str, Make] = {
    "fixed": lambda env: FixedSize(env, detections=8, messages=3, received=4, points=16),
    "picture": lambda env: BevImage(env, size=32, channels=("detections", "points", "messages", "velocity", "map")),
    "both": lambda env: BevImage(FixedSize(env, order="surest"), size=16, dtype="float32"),
    "flat": lambda env: Flatten(FixedSize(env, detections=4, messages=2, received=2)),
    "flat_both": lambda env: Flatten(FixedSize(BevImage(env, size=16))),
    "flat_picture": lambda env: Flatten(BevImage(env, size=16)),
}

DELAYED = {"latency_s": 0.15, "latency_jitter_s": 0.1, "loss": 0.2, "position_noise_m": 0.3, "heading_noise_rad": 0.01}

SITUATIONS: dict[str, dict[str, Any]] = {
    "delayed": DELAYED,
    "no_rays": {"lidar": None, "connected_cars": 6},
    "cameras": {"cameras": "front", "camera_modes": ("depth",), "max_cycles": 3, "lidar": None},
    "drones": {"drones": 2, "rsus": 1},
    "several_lidars": {"lidar": {"roof": "VLP-16", "bumper": "VLP-16"}},
    "tracks": {"uplink": "tracks", "lidar": None},
    "points": {"uplink": "points"},
    "queries": {"uplink": lambda spec, rng: ShareQueries(lambda view: some_queries(5)), "lidar": None},
    "silent": {"uplink": "none", "lidar": None},
    "every_third": {"sense_every": 3, "lidar": None},
    "stated": {"localization": {"covariance_scale": 1.0}, "lidar": None},
}


def play(env: Any, seed: int) -> list[Any]:
    """Observations of an episode of random actions, each in its space."""
    for agent in env.possible_agents:
        env.action_space(agent).seed(seed)
    observations, _ = env.reset(seed=seed)
    history = [observations]
    while env.agents:
        assert set(env.agents) <= set(observations)
        observations, *_ = env.step({agent: env.action_space(agent).sample() for agent in env.agents})
        history.append(observations)
    assert len(history) > 1 and all(history)
    for frame in history:
        for agent, observation in frame.items():
            assert env.observation_space(agent).contains(observation), agent
            assert all(np.isfinite(each).all() for each in arrays(observation))
    return history


def arrays(observation: Any) -> list[Any]:
    return list(observation.values()) if isinstance(observation, dict) else [observation]


def assert_same(a: list[Any], b: list[Any]) -> None:
    assert len(a) == len(b)
    for one, other in zip(a, b, strict=True):
        assert one.keys() == other.keys()
        for agent in one:
            for left, right in zip(arrays(one[agent]), arrays(other[agent]), strict=True):
                np.testing.assert_array_equal(left, right)


@pytest.mark.parametrize(
    ("scenario", "form"), [*(("crossing", form) for form in OBSERVING), ("highway", "both"), ("urban_grid", "both")]
)
def test_observations_are_in_their_spaces_and_the_same_again(make_small: Make, scenario: str, form: str) -> None:
    options = DELAYED | {"max_cycles": 6, "lidar_columns": 64}
    env = OBSERVING[form](FixedTracks(make_small(scenario, **options), tracks=4))
    again = OBSERVING[form](FixedTracks(make_small(scenario, **options), tracks=4))
    history = play(env, seed=5)
    assert_same(history, play(again, seed=5))
    assert_same(history, play(env, seed=5))  # nothing is left of the episode before


@pytest.mark.parametrize("situation", SITUATIONS)
def test_every_situation_has_shapes(make_small: Make, situation: str) -> None:
    env = make_small(**({"max_cycles": 6, "lidar_columns": 64} | SITUATIONS[situation]))
    assert len(play(OBSERVING["both"](FixedTracks(env, tracks=4)), seed=1)) > 3


@pytest.mark.parametrize("form", ["fixed", "picture", "both"])
def test_recordings_have_shapes(recordings: Path, form: str) -> None:
    env = coopsim.parallel_env("replay", path=recordings, detections=("ego", "1"))
    history = play(OBSERVING[form](FixedTracks(env, tracks=2)), seed=1)
    assert len(history) == 7


def test_v2v4real_has_shapes(v2v4real: Path) -> None:
    env = coopsim.parallel_env("replay", path=v2v4real, detections=("ego", "1"))
    env = FixedTracks(FixedSize(env), tracks=2)
    observations, _ = env.reset(seed=0)
    for _ in range(30):
        assert len(observations) == 2
        for agent, observation in observations.items():
            assert env.observation_space(agent).contains(observation)
            assert observation["detections_mask"].sum() > 0 and observation["messages_mask"].sum() == 1
        observations, *_ = env.step({agent: env.action_space(agent).sample() for agent in env.agents})


@pytest.mark.parametrize("form", ["both", "flat", "picture"])
@pytest.mark.filterwarnings("ignore:reset option 'options' is ignored")
def test_pettingzoo_accepts_it(make_small: Make, form: str) -> None:
    def make() -> Any:
        return OBSERVING[form](Driving(make_small(control="policy", lidar_columns=64, max_cycles=5)))

    parallel_api_test(make(), num_cycles=8)
    parallel_seed_test(make, 4)


@pytest.mark.filterwarnings("ignore:reset option 'options' is ignored")
def test_pettingzoo_accepts_tracks_as_numbers(make_small: Make) -> None:
    parallel_api_test(FixedTracks(make_small(control="policy", lidar=None)), num_cycles=15)


def single(**options: Any) -> Any:
    return coopsim.single_env("crossing", **(SMALL | {"max_cycles": 5, "lidar_columns": 64} | options))


@pytest.mark.parametrize("form", ["fixed", "both", "flat_picture"])
@pytest.mark.filterwarnings("ignore:.*is different from the unwrapped version")
def test_gymnasium_accepts_it(form: str) -> None:
    driving = OBSERVING[form](single(others="late_fusion", tracker="late_fusion", control="policy"))
    check_env(driving, skip_render_check=True)
    assert driving.action_space == gymnasium.spaces.Discrete(5)
    check_env(OBSERVING[form](FixedTracks(single(), tracks=3)), skip_render_check=True)


@pytest.mark.parametrize("form", OBSERVING)
def test_one_agent_sees_what_it_sees_among_all(make_small: Make, form: str) -> None:
    options = {"max_cycles": 5, "lidar_columns": 64, **DELAYED}
    alone, among = OBSERVING[form](single(ego="cav_1", **DELAYED)), OBSERVING[form](make_small(**options))
    observation, _ = alone.reset(seed=4)
    observations, _ = among.reset(seed=4)
    nothing = coopsim.single_env("crossing", **SMALL).action_space.sample
    for _ in range(5):
        for left, right in zip(arrays(observation), arrays(observations["cav_1"]), strict=True):
            np.testing.assert_array_equal(left, right)
        observation, *_ = alone.step(nothing())
        observations, *_ = among.step({agent: nothing() for agent in among.agents})


def test_gymnasium_makes_vectors_of_it() -> None:
    envs = gymnasium.make_vec(
        "coopsim/crossing-v3",
        num_envs=2,
        vectorization_mode="sync",
        wrappers=[OBSERVING["flat"]],
        **(SMALL | {"tracker": "late_fusion", "control": "policy", "lidar": None, "max_cycles": 3}),
    )
    observations, _ = envs.reset(seed=1)
    for _ in range(5):
        assert envs.observation_space.contains(observations)
        observations, *_ = envs.step(envs.action_space.sample())
    envs.close()


class Leaving(BaseParallelWrapper):  # type: ignore[misc, type-arg]
    """An environment that `cav_0` leaves after two frames, and `cav_1` comes to in the third."""

    def __init__(self, env: Any) -> None:
        super().__init__(env)
        self.possible_agents = env.possible_agents

    def reset(self, seed: int | None = None, options: Any = None) -> Any:
        self._frame = 0
        observations, infos = self.env.reset(seed, options)
        return self._present(observations), self._present(infos)

    def step(self, actions: Any) -> Any:
        self._frame += 1
        rest = {name: {"tracks": self.env.action_space(name).sample()["tracks"]} for name in self.env.agents}
        return tuple(self._present(each) for each in self.env.step(rest | actions))

    @property
    def agents(self) -> Any:
        return list(self._present(dict.fromkeys(self.env.agents)))

    def _present(self, by_agent: Any) -> Any:
        away = "cav_0" if self._frame > 2 else "cav_1"
        return {name: each for name, each in by_agent.items() if name != away}


@pytest.mark.parametrize("form", OBSERVING)
def test_agents_come_and_go(make_small: Make, form: str) -> None:
    env = OBSERVING[form](FixedTracks(Leaving(make_small(lidar=None, max_cycles=5)), tracks=2))
    history = play(env, seed=2)
    assert "cav_0" in history[1] and "cav_1" not in history[1]
    assert "cav_0" not in history[4] and "cav_1" in history[4]


def test_nothing_but_observations_and_the_map_is_shown(make_small: Make) -> None:
    """All is worked out anew from the packed observations alone, of an environment whose truth is far from them."""
    env = make_small(max_cycles=6, expose_ground_truth=True, control="policy", **(DELAYED | {"position_noise_m": 5.0}))
    wrapped = OBSERVING["both"](env)
    form = OBSERVING["both"](make_small()).form
    shown, infos = wrapped.reset(seed=3)
    form.begin(SimpleNamespace(agent_specs=env.agent_specs, road_map=env.road_map))
    while True:
        packed = dict(env.episode.observations)
        assert_same([shown], [form.observe_all(packed)])
        for agent in wrapped.agents:
            own = shown[agent]["own"]
            np.testing.assert_allclose(own[:2], packed[agent]["pose"][:2], rtol=1e-6)
            assert np.abs(own[:2] - infos[agent]["true_pose"][:2]).max() > 0.01
        if not wrapped.agents:
            break
        actions = {agent: wrapped.action_space(agent).sample() for agent in wrapped.agents}
        shown, _, _, _, infos = wrapped.step(actions)


def test_exposing_the_truth_changes_nothing_that_is_shown(make_small: Make) -> None:
    hidden, exposed = (
        play(OBSERVING["both"](FixedTracks(make_small(max_cycles=4, expose_ground_truth=truth), tracks=2)), seed=1)
        for truth in (False, True)
    )
    assert_same(hidden, exposed)


def test_the_map_is_placed_by_the_estimated_pose(make_small: Make) -> None:
    def roads(**noise: Any) -> tuple[Any, Any]:
        env = BevImage(make_small(lidar=None, **noise), channels=("map",))
        pictures, _ = env.reset(seed=0)
        return pictures["cav_0"], env.unwrapped.episode.observations["cav_0"]["pose"]

    exact, _ = roads()
    noisy, pose = roads(position_noise_m=8.0)
    assert not np.array_equal(exact, noisy)
    assert np.isfinite(pose).all()


def test_agents_do_not_share_a_space(make_small: Make) -> None:
    env = FixedSize(Driving(make_small(control="policy", lidar=None)))
    first, second = (env.observation_space(agent) for agent in env.possible_agents[:2])
    assert first == second and first is not second
    assert env.action_space("cav_0") is env.action_space("cav_0") is not env.action_space("cav_1")


def test_a_policy_tracks_while_agents_drive(make_small: Make) -> None:
    """Idle drivers score as if the policy alone acted."""
    env = Driving(make_small(control="policy", rsus=1), tracker="late_fusion(merge_iou=0.2)")
    env.reset(seed=3)
    assert env.agents == [name for name in env.unwrapped.agents if name.startswith("cav")]
    while env.agents:
        observations, *_ = env.step(dict.fromkeys(env.agents, np.array(1)))
        assert all(name.startswith("cav") for name in observations)
    alone, policy = make_small(control="policy", rsus=1), coopsim.make_policy("late_fusion", merge_iou=0.2)
    observations, _ = alone.reset(seed=3)
    policy.reset(alone.agent_specs, seed=3)
    while alone.agents:
        observations, *_ = alone.step(policy.act(observations))
    assert env.score().table() == alone.score().table()


def test_a_refused_maneuver_changes_nothing(make_small: Make) -> None:
    env, other = (Driving(make_small(control="policy", lidar=None)) for _ in range(2))
    with pytest.raises(EpisodeStateError, match="call reset"):
        env.step({})
    env.reset(seed=0)
    other.reset(seed=0)
    for wrong, says in (
        ({}, "one command for each"),
        (7, "got 7"),
        (dict.fromkeys(env.agents, 9), "maneuver must be"),
    ):
        with pytest.raises(InvalidActionError, match=says):
            env.step(wrong)
    for _ in range(4):
        chosen = dict.fromkeys(env.agents, 3)
        assert env.step(chosen)[1] == other.step(chosen)[1]


@pytest.mark.parametrize(
    ("wrap", "says"),
    [
        (lambda env: FixedSize(env, detection=3), "unknown option 'detection'"),
        (lambda env: FixedSize(env, detections="3"), "detections must be an integer >= 0"),
        (lambda env: BevImage(env, channels=("roads",)), "unknown channel 'roads'"),
        (lambda env: FixedSize(FixedSize(env)), "env has such a wrapper already: detections"),
        (lambda env: FixedSize(Flatten(BevImage(env))), "coopsim's own observations, which no wrapper changed"),
        (Flatten, "must be wrapped in FixedSize, DrivingRows or BevImage before Flatten"),
        (lambda env: FixedTracks(Driving(env)), "coopsim's own actions, which no wrapper changed"),
        (lambda env: Driving(FixedTracks(env)), "coopsim's own actions, which no wrapper changed"),
        (lambda env: Driving(env, tracker="late_fusionn"), "unknown policy 'late_fusionn'"),
        (lambda env: Driving(env, tracker=None), "tracker must be a policy or its name"),
        (lambda env: Driving(env, tracker="track_to_track"), "needs uplink 'tracks'"),
        (lambda env: Driving(FixedSize(env)), "coopsim's own observations, which no wrapper changed"),
        (lambda env: WithoutInfos(single(lidar=None)), "env must be parallel: TorchRL's GymWrapper takes"),
        (lambda env: WithoutInfos(None), "env must be an environment by coopsim.parallel_env"),
        (lambda env: FixedSize(None), "env must be an environment by coopsim.parallel_env"),
        (lambda env: Flatten(gymnasium.make("CartPole-v1")), "env must be an environment by coopsim.parallel_env"),
    ],
)
def test_what_does_not_fit_is_refused(make_small: Make, wrap: Make, says: str) -> None:
    with pytest.raises(CoopsimError, match=says):
        wrap(make_small(control="policy", lidar=None))


def test_driving_needs_drivers(make_small: Make) -> None:
    with pytest.raises(CoopsimError, match='with control="policy"'):
        Driving(make_small(lidar=None))
    with pytest.raises(CoopsimError, match="make a single-agent one with tracker"):
        Driving(single())


def test_errors_say_the_kind_of_space_and_its_keys(make_small: Make) -> None:
    env = make_small(lidar=None)
    with pytest.raises(CoopsimError, match=r"it has a Dict of time_ns, pose, .*, inbox_payload$"):
        Flatten(env)
    with pytest.raises(CoopsimError, match=r"which no wrapper changed, got a Box \(5, 8, 8\)$"):
        FixedSize(Flatten(BevImage(env, size=8, channels=("map",))))


@pytest.mark.parametrize("kind", ["observation_space", "action_space"])
@pytest.mark.parametrize(
    ("wrap", "known"),
    [
        (lambda env: env, "cav_0, cav_1, cav_2"),
        (FixedSize, "cav_0, cav_1, cav_2"),
        (FixedTracks, "cav_0, cav_1, cav_2"),
        (Driving, "cav_0, cav_1, cav_2"),
    ],
)
def test_an_unknown_agent_has_no_space(make_small: Make, wrap: Make, known: str, kind: str) -> None:
    env = wrap(make_small(control="policy", lidar=None))
    for wrong in ("cav9", None, ["cav_0"]):
        with pytest.raises(UnknownNameError, match=f"unknown agent .*Accepted: {known}"):
            getattr(env, kind)(wrong)


def test_actions_of_a_wrong_length_are_told_their_own(make_small: Make) -> None:
    """The lengths differ between agents that drive and agents that do not."""
    env = FixedTracks(make_small(control="policy", lidar=None, rsus=1), tracks=2)
    env.reset(seed=0)
    right = {agent: env.action_space(agent).sample() for agent in env.agents}
    for agent, given, wanted in (("cav_0", 40, 45), ("rsu_0", 45, 40)):
        with pytest.raises(InvalidActionError, match=rf"{agent}: action must have shape \({wanted},\), 2 rows of 20"):
            env.step(right | {agent: np.zeros(given)})
    env.step(right)


def test_gymnasium_makes_it_again() -> None:
    """Both environments of one spec play on their own: none has the other's messages or map."""

    def wrap(env: Any) -> Any:
        return Flatten(BevImage(FixedSize(FixedTracks(env, tracks=2), detections=5), size=8))

    first = wrap(gymnasium.make("coopsim/crossing-v3", **(SMALL | {"lidar": None, "max_cycles": 4} | DELAYED)))
    second, third = gymnasium.make(first.spec), gymnasium.make(first.spec)
    assert second.observation_space == first.observation_space and second.action_space == first.action_space
    action = np.zeros(first.action_space.shape, np.float32)
    alone = [first.reset(seed=3)[0], *(first.step(action)[0] for _ in range(3))]
    seen = [second.reset(seed=3)[0]]
    third.reset(seed=8)
    for _ in range(3):
        third.step(action)
        seen.append(second.step(action)[0])
    np.testing.assert_array_equal(seen, alone)
