"""Track-to-track fusion over many frames: ids, gaps, latency, and nothing counted twice."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import coopsim
from coopsim.agents.track_to_track import TrackToTrack
from coopsim.comms.uplinks.share_tracks import ShareTracks
from coopsim.geometry.boxes import Boxes3D
from coopsim.types import AgentSpec, Detections, Message, Observation, Odometry, PoseEstimate, Tracks

FRAME_NS = 100_000_000
NOWHERE = np.zeros(4)


def detections(*xs: float, score: float = 0.8, y: float = 0.0) -> Detections:
    array = np.array([[x, y, 0.8, 4.5, 1.9, 1.6, 0.0] for x in xs]).reshape(-1, 7)
    return Detections(Boxes3D.from_array(array), np.full(len(array), score), np.zeros(len(array), dtype=int))


def observe(frame: int, found: Detections, *inbox: Message, motion_m: float = 0.0) -> Observation:
    step = Odometry(np.array([motion_m, 0, 0, 0]))
    return Observation(frame * FRAME_NS, PoseEstimate(NOWHERE), step, found, inbox=inbox)


class Sender:
    """Another agent, which stands at the world's origin."""

    def __init__(self, name: str) -> None:
        self.name, self._uplink = name, ShareTracks()

    def says(self, frame: int, *xs: float) -> Message:
        return self._uplink.message(self.name, observe(frame, detections(*xs)))


def begin(*, is_object: bool = False, **settings: Any) -> TrackToTrack:
    policy = TrackToTrack(**settings)
    policy.reset({"cav_0": AgentSpec("cav_0", "cav", 0.1, "tracks", is_object=is_object)})
    return policy


def x_of(tracks: Tracks) -> list[float]:
    return sorted(tracks.boxes.center[:, 0].tolist())


def test_an_object_keeps_its_id_from_one_agent_to_the_next() -> None:
    """Seen by one agent after another, overlapping for a few frames; in between by nobody for one frame."""
    policy, names = begin(), ["rsu_0", "cav_1"]
    senders, ids = [Sender(name) for name in names], []
    seen_by = [range(8), range(6, 20), range(16, 30)]  # the receiver, then the two others
    for frame in range(30):
        x = 1.0 * frame
        own, *others = ([x] if frame in frames and frame != 12 else [] for frames in seen_by)
        heard = [sender.says(frame, *xs) for sender, xs in zip(senders, others, strict=True)]
        ids.append(policy.track("cav_0", observe(frame, detections(*own), *heard)).id.tolist())
    assert ids == [[1]] * 30


@pytest.mark.parametrize("late", ["predict", "as_current"])
def test_latency_is_bridged_by_the_velocity_only_where_asked(late: str) -> None:
    policy, sender, delay = begin(delayed=late), Sender("rsu_0"), 3
    sent = [sender.says(frame, 1.2 * frame) for frame in range(20)]
    for frame in range(delay, 20):
        tracks = policy.track("cav_0", observe(frame, detections(), sent[frame - delay]))
    expected = 1.2 * (19 if late == "predict" else 19 - delay)
    np.testing.assert_allclose(x_of(tracks), [expected], atol=0.15)


def test_a_lost_message_leaves_no_gap_and_fades() -> None:
    policy, sender = begin(valid_s=0.5), Sender("rsu_0")
    for frame in range(10):
        shown = policy.track("cav_0", observe(frame, detections(), sender.says(frame, 1.0 * frame)))
    reports = [policy.track("cav_0", observe(frame, detections())) for frame in range(10, 16)]
    assert [len(report) for report in reports] == [1, 1, 1, 1, 0, 0]
    np.testing.assert_allclose(
        [report.score[0] for report in reports[:4]], 0.8 * np.array([0.8, 0.6, 0.4, 0.2]), atol=1e-6
    )
    np.testing.assert_allclose([report.boxes.center[0, 0] for report in reports[:4]], [10, 11, 12, 13], atol=0.2)
    assert {*shown.id, *reports[3].id} == {1}


def test_a_message_twice_or_overtaken_changes_nothing() -> None:
    def run(disturbed: bool) -> list[Tracks]:
        policy, sender = begin(), Sender("rsu_0")
        sent = [sender.says(frame, 1.0 * frame) for frame in range(12)]
        shown = []
        for frame in range(12):
            more = [sent[frame], sent[max(frame - 2, 0)]] if disturbed else []
            shown.append(policy.track("cav_0", observe(frame, detections(40.0), sent[frame], *more)))
        return shown

    undisturbed = run(False)
    assert any(len(tracks) for tracks in undisturbed)
    for plain, disturbed in zip(undisturbed, run(True), strict=True):
        np.testing.assert_array_equal(plain.boxes.array, disturbed.boxes.array)
        np.testing.assert_array_equal(plain.id, disturbed.id)


def test_a_message_from_the_future_silences_nobody() -> None:
    policy, sender = begin(), Sender("rsu_0")
    ahead = Sender("rsu_0").says(10_000, 5.0)
    policy.track("cav_0", observe(0, detections(), ahead))
    for frame in range(1, 5):
        tracks = policy.track("cav_0", observe(frame, detections(), sender.says(frame, 30.0)))
    np.testing.assert_allclose(x_of(tracks), [30.0], atol=1e-3)


