"""The clock of the parts of a frame."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from coopsim.bench.detect.part_clock import PartClock


def test_the_making_of_messages_is_counted_by_itself() -> None:
    clock = PartClock(first=0)
    episode: Any = SimpleNamespace(policy=None, policy_s=0.0, environment_s=0.0, uplink_s=0.02, steps=0)
    clock.begin(episode)  # messages of the reset count for no frame
    episode.policy_s, episode.environment_s, episode.uplink_s, episode.steps = 0.005, 0.03, 0.04, 1
    clock.on_step(episode)
    assert clock.ms == pytest.approx({"policy": 5, "environment": 10, "uplink": 20})


def test_parts_that_a_policy_names_are_means_of_frames_after_the_first() -> None:
    policy: Any = SimpleNamespace(timings={"encode": 1.0})
    clock = PartClock(first=1)
    episode: Any = SimpleNamespace(policy=policy, policy_s=0.0, environment_s=0.0, uplink_s=0.0, steps=0)
    clock.begin(episode)
    for spent_s in (7.0, 0.25, 0.25):
        policy.timings["encode"] += spent_s
        episode.steps += 1
        clock.on_step(episode)
    assert clock.ms["encode"] == 250.0
