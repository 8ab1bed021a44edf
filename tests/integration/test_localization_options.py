"""Localization as an option: one for all, or one by agent; the simple options are a short form of it."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import coopsim
from coopsim.comms.channel.channel import ChannelConfig
from coopsim.comms.channel.channel_config import AgentClock
from coopsim.errors import InvalidValueError, ScenarioFileError, UnknownNameError
from coopsim.localization.localizer import LocalizationConfig, localization_config
from coopsim.localization.pose_noise import PoseNoise
from coopsim.wire.observation_format import ObservationFormat

Make = Callable[..., Any]


def poses(env: Any) -> dict[str, np.ndarray]:
    return {name: seen["pose"] for name, seen in env.reset(seed=5)[0].items()}


def test_one_for_all_is_what_the_simple_options_say(make_small: Make) -> None:
    simple = poses(make_small(lidar=None, position_noise_m=0.3, heading_noise_rad=0.01))
    whole = poses(make_small(lidar=None, localization=LocalizationConfig(PoseNoise(0.3, 0.01))))
    assert len(simple) > 1
    for name, pose in simple.items():
        np.testing.assert_array_equal(pose, whole[name])


def test_one_without_errors_of_the_pose_leaves_the_simple_options(make_small: Make) -> None:
    """So that a benchmark may vary the errors that agents state."""
    simple = poses(make_small(lidar=None, position_noise_m=0.3, heading_noise_rad=0.01))
    env = make_small(lidar=None, position_noise_m=0.3, heading_noise_rad=0.01, localization={"covariance_scale": 1.0})
    unpack = ObservationFormat.to_unpack(env.agent_specs).unpack
    for name, packed in env.reset(seed=5)[0].items():
        np.testing.assert_array_equal(packed["pose"], simple[name])
        np.testing.assert_allclose(unpack(packed).pose.covariance, np.diag([0.09, 0.09, 0.0001]))


def test_one_by_agent_leaves_the_others_alone(make_small: Make) -> None:
    noisy = LocalizationConfig(PoseNoise(position_bias_m=1.0, correlation_s=2.0))
    truth = poses(make_small(lidar=None))
    got = poses(make_small(lidar=None, localization={"cav_1": noisy}))
    assert {name for name in truth if not np.array_equal(truth[name], got[name])} == {"cav_1"}


WRITTEN = """
cav_0: {pose: {position_noise_m: 0.5, distribution: laplace, correlation_s: 10}, odometry_scale: 0.01}
rsu_0: {pose: {position_bias_m: 0.1}, covariance_scale: 0.5}
"""


def test_a_written_localization_is_the_one_that_is_built(tmp_path: Path) -> None:
    path = tmp_path / "localization.yaml"
    path.write_text(WRITTEN)
    urban = LocalizationConfig(PoseNoise(0.5, distribution="laplace", correlation_s=10), odometry_scale=0.01)
    built = {"cav_0": urban, "rsu_0": LocalizationConfig(PoseNoise(position_bias_m=0.1), covariance_scale=0.5)}
    assert localization_config(path) == localization_config(str(path)) == localization_config(built) == built
    assert localization_config({"pose": {"position_noise_m": 0.3}}) == LocalizationConfig(PoseNoise(0.3))
    assert localization_config({"pose": PoseNoise(0.3)}) == LocalizationConfig(PoseNoise(0.3))


def test_a_scenario_file_has_localization_and_channel(tmp_path: Path) -> None:
    path = tmp_path / "degraded.yaml"
    path.write_text(
        "scenario: crossing\noptions:\n  lidar: null\n  max_cycles: 5\n"
        "  localization: {cav_0: {pose: {position_bias_m: 2.0}}}\n"
        '  channel: {links: {"cav_1 > *": {latency: {model: gaussian, mean_s: 0.2}}}}\n'
    )
    env = coopsim.parallel_env(path)
    observations, _ = env.reset(seed=5)
    truth = poses(coopsim.parallel_env("crossing", lidar=None))
    assert {name for name in truth if not np.array_equal(truth[name], observations[name]["pose"])} == {"cav_0"}
    assert {link for link, counts in env.link_counts.items() if counts.pending} == {
        ("cav_1", other) for other in env.possible_agents if other != "cav_1"
    }
    path.write_text(path.read_text().replace("position_bias_m", "position_bais_m"))
    with pytest.raises(ScenarioFileError, match=r"degraded.yaml:5: unknown localization of cav_0 pose option"):
        coopsim.parallel_env(path)
    path.write_text(path.read_text().replace("bais", "bias").replace("mean_s", "mean"))
    with pytest.raises(ScenarioFileError, match=r"degraded.yaml:6: unknown channel link cav_1 > \* latency option"):
        coopsim.parallel_env(path)


def test_a_stated_covariance_reaches_who_hears_it(make_small: Make) -> None:
    honest = LocalizationConfig(PoseNoise(0.3, 0.01), covariance_scale=1.0)
    env = make_small(lidar=None, localization={"cav_1": honest})
    observations, _ = env.reset(seed=5)
    unpack = ObservationFormat.to_unpack(env.agent_specs).unpack
    seen = {name: unpack(packed) for name, packed in observations.items()}
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
            "localization must be a LocalizationConfig, a mapping or the path of a YAML file, got 0.5",
        ),
        ({"localization": {"cav_0": 0.5}}, InvalidValueError, "localization of cav_0 must be a mapping, got 0.5"),
        ({"localization": "nowhere.yaml"}, InvalidValueError, "localization: cannot read nowhere.yaml"),
        ({"localization": {}}, InvalidValueError, "localization has nothing in it"),
        ({"localization": {"poze": {}}}, UnknownNameError, "unknown localization option 'poze'. Did you mean 'pose'"),
        ({"localization": {"pose": 0.3}}, InvalidValueError, "localization pose must be a mapping, got 0.3"),
        ({"localization": {"pose": None}}, InvalidValueError, "pose must be a coopsim PoseNoise, got None"),
        (
            {"localization": {"pose": {"position_noise": 1}}},
            UnknownNameError,
            "unknown localization pose option 'position_noise'. Did you mean 'position_noise_m'",
        ),
        (
            {"localization": {"pose": {"distribution": "laplas"}}},
            UnknownNameError,
            "unknown localization pose distribution 'laplas'. Did you mean 'laplace'",
        ),
        (
            {"localization": {"pose": {"jump_m": 1.0}}},
            InvalidValueError,
            "localization pose: jump_m and jumps_per_s must be both 0 or both > 0",
        ),
        (
            {"localization": {"cav_0": {"pose": {"correlation_s": -1}}}},
            InvalidValueError,
            "localization of cav_0 pose: correlation_s must be a finite number >= 0, got -1",
        ),
        (
            {"localization": {"cav_0": {"odometry_noise_m": "1e-3"}}},
            InvalidValueError,
            r"localization of cav_0: odometry_noise_m must be .* got '1e-3' \('1e-3' is a text in YAML",
        ),
        ({"localization": {"cav_0": {}, "pose": {}}}, UnknownNameError, "unknown agent in localization 'pose'"),
        ({"localization": {"cav_9": LocalizationConfig()}}, UnknownNameError, "unknown agent in localization 'cav_9'"),
        (
            {"localization": LocalizationConfig(PoseNoise(jump_m=1, jumps_per_s=1)), "position_noise_m": 0.1},
            InvalidValueError,
            "position_noise_m cannot be combined with localization",
        ),
        (
            {"localization": LocalizationConfig(), "odometry_noise_m": 0.1},
            InvalidValueError,
            "odometry_noise_m cannot be combined with localization",
        ),
        ({"channel": ChannelConfig(clocks={"car": AgentClock(5)})}, UnknownNameError, "unknown agent in clocks 'car'"),
    ],
)
def test_a_bad_localization_is_refused_by_name(options: dict, error: type[Exception], match: str) -> None:  # type: ignore[type-arg]
    with pytest.raises(error, match=match):
        coopsim.parallel_env("crossing", lidar=None, **options)
