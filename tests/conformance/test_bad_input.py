"""What is wrong is said by name, with what is accepted; and nothing is lost by it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import coopsim
from coopsim.errors import (
    EpisodeStateError,
    InvalidActionError,
    InvalidValueError,
    PolicyMismatchError,
    UnknownNameError,
)

Make = Callable[..., Any]


def tracks(count: int = 2, **change: Any) -> dict[str, Any]:
    box = np.tile([5.0, 0, 0.8, 4.5, 1.9, 1.6, 0], (count, 1))
    good = {
        "id": np.arange(count),
        "box": box,
        "velocity": np.zeros((count, 2)),
        "score": np.ones((count, 1)),
        "label": np.zeros(count, dtype=int),
    }
    return {"tracks": good | change}


BAD_ACTIONS = [
    (tracks(box=np.full((2, 7), np.nan)), "tracks must be finite"),
    (tracks(box=np.tile([0, 0, 0, 4, -1, 2, 0.0], (2, 1))), "sizes must be > 0"),
    (tracks(box=np.zeros((2, 6))), r"boxes must have shape \(N, 7\), got \(2, 6\)"),
    (tracks(id=np.array([4, 4])), r"unique within a frame, got \[4\]"),
    (tracks(id=np.array([4.5, 5])), "id must be integers"),
    (tracks(score=np.ones((3, 1))), "score must have shape"),
    (tracks(score=np.array([[0.1], [np.inf]])), "score must be finite"),
    (tracks(velocity=np.zeros((2, 3))), "velocity must have shape"),
    (tracks(label=np.array([0, 9])), r"labels must be in 0..8, got \[9\]"),
    (tracks(box="seven numbers"), "boxes must be numbers"),
    ({"tracks": {"id": []}}, "tracks are a dict with"),
    ({"boxes": []}, r"an action is a dict with \['tracks'\], got \['boxes'\]"),
    (None, "an action is a dict"),
    (tracks() | {"maneuver": 1}, "an action is a dict with"),
]


@pytest.mark.parametrize(("action", "match"), BAD_ACTIONS)
def test_a_bad_action_is_refused_and_changes_nothing(make_small: Make, action: Any, match: str) -> None:
    env, twin = make_small(), make_small()
    for each in (env, twin):
        each.reset(seed=0)
    good = {agent: tracks(0) for agent in env.agents}
    with pytest.raises(InvalidActionError, match=f"rsu_0: .*{match}"):
        env.step(good | {"rsu_0": action})
    after, expected = env.step(good), twin.step(good)
    np.testing.assert_array_equal(after[0]["cav_0"]["sweeps"]["lidar"], expected[0]["cav_0"]["sweeps"]["lidar"])
    assert after[1] == expected[1] and env.score()["FN"] == twin.score()["FN"]


def test_unknown_and_missing_agents(make_small: Make) -> None:
    env = make_small()
    env.reset(seed=0)
    good = {agent: tracks(0) for agent in env.agents}
    with pytest.raises(InvalidActionError, match=r"cav_0.*unknown: \['cav_9'\]"):
        env.step(good | {"cav_9": tracks(0)})
    good.pop("cav_1")
    with pytest.raises(InvalidActionError, match=r"missing: \['cav_1'\]"):
        env.step(good)
    with pytest.raises(InvalidActionError, match="actions are a dict by agent, got list"):
        env.step([])


@pytest.mark.parametrize("maneuver", [5, -1, 1.0, "left", None])
def test_bad_maneuver(make_small: Make, maneuver: Any) -> None:
    env = make_small(control="policy")
    env.reset(seed=0)
    actions = {agent: tracks(0) | ({"maneuver": 1} if agent != "rsu_0" else {}) for agent in env.agents}
    with pytest.raises(InvalidActionError, match="cav_0: maneuver must be one of 0 lane_left, 1 idle"):
        env.step(actions | {"cav_0": tracks(0) | {"maneuver": maneuver}})
    env.step(actions)


def test_calls_at_the_wrong_moment(make_small: Make) -> None:
    env = make_small(max_cycles=1)
    for call in (lambda: env.step({}), env.score, env.state, lambda: env.time_ns):
        with pytest.raises(EpisodeStateError, match="reset"):
            call()
    env.reset(seed=0)
    with pytest.raises(EpisodeStateError, match="nothing has been scored"):
        env.score()
    env.step({agent: tracks(0) for agent in env.agents})
    with pytest.raises(EpisodeStateError, match="the episode is over: call reset"):
        env.step({})
    assert env.score()["FN"] > 0
    with pytest.raises(EpisodeStateError, match=r"policy\.reset"):
        coopsim.make_policy("no_fusion").act({})


@pytest.mark.parametrize(
    ("option", "error", "match"),
    [
        ({"latency": 0.2}, UnknownNameError, "unknown option 'latency'. Did you mean .*latency_s"),
        ({"connected_car": 2}, UnknownNameError, "Did you mean 'connected_cars'"),
        ({"latency_s": -0.1}, InvalidValueError, "latency_s must be"),
        ({"latency_s": float("nan")}, InvalidValueError, "latency_s must be"),
        ({"latency_jitter_s": -1}, InvalidValueError, "latency_jitter_s must be"),
        ({"loss": 1.2}, InvalidValueError, r"loss must be in \[0, 1\]"),
        ({"communication_range_m": -5}, InvalidValueError, "communication_range_m must be >= 0"),
        ({"position_noise_m": -0.1}, InvalidValueError, "position_noise_m must be"),
        ({"heading_noise_rad": np.inf}, InvalidValueError, "heading_noise_rad must be"),
        ({"match_iou": 0}, InvalidValueError, r"match_iou must be in \(0, 1\]"),
        ({"max_cycles": 0}, InvalidValueError, "max_cycles must be an integer >= 1"),
        ({"dt_s": 0}, InvalidValueError, "dt_s must be a finite number > 0"),
        ({"uplink": "detection"}, UnknownNameError, "unknown uplink 'detection'. Did you mean 'detections'"),
        ({"control": "auto"}, UnknownNameError, "unknown control 'auto'.*policy, traffic"),
        ({"ground_truth": "seen"}, UnknownNameError, "unknown ground_truth 'seen'"),
        ({"false_positives": "skip"}, UnknownNameError, "unknown false_positives"),
        ({"render_mode": "ansi"}, UnknownNameError, "unknown render_mode 'ansi'"),
        ({"lidar": "HDL-32"}, UnknownNameError, "Did you mean 'HDL-32E'"),
        ({"lidar_columns": 0}, InvalidValueError, "columns"),
        ({"detector": "simulated"}, InvalidValueError, "detector must be a coopsim Detector or None"),
        ({"vehicles": -1}, InvalidValueError, "vehicles"),
        ({"connected_cars": 11, "vehicles": 10}, InvalidValueError, "connected_cars"),
        ({"pedestrians": -1}, InvalidValueError, "pedestrians"),
        ({"rsus": -1}, InvalidValueError, "rsus"),
        ({"connected_cars": 0, "rsus": 0}, InvalidValueError, "agent"),
    ],
)
def test_bad_options(option: dict[str, Any], error: type[Exception], match: str) -> None:
    with pytest.raises(error, match=match):
        coopsim.parallel_env("crossing", **option)


@pytest.mark.parametrize(
    ("call", "match"),
    [
        (
            lambda: coopsim.parallel_env("crosing"),
            "unknown environment 'crosing'. Did you mean 'crossing-v0'",
        ),
        (lambda: coopsim.parallel_env("crossing-v9"), "unknown environment 'crossing-v9'"),
        (
            lambda: coopsim.make_policy("late_fusoin"),
            "unknown policy 'late_fusoin'. Did you mean 'late_fusion'",
        ),
        (
            lambda: coopsim.make_policy("ab3dmot", hit=1),
            "unknown parameter of policy 'ab3dmot' 'hit'.*'hits'",
        ),
    ],
)
def test_unknown_names(call: Callable[[], Any], match: str) -> None:
    with pytest.raises(UnknownNameError, match=match):
        call()


@pytest.mark.parametrize("parameters", [{"hits": 0}, {"age": 0}, {"gate": float("nan")}, {"hits": 1.5}])
def test_bad_policy_parameters(parameters: dict[str, Any]) -> None:
    with pytest.raises(InvalidValueError, match=next(iter(parameters))):
        coopsim.make_policy("ab3dmot", **parameters)


@pytest.mark.parametrize("merge_iou", [0, -0.1, 1.5, float("nan")])
def test_bad_merge_threshold(merge_iou: float) -> None:
    with pytest.raises(InvalidValueError, match="iou"):
        coopsim.make_policy("late_fusion", merge_iou=merge_iou)


def test_a_policy_that_needs_another_uplink(make_small: Make) -> None:
    silent = make_small(uplink="none")
    with pytest.raises(PolicyMismatchError, match="LateFusion needs uplink 'detections', but cav_0 broadcasts 'none'"):
        coopsim.make_policy("late_fusion").reset(silent.agent_specs)
    coopsim.make_policy("no_fusion").reset(make_small().agent_specs)


@pytest.mark.parametrize("seed", [-1, 1.5, "x"])
def test_a_bad_seed_leaves_the_running_episode(make_small: Make, seed: Any) -> None:
    env = make_small()
    env.reset(seed=0)
    env.step({agent: tracks(0) for agent in env.agents})
    with pytest.raises(InvalidValueError, match="seed must be an integer >= 0"):
        env.reset(seed=seed)
    assert env.time_ns == 100_000_000


def test_an_unknown_reset_option_is_warned_about(make_small: Make) -> None:
    with pytest.warns(UserWarning, match="reset option 'sequense' is ignored; accepted: none"):
        make_small().reset(seed=0, options={"sequense": "0001"})
