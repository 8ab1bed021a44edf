"""What every policy of a condition and seed meets, whatever it listens to: the same traffic, noise and losses."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

import coopsim
from coopsim.bench.grid.cell import Cell, Condition, environment_options
from coopsim.geometry.boxes import Boxes3D
from coopsim.types import Observation, Tracks

OPTIONS: dict[str, Any] = {"vehicles": 10, "lidar": "VLP-16", "lidar_columns": 256, "detector": "simulated"}


class Witness(coopsim.Policy):
    """Writes down what it sees, and reports something, so that rewards are not all alike."""

    def __init__(self, uplink: str, busy: bool) -> None:
        self.needs = coopsim.Needs(uplink)
        self._busy = busy
        self.seen: dict[str, list[Any]] = {}
        self.heard: dict[str, set[tuple[str, int, tuple[float, ...]]]] = {}
        self.arrivals: list[tuple[str, int, str, int]] = []

    def track(self, agent: str, observation: Observation) -> Tracks:
        found = observation.detections
        sweeps = [(name, sweep.points.tobytes()) for name, sweep in observation.sweeps.items()]
        self.seen.setdefault(agent, []).append(
            (
                found.boxes.array.tobytes(),
                found.score.tobytes(),
                observation.pose.xyz_yaw.tobytes(),
                observation.odometry.xyz_yaw.tobytes(),
                sweeps,
            )
        )
        for message in observation.inbox:
            stamp = (message.sender, message.captured_ns, tuple(message.pose.xyz_yaw.tolist()))
            self.heard.setdefault(agent, set()).add(stamp)
            self.arrivals.append((agent, observation.time_ns, message.sender, message.captured_ns))
        if not self._busy:
            none = np.zeros(0, dtype=np.int64)
            return Tracks(none, Boxes3D.empty(), np.zeros((0, 2)), np.zeros(0), none)
        ids = np.arange(len(found))
        return Tracks(ids, found.boxes, np.zeros((len(found), 2)), found.score, found.label)


class Actors(coopsim.Recorder):
    """The state of the world, frame by frame."""

    def __init__(self) -> None:
        self.actors: list[bytes] = []

    def on_step(self, episode: coopsim.Episode) -> None:
        self.actors.append(episode.env.state().tobytes())


def witness(condition: Condition, uplink: str, busy: bool) -> tuple[Witness, list[bytes]]:
    """A witness after its run, and all actors by frame."""
    policy, kept = Witness(uplink, busy), Actors()
    options = environment_options(Cell(uplink, condition, 5, 15), OPTIONS)
    coopsim.evaluate(policy, "crossing", seed=5, recorders=[kept], **options)
    return policy, kept.actors


@pytest.mark.parametrize(
    "condition",
    [Condition(), Condition(latency_s=0.25, loss=0.4, position_noise_m=0.3, heading_noise_deg=0.5)],
)
def test_whatever_a_policy_reports_and_listens_to(condition: Condition) -> None:
    (first, actors), *others = (
        witness(condition, uplink, busy)
        for uplink, busy in [("detections", False), ("detections", True), ("tracks", True), ("none", True)]
    )
    assert len(actors) == 15 and any(first.heard.values())
    for other, same_actors in others:
        assert same_actors == actors
        assert other.seen == first.seen
        if other.needs.uplink != "none":
            assert other.heard == first.heard and other.arrivals == first.arrivals


def test_on_a_narrow_channel_only_the_wait_depends_on_the_bytes() -> None:
    """Who says more waits longer, so messages arrive at other times; which ones the links lose stays the same."""
    condition = Condition(loss=0.4, position_noise_m=0.3, bandwidth_bit_s=60e3)
    (boxes, actors), (tracks, same_actors) = (witness(condition, uplink, True) for uplink in ("detections", "tracks"))
    assert same_actors == actors and tracks.seen == boxes.seen
    assert tracks.arrivals != boxes.arrivals
    last_ns = min(captured for *_, captured in (tracks.arrivals[-1], boxes.arrivals[-1])) - 500_000_000
    for agent in boxes.heard:
        early = [{each for each in policy.heard[agent] if each[1] <= last_ns} for policy in (boxes, tracks)]
        assert early[0] == early[1] != set()


def test_a_clean_condition_scores_as_an_environment_without_options() -> None:
    cell = Cell("late_fusion", Condition(), 3, 12)
    plain = coopsim.evaluate("late_fusion", "crossing", seed=3, max_cycles=12, **OPTIONS)
    clean = coopsim.evaluate("late_fusion", "crossing", seed=3, **environment_options(cell, OPTIONS))
    wide = environment_options(Cell("late_fusion", Condition(bandwidth_bit_s=1e15), 3, 12), OPTIONS)
    limited = coopsim.evaluate("late_fusion", "crossing", seed=3, **wide)
    assert math.isfinite(plain.score["MOTA"])
    for other in (clean, limited):
        assert repr(dict(other.score.values)) == repr(dict(plain.score.values))
        assert other.rewards.tolist() == plain.rewards.tolist() and other.messages == plain.messages
