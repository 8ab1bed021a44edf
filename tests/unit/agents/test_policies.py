"""Policies on hand-made observations: where boxes go, and what is left out."""

from __future__ import annotations

from dataclasses import fields, replace
from typing import Any

import numpy as np
import pytest
from small_env import SMALL

import coopsim
from coopsim.catalog import policies_on_boxes
from coopsim.comms.uplinks.uplink import UPLINKS
from coopsim.detection.simulated.simulated import SimulatedDetector
from coopsim.geometry.boxes import Boxes3D, covers
from coopsim.types import AgentSpec, Detections, Message, Observation, Odometry, PoseEstimate, Tracks
from coopsim.wire.actions import pack_tracks, unpack_action
from coopsim.wire.observation_format import ObservationFormat

CAR = [4.5, 1.9, 1.6]
LISTENING = [name for name in policies_on_boxes() if coopsim.make_policy(name).needs.uplink != "none"]


def detections(*rows: tuple[float, float, float], score: float = 0.9) -> Detections:
    array = np.array([[x, y, 0.8, *CAR, yaw] for x, y, yaw in rows]).reshape(-1, 7)
    return Detections(Boxes3D.from_array(array), np.full(len(array), score), np.zeros(len(array), dtype=int))


def message(sender: str, captured_ns: int, pose: list[float], found: Detections, uplink: str = "detections") -> Message:
    """What a sender broadcasts that detected this and nothing before."""
    seen = observe(found, pose=tuple(pose), time_ns=captured_ns)
    heard = UPLINKS.get(uplink)().message(sender, seen)
    assert heard is not None
    return heard


def observe(
    found: Detections, *inbox: Message, pose: tuple[float, ...] = (0, 0, 0, 0), time_ns: int = 0
) -> Observation:
    return Observation(time_ns, PoseEstimate(np.array(pose)), Odometry(np.zeros(4)), found, inbox=tuple(inbox))


def specs(*names: str, uplink: str = "detections") -> dict[str, AgentSpec]:
    return {name: AgentSpec(name, "cav", 0.1, uplink) for name in names}


def first_report(policy: coopsim.Policy, observation: Observation) -> Tracks:
    policy.reset(specs("cav_0", uplink=policy.needs.uplink))
    return policy.track("cav_0", observation)


@pytest.mark.parametrize("name", LISTENING)
def test_boxes_of_others_come_to_the_receivers_frame_by_both_estimates(name: str) -> None:
    # The receiver stands at (100, 0) and looks north; the sender at (100, 50) looks back south, and has a car
    # 20 m ahead: that is 30 m ahead of the receiver.
    policy = coopsim.make_policy(name)
    heard = message("cav_1", 0, [100, 50, 0, -np.pi / 2], detections((20, 1, 0)), policy.needs.uplink)
    found = first_report(policy, observe(detections(), heard, pose=(100, 0, 0, np.pi / 2)))
    np.testing.assert_allclose(found.boxes.center, [[30, -1, 0.8]], atol=1e-5)
    np.testing.assert_allclose(np.abs(found.boxes.yaw), [np.pi], atol=1e-6)


@pytest.mark.parametrize("name", [name for name in LISTENING if not name.startswith("graph_lap")])
def test_the_same_car_seen_by_both_is_one_car(name: str) -> None:
    policy = coopsim.make_policy(name)
    heard = message("cav_1", 0, [0, 0, 0, 0], detections((20, 0.3, 0), (40, 0, 0)), policy.needs.uplink)
    found = first_report(policy, observe(detections((20, 0, 0)), heard))
    assert sorted(found.boxes.center[:, 0].round().tolist()) == [20, 40]


def test_a_row_has_its_own_weights_and_the_parameters_of_its_base() -> None:
    from coopsim.agents.learned_fusion import LearnedFusion
    from coopsim.agents.maps import AttFusion, FCooperFusion

    names = [field.name for field in fields(LearnedFusion)]
    for row, name in ((AttFusion, "attfuse"), (FCooperFusion, "fcooper")):
        assert coopsim.POLICIES.get(name) is row and row.weights == name
        assert [field.name for field in fields(row)] == names
        assert {field.name: field.default for field in fields(row)}["weights"] == name
    assert LearnedFusion.weights == "pillars"


def test_which_boxes_cover_a_point() -> None:
    found = detections((0.8, 0.3, 0.1), (4, 0, 0), (0, 2.5, 0), (1.5, 0, np.pi / 2))
    assert covers(found.boxes, np.zeros(2)).tolist() == [True, False, False, False]
    assert covers(found.boxes, np.array([[9, 9], [4, 0], [0, 0], [1.5, 1.9]])).tolist() == [False, True, False, True]


def test_in_a_recording_the_boxes_of_the_frames_owner_come_first_whoever_receives() -> None:
    spec = AgentSpec("1", "cav", 0.1, "detections", is_object=False, frame_owner="ego")
    policy = coopsim.make_policy("sequential_kf", hits=1)
    positions = []
    for first, second in ((20, 21), (21, 20)):
        policy.reset({"1": spec})
        heard = message("ego", 0, [0, 0, 0, 0], detections((first, 0, 0)))
        positions.append(policy.track("1", observe(detections((second, 0, 0)), heard)).boxes.center[0, 0])
    # The later of two boxes draws a new track nearly to itself.
    assert positions[0] > 20.5 > positions[1]


