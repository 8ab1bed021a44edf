"""One episode: what is collected of any policy."""

from __future__ import annotations

import numpy as np
import pytest

import coopsim
from coopsim.bench.detect.episode import Pace, Selection, perceive_episode
from coopsim.bench.detect.perceived import Perceived
from coopsim.errors import InvalidValueError
from coopsim.types import Observation, Tracks

QUICK = {"lidar": None, "dt_s": 0.5, "detector": "simulated", "threads": 1}


class Copy(coopsim.Policy):
    needs = coopsim.Needs(uplink="none")

    def track(self, agent: str, observation: Observation) -> Tracks:
        found = observation.detections
        return Tracks(np.arange(len(found)), found.boxes, np.zeros((len(found), 2)), found.score, found.label)


def _perceived(policy: coopsim.Policy | str, **more: object) -> Perceived:
    policy = coopsim.make_policy(policy) if isinstance(policy, str) else policy
    options = QUICK | more.pop("options", {})  # type: ignore[operator]
    return perceive_episode(policy, "crossing", seed=0, options=options, pace=Pace(3), **more)  # type: ignore[arg-type]


def test_what_updated_the_tracks_is_what_the_agent_detected() -> None:
    tracked, copied = _perceived("no_fusion"), _perceived(Copy())
    assert len(tracked.found_score) > 10 and tracked.receiver_frames == 9 and tracked.frames == 3
    np.testing.assert_allclose(tracked.found_box, copied.found_box, atol=1e-9)
    np.testing.assert_array_equal(tracked.found_score, copied.found_score)
    np.testing.assert_array_equal(tracked.true_box, copied.true_box)


def test_late_fusion_finds_what_only_others_see() -> None:
    alone, together = _perceived("no_fusion"), _perceived("late_fusion")
    assert len(together.found_score) > len(alone.found_score)
    assert together.messages == 4 * 5 and together.sent_bytes > 0 and alone.messages == 0  # 4 agents, reset and 4 steps
    assert set(together.true_seen_by[together.true_counts]) == {0, 1}
    assert {"policy", "uplink", "environment"} <= set(together.ms) and min(together.ms.values()) > 0


def test_with_replay_the_newest_moment_counts() -> None:
    policy = coopsim.make_policy("late_fusion", delayed="replay")
    late = _perceived(policy, options={"latency_s": 0.5})
    own = _perceived("no_fusion")
    # The newest moment has the agent's own detections, and what senders measured last, moved on.
    assert len(late.found_score) > len(own.found_score) > 0
    nearest = np.linalg.norm(own.found_box[:, None, :2] - late.found_box[None, :, :2], axis=2).min(axis=1)
    assert np.median(nearest) < 0.01


def test_tracks_can_be_measured_instead() -> None:
    tracks = _perceived("late_fusion", selection=Selection(boxes="tracks"))
    assert len(tracks.found_score) != len(_perceived("late_fusion").found_score)


def test_masts_are_receivers_where_all_are() -> None:
    assert _perceived("no_fusion", selection=Selection("all")).receiver_frames == 12
    assert _perceived("no_fusion", selection=Selection("all", without=("cav_1",))).receiver_frames == 9


def test_receivers_must_be_there() -> None:
    options = {"connected_cars": 0, "rsus": 2}
    with pytest.raises(InvalidValueError, match=r"'cars' need a connected car.*rsu"):
        _perceived("no_fusion", options=options)


def test_arrays_give_back_what_they_were_made_of() -> None:
    made = _perceived("late_fusion")
    back = Perceived.from_arrays(made.arrays())
    assert back.ms == made.ms and back.region_m == made.region_m == (100.0, 40.0)
    for column in ("found_box", "found_start", "true_label", "true_counts"):
        np.testing.assert_array_equal(getattr(back, column), getattr(made, column))