def test_what_others_say_changes_neither_the_own_tracker_nor_what_is_broadcast() -> None:
    """Nothing is fed back: a track that only others have vanishes with their messages, and covariances never shrink."""
    alone, fused, sender = begin(), begin(), Sender("rsu_0")
    for frame in range(12):
        own = detections(1.0 * frame)
        alone.track("cav_0", observe(frame, own))
        fused.track("cav_0", observe(frame, own, sender.says(frame, 1.0 * frame + 0.4, 50.0)))
    states = [policy._own._steps.state("cav_0")._tracker.state.tracked for policy in (alone, fused)]
    np.testing.assert_array_equal(states[0].beliefs.mean, states[1].beliefs.mean)
    np.testing.assert_array_equal(states[0].beliefs.covariance, states[1].beliefs.covariance)


@pytest.mark.parametrize("is_object", [True, False])
def test_the_receiver_is_not_its_own_object_where_it_was_at_capture(is_object: bool) -> None:
    policy, sender = begin(is_object=is_object), Sender("rsu_0")
    for frame in range(6):  # 10 m a frame; what comes last was seen three frames ago, at x = 20
        heard = [sender.says(2, 20.2)] if frame == 5 else []
        pose = PoseEstimate(np.array([10.0 * frame, 0, 0, 0]))
        motion = Odometry(np.array([10.0 if frame else 0.0, 0, 0, 0]))
        observation = Observation(frame * FRAME_NS, pose, motion, detections(), inbox=tuple(heard))
        tracks = policy.track("cav_0", observation)
    assert len(tracks) == (0 if is_object else 1)


def test_the_own_track_stands_where_the_poses_are_doubtful() -> None:
    offset_m = 0.8
    for position_noise_m, expected in ((0.0, offset_m / 2), (0.5, 0.0)):
        policy, sender = begin(position_noise_m=position_noise_m, heading_noise_rad=0.0), Sender("rsu_0")
        for frame in range(10):
            heard = sender.says(frame, 20.0 + offset_m)
            tracks = policy.track("cav_0", observe(frame, detections(20.0), heard))
        np.testing.assert_allclose(x_of(tracks), [20.0 + expected], atol=0.02)


def test_any_number_of_agents_in_any_order_of_arrival() -> None:
    names = [f"cav_{k}" for k in range(1, 7)]
    shown = []
    for order in (names, names[::-1]):
        policy, senders = begin(), {name: Sender(name) for name in names}
        for frame in range(5):
            heard = [senders[name].says(frame, 20.0, 30.0 + 10 * names.index(name)) for name in order]
            tracks = policy.track("cav_0", observe(frame, detections(20.0), *heard))
        shown.append(tracks)
    assert len(shown[0]) == 1 + len(names)
    np.testing.assert_array_equal(shown[0].id, shown[1].id)
    np.testing.assert_array_equal(shown[0].boxes.array, shown[1].boxes.array)


def test_memory_stays_over_many_frames_with_ever_new_objects() -> None:
    policy, sender = begin(valid_s=0.3), Sender("rsu_0")
    sizes = []
    for frame in range(600):
        x = 30.0 + 20 * (frame // 7 % 5)  # a new object every seven frames, for either agent
        policy.track("cav_0", observe(frame, detections(x), sender.says(frame, x + 200)))
        state = policy._states["cav_0"]
        sizes.append((len(state.ids), len(state.received), len(state.frame._path)))
    settled = np.array(sizes[150:])  # two in 0.7 s, remembered for 10 s
    np.testing.assert_array_equal(settled.max(axis=0), [32, 1, 21])
    assert int(policy.track("cav_0", observe(600, detections(x))).id.max()) > 100


def test_what_a_detector_says_too_large_for_a_message_is_left_out_of_it() -> None:
    sender = ShareTracks()
    message = sender.message("rsu_0", observe(0, detections(10.0, 1e60)))
    assert len(message.payload) == 2 + 85


@pytest.mark.parametrize("x", [2e4, 1e30, -1e200, 1e308])
def test_a_sender_that_believes_itself_anywhere_adds_nothing(x: float) -> None:
    policy, sender = begin(), Sender("rsu_0")
    for frame in range(5):
        heard = replace(sender.says(frame, 20.0), pose=PoseEstimate(np.array([x, -x, 0, 1.0])))
        tracks = policy.track("cav_0", observe(frame, detections(10.0), heard))
    assert x_of(tracks) == pytest.approx([10.0])


@pytest.mark.parametrize("environment", ["crossing", "highway"])
def test_it_runs_wherever_agents_are(environment: str) -> None:
    result = coopsim.evaluate(
        "track_to_track", environment, max_cycles=8, vehicles=10, lidar_columns=256, latency_s=0.15, loss=0.3, rsus=2
    )
    assert result.score["bytes_per_s"] > 0 and np.isfinite(result.score["MOTA"])


def test_it_runs_on_recordings(recordings: Path) -> None:
    result = coopsim.evaluate_recordings("track_to_track", recordings, ("ego", "1"))
    plain = result.count.all_tracks
    assert (plain["FP"], plain["FN"], plain["IDS"]) == (0, 0, 0)
    assert result.count["bytes_per_s"] > 850
