"""What is wrong is said by name, with what is accepted; and nothing is lost by it."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pettingzoo
import pytest
from small_env import SMALL

import coopsim
from coopsim.detection.simulated.simulated import SimulatedDetector, SimulatedDetectorConfig
from coopsim.envs import MotaReward, Reward
from coopsim.errors import (
    CoopsimError,
    EpisodeStateError,
    InvalidActionError,
    InvalidValueError,
    PolicyMismatchError,
    UnknownNameError,
)
from coopsim.geometry.boxes import Boxes3D
from coopsim.types import Detections

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
    (tracks(box="seven numbers"), "track box must be numbers"),
    (tracks(box=np.ones((2, 7)) * 1j), "track box must be numbers, got complex128"),
    (tracks(velocity=np.zeros((2, 2), dtype=bool)), "track velocity must be numbers, got bool"),
    (tracks(score=np.array([["1.5"], ["1"]])), "track score must be numbers, got <U3"),
    (tracks(score=[[0.1], [0.2, 0.3]]), "track score must be numbers in rows of the same length"),
    (tracks(10_001), "may report at most 10000 tracks in a frame, got 10001"),
    (tracks(id=[[1], [2, 3]]), "track id must be integers in rows of the same length"),
    (tracks(label=[[0], [0, 1]]), "track label must be integers in rows of the same length"),
    (tracks(label=np.array([True, False])), "track label must be integers, got bool"),
    (tracks(id=np.array([1, 2**63], dtype=np.uint64)), r"track id must be in .*, got 9223372036854775808"),
    (tracks(id=np.array([-1, 2])), r"track id must be in 0\.\.\d+, got -1"),
    (tracks(id=[1, 2**62]), r"track id must be in 0\.\.4611686018427387903"),
    ({"tracks": {"id": []}}, "tracks are a dict with"),
    ({"boxes": []}, r"an action is a dict with \['tracks'\], got \['boxes'\]"),
    (None, "an action is a dict"),
    (tracks() | {"maneuver": 1}, "an action is a dict with"),
]


@pytest.fixture(scope="module")
def undisturbed() -> tuple[Any, Any]:
    """A small environment after its first step, and what this step returned."""
    twin = coopsim.parallel_env("crossing", **SMALL)
    twin.reset(seed=0)
    return twin, twin.step({agent: tracks(0) for agent in twin.agents})


@pytest.mark.parametrize(("action", "match"), BAD_ACTIONS)
def test_a_bad_action_is_refused_and_changes_nothing(
    make_small: Make, undisturbed: tuple[Any, Any], action: Any, match: str
) -> None:
    env, (twin, expected) = make_small(), undisturbed
    env.reset(seed=0)
    good = {agent: tracks(0) for agent in env.agents}
    with pytest.raises(InvalidActionError, match=f"rsu_0: .*{match}"):
        env.step(good | {"rsu_0": action})
    after = env.step(good)
    np.testing.assert_array_equal(after[0]["cav_0"]["sweeps"]["lidar"], expected[0]["cav_0"]["sweeps"]["lidar"])
    assert after[1] == expected[1] and env.score()["FN"] == twin.score()["FN"]


def test_scores_of_tracks_only_rank(make_small: Make) -> None:
    env, scores = make_small(), []
    for low, high in ((0.1, 0.2), (0.0, 1.0)):
        env.reset(seed=0)
        while env.agents:
            env.step({agent: tracks(score=np.array([[low], [high]])) for agent in env.agents})
        scores.append(env.score().to_dict())
    assert scores[0] == scores[1]


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


@pytest.mark.parametrize(
    ("label", "match"), [([4.5], "float64"), ([np.nan], "float64"), ([1e300], r"got 1e\+300"), ("1", "U1")]
)
def test_detections_of_ones_own_take_no_fraction_for_a_label(label: Any, match: str) -> None:
    box = Boxes3D.from_array(np.ones((1, 7)))
    assert Detections(box, [1], [2.0]).label.dtype == np.int64
    with pytest.raises(InvalidValueError, match=f"^label must be .*{match}"):
        Detections(box, [1], label)


def test_what_happens_to_an_action_later_does_not_change_what_was_reported(make_small: Make) -> None:
    env = make_small()
    env.reset(seed=0)
    actions = {agent: tracks() for agent in env.agents}
    env.step(actions)
    before = env.bev_frame().tracks["cav_0"]
    for column in actions["cav_0"]["tracks"].values():
        column += 1
    after = env.bev_frame().tracks["cav_0"]
    np.testing.assert_array_equal(after.boxes.array, before.boxes.array)
    np.testing.assert_array_equal(after.label, 0)


@pytest.mark.parametrize("maneuver", [5, -1, 1.0, True, "left", None])
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


class Flaky(SimulatedDetector, Reward):
    """Fails when told to."""

    fails = ""

    def detect(self, *args: Any) -> Detections:
        return 1 // 0 if self.fails == "detector" else super().detect(*args)  # type: ignore[return-value]

    def __call__(self, counts: object) -> float:
        return 1 // 0 if self.fails == "reward" else 0.0


@pytest.mark.parametrize("part", ["detector", "reward"])
def test_after_an_error_in_the_middle_only_reset_goes_on(make_small: Make, part: str) -> None:
    flaky = Flaky()
    env = make_small(detector=flaky, reward=flaky)

    def step() -> None:
        env.step({agent: tracks(0) for agent in env.possible_agents})

    def scored_frames() -> int:
        return len(env.logs["cav_0"])

    env.reset(seed=0)
    flaky.fails = part
    with pytest.raises(ZeroDivisionError):
        step()
    flaky.fails = ""
    for _ in range(2):
        with pytest.raises(EpisodeStateError, match="ended halfway in an error: call reset"):
            step()
    assert scored_frames() == 1
    env.reset(seed=0)
    step()
    assert scored_frames() == 1
    flaky.fails = "detector"
    with pytest.raises(ZeroDivisionError):
        env.reset(seed=1)
    with pytest.raises(EpisodeStateError, match="halfway"):
        step()


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
        ({"control": "auto"}, UnknownNameError, "unknown control 'auto'.*acceleration, planner, policy, steering"),
        ({"control": "planner", "planner": "idm"}, UnknownNameError, "unknown planner 'idm'. Did you mean 'idm_aeb'"),
        ({"control": "planner", "planner": "idm_aeb(gap_m=-1)"}, InvalidValueError, "gap_m must be"),
        ({"control": "planner", "planner": dict}, InvalidValueError, "planner must make a .*Planner, got {}"),
        ({"control": "planner", "planner": 7}, InvalidValueError, "planner must be a name.*, got 7"),
        (
            {"control": "planner", "traffic": "highway-env"},
            InvalidValueError,
            '"planner" needs traffic="arrays"',
        ),
        (
            {"control": "planner", "driven_agents": ["cav_9"]},
            UnknownNameError,
            "car in driven_agents 'cav_9'",
        ),
        (
            {"control": "planner", "driven_agents": ["rsu_0"]},
            UnknownNameError,
            "car in driven_agents 'rsu_0'",
        ),
        ({"control": "planner", "driven_agents": "cav_0"}, InvalidValueError, "driven_agents must be names"),
        ({"driven_agents": ["cav_0"]}, InvalidValueError, "driven_agents needs cars that agents drive.*acceleration"),
        ({"ends_on_crash": True}, InvalidValueError, "ends_on_crash needs cars that agents drive"),
        ({"control": "policy", "ends_on_crash": 1}, InvalidValueError, "ends_on_crash must be"),
        ({"ground_truth": "seen"}, UnknownNameError, "unknown ground_truth 'seen'"),
        ({"false_positives": "skip"}, UnknownNameError, "unknown false_positives"),
        ({"render_mode": "ansi"}, UnknownNameError, "unknown render_mode 'ansi'"),
        ({"lidar": "HDL-32"}, UnknownNameError, "Did you mean 'HDL-32E'"),
        ({"lidar": 16}, InvalidValueError, "^lidar must be a beam table, .*, or None; got 16"),
        ({"lidar_columns": 0}, InvalidValueError, r"^lidar_columns must be an integer in 1\.\.16384, got 0"),
        ({"lidar_range_m": 0.5}, InvalidValueError, "^lidar_range_m must be > 1 and <= 10000, got 0.5"),
        ({"reward": MotaReward}, InvalidValueError, r"^reward must be a coopsim Reward.*: write MotaReward\(\)"),
        ({"name": "x"}, UnknownNameError, "^unknown option 'name'"),
        ({"scenario": "highway"}, UnknownNameError, "^unknown option 'scenario'"),
        ({"detector": "simulatd"}, UnknownNameError, "unknown detector 'simulatd'. Did you mean 'simulated'"),
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
    with pytest.raises(error, match=match):
        pettingzoo.make("parallel", "coopsim/crossing-v3", **option)


BOTH = np.array(["none", "detections"])

WRONG_TYPES = {
    "cameras": ["no", "false", np.nan, [1], 1, None],
    "expose_ground_truth": ["no", 0],
    "communication_range_m": [None, "x", [1], True, np.nan],
    "latency_s": [None, "x", 1e300, 10**400, True],
    "latency_jitter_s": [1e300],
    "dt_s": ["x", 1e300, 1e-300],
    "lidar_columns": [True, 20_000, 1.5],
    "lidar_range_m": [None, np.inf],
    "uplink": [[1], {}, None, BOTH],
    "control": [[1], BOTH],
    "ground_truth": [BOTH],
    "false_positives": [{}, BOTH],
    "render_mode": [0, BOTH],
    "renderer": [None],
    "reward": [3, "x", {}, 0],
    "detector": [0, Flaky],
}


@pytest.mark.parametrize(
    ("option", "value"), [(name, value) for name, values in WRONG_TYPES.items() for value in values]
)
def test_a_wrong_type_is_refused_by_the_name_of_its_option(option: str, value: Any) -> None:
    with pytest.raises(CoopsimError, match=f"^(unknown )?{option} "):
        coopsim.parallel_env("crossing", **{option: value})


@pytest.mark.parametrize(
    ("call", "match"),
    [
        (
            lambda: coopsim.parallel_env("crosing"),
            "unknown environment 'crosing'. Did you mean 'crossing-v3'",
        ),
        (lambda: coopsim.parallel_env("crossing-v0"), "unknown environment 'crossing-v0'. Did you mean 'crossing-v3'"),
        (lambda: coopsim.parallel_env("crossing-v9"), "unknown environment 'crossing-v9'"),
        (lambda: coopsim.parallel_env(None), "unknown environment None"),
        (lambda: coopsim.parallel_env(3), "unknown environment 3"),
        (lambda: coopsim.parallel_env("replay", max_cycles=3), "unknown option 'max_cycles'.*detections.*path"),
        (lambda: coopsim.parallel_env("crossing", rewards=None), "unknown option 'rewards'. Did you mean 'reward'"),
        (lambda: coopsim.make_policy([1]), r"unknown policy \[1\]"),
        (lambda: coopsim.parallel_env(""), "unknown environment ''. Accepted: .*crossing-v"),
        (lambda: coopsim.make_policy("ab3dmot", delayed=BOTH), "unknown delayed"),
        (
            lambda: coopsim.make_policy("track_to_track", delayed="replay"),
            "unknown delayed 'replay'.*as_current, predict",
        ),
        (lambda: coopsim.make_policy("late_fusion", delay="replay"), "'delay' of policy .*Did you mean 'delayed'"),
        (lambda: coopsim.make_policy("late_fusion", merge="max"), "unknown merge 'max'.*mean, nms"),
        (lambda: coopsim.make_policy("yolo"), "Did you mean 'yoloo'"),
        (lambda: coopsim.make_policy("dino_codt_track"), "Did you mean 'dino_codt_tracking'"),
        (lambda: coopsim.make_policy("vic_fscm"), "Did you mean 'vic_fscm_association'"),
        (lambda: coopsim.make_policy("dino_codt_tracking", motion="ctra"), "unknown motion 'ctra'.*section_4b"),
        (lambda: coopsim.make_policy("ab3dmot", name="x"), "unknown parameter 'name' of policy 'ab3dmot'"),
        (
            lambda: coopsim.make_policy("late_fusoin"),
            "unknown policy 'late_fusoin'. Did you mean 'late_fusion'",
        ),
        (
            lambda: coopsim.make_policy("ab3dmot", hit=1),
            "unknown parameter 'hit' of policy 'ab3dmot'.*'hits'",
        ),
    ],
)
def test_unknown_names(call: Callable[[], Any], match: str) -> None:
    with pytest.raises(UnknownNameError, match=match):
        call()


@pytest.mark.parametrize(
    ("policies", "parameter", "values"),
    [
        ("ab3dmot", "hits", [0, 1.5]),
        ("ab3dmot", "age", [0]),
        ("ab3dmot late_fusion graph_lap_tsa", "gate", [None, "x", [1], True, 5, -2, np.nan]),
        ("vic_fscm_association", "gate", [None, True, -0.1, 1.1]),
        ("dino_codt_tracking", "gate", ["x", 0, 1.1]),
        ("dino_codt_tracking", "gate", [-0.2]),
        ("dino_codt_tracking", "by_superclass", [1, "no"]),
        ("vic_fscm_association", "score_decay", [-0.1, 1.1, None]),
        ("graph_lap_tsa", "matched_only", [0, None]),
        ("vic_fscm_association", "detection_score", [None, np.inf]),
        ("vic_fscm_association", "track_score", [True, np.nan]),
        ("graph_lap_aos", "one_per_object", ["no", 1]),
        ("late_fusion yoloo_geometry", "merge_iou", [0, -0.1, 1.5, np.nan]),
        ("track_to_track", "hits", [0, True]),
        ("track_to_track", "gate", [None, -2]),
        ("track_to_track", "fuse_gate", ["x", 2, np.nan]),
        ("track_to_track", "valid_s", [0, -1, 11, np.inf, None]),
        ("track_to_track", "position_noise_m", [-0.1, np.inf, 1e200, "x"]),
        ("track_to_track", "heading_noise_rad", [-0.1, np.nan]),
    ],
)
def test_bad_policy_parameters(policies: str, parameter: str, values: list[Any]) -> None:
    for policy, value in itertools.product(policies.split(), values):
        with pytest.raises(InvalidValueError, match=f"^{parameter} must be"):
            coopsim.make_policy(policy, **{parameter: value})


def test_parameters_of_ones_own_policies(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(coopsim.POLICIES._entries, "anything", lambda **parameters: parameters)
    monkeypatch.setitem(coopsim.POLICIES._entries, "needy", lambda gate: gate)
    assert coopsim.make_policy("anything", name=1, x=2) == {"name": 1, "x": 2}
    with pytest.raises(InvalidValueError, match="policy 'needy': missing a required argument: 'gate'"):
        coopsim.make_policy("needy")


@pytest.mark.parametrize("tracked", [None, {}, tracks()])
def test_a_policy_that_reports_no_tracks_is_named(make_small: Make, tracked: Any) -> None:
    class Careless(coopsim.Policy):
        def track(self, agent: str, observation: Any) -> Any:
            return tracked

    env, policy = make_small(), Careless()
    observations, _ = env.reset(seed=0)
    policy.reset(env.agent_specs)
    with pytest.raises(InvalidActionError, match=r"Careless\.track must return Tracks, got .* for cav_0"):
        policy.act(observations)
    with pytest.raises(UnknownNameError, match=r"unknown agent 'cav_9'.*cav_0"):
        policy.act({"cav_9": observations["cav_0"]})


@pytest.mark.parametrize(
    ("make", "match"),
    [
        (lambda: SimulatedDetectorConfig(score_offset="x"), "score_offset must be a finite number, got 'x'"),
        (lambda: SimulatedDetectorConfig(false_positive_logit=None), "false_positive_logit must be a finite"),
        (lambda: SimulatedDetectorConfig(false_positives=1e300), "false_positives must be in"),
        (lambda: SimulatedDetector("x"), "config must be a coopsim SimulatedDetectorConfig or None"),
        (lambda: SimulatedDetector(SimulatedDetectorConfig), r"write SimulatedDetectorConfig\(\)"),
        (lambda: SimulatedDetector({}), "config must be"),
    ],
)
def test_bad_detectors(make: Callable[[], Any], match: str) -> None:
    with pytest.raises(InvalidValueError, match=match):
        make()


@pytest.mark.parametrize("given", ["path", "detections", ""])
def test_a_replay_needs_a_path_and_detections(recordings: Path, given: str) -> None:
    good = {"path": recordings, "detections": ("ego",)}
    with pytest.raises(CoopsimError, match="detections" if given == "path" else "path"):
        coopsim.parallel_env("replay", **{name: value for name, value in good.items() if name == given})


def test_a_policy_that_needs_another_uplink(make_small: Make) -> None:
    silent = make_small(uplink="none")
    with pytest.raises(PolicyMismatchError, match="LateFusion needs uplink 'detections', but cav_0 broadcasts 'none'"):
        coopsim.make_policy("late_fusion").reset(silent.agent_specs)
    with pytest.raises(PolicyMismatchError, match=r"TrackToTrack needs uplink 'tracks', but .* 'detections'"):
        coopsim.make_policy("track_to_track").reset(make_small().agent_specs)
    coopsim.make_policy("no_fusion").reset(make_small().agent_specs)


@pytest.mark.parametrize("seed", [-1, 1.5, "x"])
def test_a_bad_seed_leaves_the_running_episode(make_small: Make, seed: Any) -> None:
    env = make_small()
    env.reset(seed=0)
    env.step({agent: tracks(0) for agent in env.agents})
    with pytest.raises(InvalidValueError, match="seed must be an integer >= 0"):
        env.reset(seed=seed)
    assert env.time_ns == 100_000_000


@pytest.mark.parametrize("options", [[1], [], "abc", 0, {"sequence": "0009"}, {"sequence": None}, {"sequence": "0001"}])
def test_bad_reset_options_leave_the_running_episode(recordings: Path, options: Any) -> None:
    env = coopsim.parallel_env("replay", path=recordings, detections=("ego",))
    env.reset(seed=0)
    env.step({"ego": tracks(0)})
    (recordings / "detections" / "ego" / "0001.txt").write_text("nonsense")
    with pytest.raises(CoopsimError, match=r"reset options must be a dict or None|unknown sequence|0001.txt"):
        env.reset(seed=1, options=options)
    env.step({"ego": tracks(0)})
    assert len(env.logs["ego"]) == 2


def test_an_unknown_reset_option_is_warned_about(make_small: Make) -> None:
    with pytest.warns(UserWarning, match="reset option 'sequense' is ignored; accepted: none"):
        make_small().reset(seed=0, options={"sequense": "0001"})
