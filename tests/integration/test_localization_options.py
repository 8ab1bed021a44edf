"""Localization as an option: one for all, or one by agent; the simple options are a short form of it."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import coopsim
from coopsim.comms.channel import ChannelConfig
from coopsim.comms.clock import AgentClock
from coopsim.envs.spaces import unpack_observation
from coopsim.errors import InvalidValueError, UnknownNameError
from coopsim.localization import LocalizationConfig
from coopsim.pose_noise import PoseNoise

Make = Callable[..., Any]


def poses(env: Any) -> dict[str, np.ndarray]:
    return {name: seen["pose"] for name, seen in env.reset(seed=5)[0].items()}


def test_one_for_all_is_what_the_simple_options_say(make_small: Make) -> None:
    simple = poses(make_small(lidar=None, position_noise_m=0.3, heading_noise_rad=0.01))
    whole = poses(make_small(lidar=None, localization=LocalizationConfig(PoseNoise(0.3, 0.01))))
    for name, pose in simple.items():
        np.testing.assert_array_equal(pose, whole[name])


def test_one_by_agent_leaves_the_others_alone(make_small: Make) -> None:
    noisy = LocalizationConfig(PoseNoise(position_bias_m=1.0, correlation_s=2.0))
    truth = poses(make_small(lidar=None))
    got = poses(make_small(lidar=None, localization={"cav_1": noisy}))
    assert {name for name in truth if not np.array_equal(truth[name], got[name])} == {"cav_1"}


def test_a_stated_covariance_reaches_who_hears_it(make_small: Make) -> None:
    honest = LocalizationConfig(PoseNoise(0.3, 0.01), covariance_scale=1.0)
    env = make_small(lidar=None, localization={"cav_1": honest})
    observations, _ = env.reset(seed=5)
    seen = {
        name: unpack_observation(packed, env.possible_agents, env.agent_specs[name])
        for name, packed in observations.items()
    }
    wanted = np.diag([0.09, 0.09, 0.0001])
    assert seen["cav_0"].pose.covariance is None
    np.testing.assert_allclose(seen["cav_1"].pose.covariance, wanted)
    for name, packed in observations.items():
        assert env.observation_space(name).contains(packed)
        for message in seen[name].inbox:
            if message.sender == "cav_1":
                np.testing.assert_allclose(message.pose.covariance, wanted, rtol=1e-6)
            else:
                assert message.pose.covariance is None
    assert any(message.sender == "cav_1" for message in seen["cav_0"].inbox)


def test_every_error_at_once_runs_and_is_the_same_again() -> None:
    noise = PoseNoise(0.2, 0.01, "laplace", 1.0, 0.3, 0.01, 1.0, 0.5, 0.5, 0.5)
    options: dict[str, Any] = {"vehicles": 10, "lidar": None, "max_cycles": 8}
    options["localization"] = LocalizationConfig(noise, odometry_scale=0.01, odometry_drift_rad_s=0.001)
    first, second = (coopsim.evaluate("late_fusion", "crossing", seed=2, **options) for _ in range(2))
    assert repr(first.score.values) == repr(second.score.values)


@pytest.mark.parametrize(
    ("options", "error", "match"),
    [
        (
            {"localization": 0.5},
            InvalidValueError,
            "localization must be a coopsim LocalizationConfig or None, got 0.5",
        ),
        ({"localization": {"cav_0": 0.5}}, InvalidValueError, "localization of cav_0 must be a LocalizationConfig"),
        ({"localization": {"cav_9": LocalizationConfig()}}, UnknownNameError, "unknown agent in localization 'cav_9'"),
        (
            {"localization": LocalizationConfig(), "position_noise_m": 0.1},
            InvalidValueError,
            "position_noise_m is not an option beside localization",
        ),
        ({"channel": ChannelConfig(clocks={"car": AgentClock(5)})}, UnknownNameError, "unknown agent in clocks 'car'"),
    ],
)
def test_a_bad_localization_is_refused_by_name(options: dict, error: type[Exception], match: str) -> None:  # type: ignore[type-arg]
    with pytest.raises(error, match=match):
        coopsim.parallel_env("crossing", lidar=None, **options)