@pytest.mark.parametrize("is_object", [True, False])
def test_the_receiver_is_not_its_own_object_where_it_was_at_capture(is_object: bool) -> None:
    policy = coopsim.make_policy("late_fusion")
    policy.reset({"cav_0": AgentSpec("cav_0", "cav", 0.1, "detections", is_object=is_object)})
    for k in range(4):  # 10 m a frame; the message that comes at last saw it at x = 10
        step = Odometry(np.array([10.0 if k else 0.0, 0, 0, 0]))
        heard = [message("rsu_0", 100_000_000, [0, 0, 0, 0], detections((10.2, 0, 0)))] if k == 3 else []
        pose = PoseEstimate(np.array([10.0 * k, 0, 0, 0]))
        observation = Observation(k * 100_000_000, pose, step, detections(), inbox=tuple(heard))
        tracks = policy.track("cav_0", observation)
    assert len(policy._states["cav_0"].tracks.tracker.state.tracked) == (0 if is_object else 1)
    assert len(tracks) == 0  # not confirmed yet


@pytest.mark.parametrize("name", policies_on_boxes())
def test_a_steady_car_gets_one_id_and_its_velocity(name: str) -> None:
    policy = coopsim.make_policy(name)
    policy.reset(specs("cav_0", uplink=policy.needs.uplink))
    ids = set()
    for k in range(20):
        tracks = policy.track("cav_0", observe(detections((10 + k, 0, 0)), time_ns=k * 100_000_000))
        ids |= set(tracks.id.tolist())
    assert len(ids) == 1
    np.testing.assert_allclose(tracks.velocity, [[10, 0]], atol=0.3)
    np.testing.assert_allclose(tracks.boxes.center, [[29, 0, 0.8]], atol=0.2)


def test_own_motion_is_not_the_objects_motion() -> None:
    policy = coopsim.make_policy("no_fusion")
    policy.reset(specs("cav_0"))
    for k in range(20):  # driving at 10 m/s and turning, past a car parked at (30, 5)
        yaw = 0.02 * k
        cos, sin = np.cos(yaw), np.sin(yaw)
        dx, dy = 30 - k, 5.0
        seen = detections((dx * cos + dy * sin, -dx * sin + dy * cos, -yaw))
        step = np.array([np.cos(yaw - 0.02), -np.sin(yaw - 0.02), 0, 0.02]) if k else np.zeros(4)
        observation = Observation(k * 100_000_000, PoseEstimate(np.zeros(4)), Odometry(step), seen)
        tracks = policy.track("cav_0", observation)
    assert len(tracks) == 1
    np.testing.assert_allclose(tracks.velocity, [[0, 0]], atol=0.05)
    np.testing.assert_allclose(tracks.boxes.center, seen.boxes.center, atol=0.02)


def test_renaming_and_permuting_agents_permutes_results() -> None:
    found = {"a": detections((10, 0, 0)), "b": detections((20, 3, 1), (40, 0, 0))}
    outputs = []
    for names in (("a", "b"), ("b", "a")):
        policy = coopsim.make_policy("no_fusion", hits=1)
        policy.reset(specs(*names))
        wire = ObservationFormat(names)
        packed = {name: wire.pack(observe(found[name])) for name in names}
        outputs.append(policy.act(packed))
    for name in found:
        np.testing.assert_array_equal(outputs[0][name]["tracks"]["box"], outputs[1][name]["tracks"]["box"])


def test_observations_survive_packing() -> None:
    names = ("cav_0", "cav_1", "rsu_0")
    inbox = (
        message("cav_1", 100, [1, 2, 0, 0.5], detections((1, 1, 0))),
        message("rsu_0", 200, [3, 4, 0, -0.5], detections()),
    )
    sent = observe(detections((7, 8, 0.2), (9, 9, 0)), *inbox, pose=(5, 6, 0, 1), time_ns=300)
    wire = ObservationFormat(names)
    got = wire.unpack(wire.pack(sent))
    assert got.time_ns == 300
    np.testing.assert_array_equal(got.pose.xyz_yaw, sent.pose.xyz_yaw)
    np.testing.assert_array_equal(got.detections.boxes.array, sent.detections.boxes.array)
    assert [(m.sender, m.captured_ns, m.payload, m.codec) for m in got.inbox] == [
        (m.sender, m.captured_ns, m.payload, m.codec) for m in inbox
    ]


