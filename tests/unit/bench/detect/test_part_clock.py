"""The clock of the parts of a frame."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from coopsim.bench.detect.part_clock import PartClock


def test_a_part_within_another_is_counted_by_itself(monkeypatch: pytest.MonkeyPatch) -> None:
    now_s = [0.0]
    monkeypatch.setattr("coopsim.bench.detect.part_clock.time", SimpleNamespace(perf_counter=lambda: now_s[0]))

    def wait(seconds: float) -> None:
        now_s[0] += seconds

    uplink = SimpleNamespace(contents=lambda observations: wait(0.02))
    uplink.messages = lambda observations: uplink.contents(observations)  # of which the time counts once
    policy: Any = SimpleNamespace(make_uplink=lambda spec, rng: uplink)
    clock = PartClock(policy, first=0)
    made = [policy.make_uplink(None, None) for _ in range(2)]  # shared by two agents
    assert made[0] is made[1]
    episode: Any = SimpleNamespace(policy=policy, policy_s=0.0, environment_s=0.0, steps=0)
    made[0].messages({})  # of the reset, which counts for no frame
    clock.begin(episode)
    started = now_s[0]
    wait(0.01)
    made[0].messages({})
    episode.policy_s, episode.environment_s, episode.steps = 0.005, now_s[0] - started, 1
    clock.on_step(episode)
    assert clock.ms == pytest.approx({"uplink": 20, "environment": 10, "policy": 5})


def test_parts_that_a_policy_names_are_means_of_frames_after_the_first() -> None:
    policy: Any = SimpleNamespace(timings={"encode": 1.0})
    clock = PartClock(policy, first=1)
    episode: Any = SimpleNamespace(policy=policy, policy_s=0.0, environment_s=0.0, steps=0)
    clock.begin(episode)
    for spent_s in (7.0, 0.25, 0.25):
        policy.timings["encode"] += spent_s
        episode.steps += 1
        clock.on_step(episode)
    assert clock.ms["encode"] == 250.0
