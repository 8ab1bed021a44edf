"""The clock of the parts of a frame."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from coopsim.bench.detect.episode import PartClock


def test_a_part_within_another_is_counted_by_itself(monkeypatch: pytest.MonkeyPatch) -> None:
    now_s = [0.0]
    monkeypatch.setattr("coopsim.bench.detect.episode.time", SimpleNamespace(perf_counter=lambda: now_s[0]))

    def wait(seconds: float) -> None:
        now_s[0] += seconds

    uplink = SimpleNamespace(messages=lambda observations: wait(0.02))
    policy: Any = SimpleNamespace(make_uplink=lambda spec, rng: uplink)
    clock = PartClock(policy)
    made = [policy.make_uplink(None, None) for _ in range(2)]  # shared by two agents
    assert made[0] is made[1]
    clock.running = True
    with clock.part("environment"):
        wait(0.01)
        made[0].messages({})
    clock.tick()
    assert clock.ms == pytest.approx({"uplink": 20, "environment": 10})


def test_parts_that_a_policy_names_are_means_of_running_frames() -> None:
    policy: Any = SimpleNamespace(timings={"encode": 1.0})
    clock = PartClock(policy)
    clock.tick()  # warming up
    clock.running = True
    for _ in range(2):
        policy.timings["encode"] += 0.25
        clock.tick()
    assert clock.ms == {"encode": 250.0}