def test_embeddings_survive_packing_as_directions() -> None:
    plain = ObservationFormat(("cav_0",))
    wire = replace(plain, embedding_dim=2)
    seen = replace(detections((7, 8, 0.2), (9, 9, 0)), embedding=[[30.0, 40.0], [np.nan, 1.0]])
    packed = wire.pack(observe(seen))
    assert wire.space("cav_0")["detections"].contains(packed["detections"])
    got = wire.unpack(packed).detections
    np.testing.assert_allclose(got.embedding, [[0.6, 0.8], [0, 0]], rtol=1e-6)
    blind = wire.pack(observe(detections((7, 8, 0.2))))
    np.testing.assert_array_equal(blind["detections"]["embedding"], [[0, 0]])
    with pytest.raises(coopsim.errors.InvalidValueError, match="embeddings of length 2, announced were 0"):
        plain.pack(observe(seen))


def test_a_detector_that_names_no_class_is_told_so_not_the_policy() -> None:
    wrong = replace(detections((7, 8, 0.2)), label=[99])
    with pytest.raises(coopsim.errors.InvalidValueError, match=r"detection labels must be in 0..8, got \[99\]"):
        ObservationFormat(("cav_0",)).pack(observe(wrong))


def test_covariances_of_detections_survive_packing() -> None:
    plain = ObservationFormat(("cav_0",))
    wire = replace(plain, detection_covariances=True)
    spread = np.stack([np.diag(np.arange(1.0, 8.0)), np.eye(7)])
    seen = replace(detections((7, 8, 0.2), (9, 9, 0)), covariance=spread)
    packed = wire.pack(observe(seen))
    space = wire.space("cav_0")["detections"]
    assert space.contains(packed["detections"])
    np.testing.assert_array_equal(wire.unpack(packed).detections.covariance, spread)
    for unsure in (detections((7, 8, 0.2)), detections()):
        packed = wire.pack(observe(unsure))
        assert space.contains(packed["detections"])
        assert wire.unpack(packed).detections.covariance is None
    with pytest.raises(coopsim.errors.InvalidValueError, match=r"have covariances.*Detector\.states_covariance"):
        plain.pack(observe(seen))


class Doubtful(SimulatedDetector):
    """States that every detection is worth little."""

    states_covariance = True

    def detect(self, view: Any, oracle: Any, rng: np.random.Generator) -> Detections:
        found = super().detect(view, oracle, rng)
        return replace(found, covariance=np.broadcast_to(100.0 * np.eye(7), (len(found), 7, 7)))


def test_a_detectors_doubt_reaches_the_tracker() -> None:
    options: dict[str, Any] = {"vehicles": 8, "max_cycles": 6, "lidar": None, "seed": 1}
    env = coopsim.parallel_env("crossing", vehicles=8, max_cycles=6, lidar=None, detector=Doubtful())
    observations, _ = env.reset(seed=1)
    for name, observation in observations.items():
        assert env.observation_space(name).contains(observation)
        assert len(observation["detections"]["covariance"]) == len(observation["detections"]["box"])
    sure = coopsim.evaluate("no_fusion", **options).score
    doubtful = coopsim.evaluate("no_fusion", **options, detector=Doubtful()).score
    assert repr(sure.values) != repr(doubtful.values)


class Recogniser(SimulatedDetector):
    """Tells all objects apart, as perfect embeddings would."""

    embedding_dim = 64

    def detect(self, view: Any, oracle: Any, rng: np.random.Generator) -> Detections:
        found, truth = super().detect(view, oracle, rng), oracle.actors
        apart_m = np.linalg.norm(found.boxes.center[:, None] - truth.boxes.center, axis=2)
        looks = np.array([np.random.default_rng(id_).normal(size=self.embedding_dim) for id_ in truth.id])
        return replace(found, embedding=looks[apart_m.argmin(axis=1)])


def test_embeddings_go_from_the_detector_to_the_tracker_and_over_the_air() -> None:
    env = coopsim.parallel_env("crossing", **(SMALL | {"detector": Recogniser()}), latency_s=0.1)
    policy = coopsim.make_policy("dino_codt_tracking")
    observations, _ = env.reset(seed=1)
    policy.reset(env.agent_specs, seed=1)
    while env.agents:
        for name, observation in observations.items():
            assert env.observation_space(name).contains(observation)
        observations, *_ = env.step(policy.act(observations))
    states = [policy._states[name].tracks.tracker.state for name in observations]  # type: ignore[attr-defined]
    memories = [each.tracked.appearance for state in states for each in state if len(each.tracked)]
    assert memories and all(memory.known.all() for memory in memories)
    plain = coopsim.evaluate("dino_codt_tracking", **SMALL, latency_s=0.1, seed=1).score["bytes_per_s"]
    assert env.score()["bytes_per_s"] > 2 * plain


def test_tracks_survive_packing() -> None:
    boxes = detections((1, 2, 0.3), (4, 5, 0.6)).boxes
    sent = Tracks(np.array([3, 9]), boxes, np.ones((2, 2)), np.array([0.5, 0.7]), np.array([0, 7]))
    got, command = unpack_action("cav_0", {"tracks": pack_tracks(sent)})
    assert command is None
    for name in ("id", "velocity", "score", "label"):
        np.testing.assert_array_equal(getattr(got, name), getattr(sent, name))
    np.testing.assert_array_equal(got.boxes.array, sent.boxes.array)
