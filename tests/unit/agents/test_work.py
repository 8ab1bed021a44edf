"""The work of a receiver's frame: it grows with the messages, by little for each, and trackers step as often as before.

Work is counted, not timed: Python's calls, and the steps of trackers.
"""

from __future__ import annotations

import sys
from collections import Counter
from types import FrameType

import pytest
from some_tracks import FRAME_NS, cars

from coopsim.agents.boxes import LateFusion
from coopsim.agents.coop_fuse import CoopFuse
from coopsim.agents.tracking_policy import TrackingPolicy
from coopsim.tracking.delayed import DELAYED, RECEIVER, Measurement, Measurements
from coopsim.tracking.tracker import Tracker
from coopsim.types import Detections

MOST_CALLS = 100
"""Of Python, for one more message; a step of a tracker takes several hundred."""


def boxes(agent: int, frame: int) -> Detections:
    """One car that all see, and one that no other does."""
    return cars(1.0 * frame, 20.0 + 10.0 * agent)


def heard(agents: int, frame: int, late_frames: int) -> Measurements:
    """What a receiver and the senders saw: by the receiver now, by the others a while ago."""
    then = frame - late_frames
    sent = [Measurement(f"cav_{k:02d}", then * FRAME_NS, boxes(k, then)) for k in range(1, agents)]
    return Measurements.of([Measurement(RECEIVER, frame * FRAME_NS, boxes(0, frame)), *sent])


def work_of_a_frame(policy: TrackingPolicy, agents: int, late_frames: int) -> Counter[str]:
    """Return how often anything is called, and how often a tracker steps, in the last of some frames of a receiver."""
    strategy, work = DELAYED.get(policy.delayed)(policy.make_tracker, policy.fuse), Counter[str]()

    def count(frame: FrameType, event: str, _: object) -> None:
        if event == "call":
            work["calls"] += 1
            work["steps"] += frame.f_code is Tracker._update.__code__

    for frame in range(late_frames, late_frames + 8):
        measurements = heard(agents, frame, late_frames)
        strategy.step(measurements, frame * FRAME_NS)
    measurements, before = heard(agents, frame + 1, late_frames), sys.getprofile()
    sys.setprofile(count)
    try:
        strategy.step(measurements, (frame + 1) * FRAME_NS)
    finally:
        sys.setprofile(before)
    return work


@pytest.mark.parametrize("late_frames", [0, 2])
@pytest.mark.parametrize("delayed", DELAYED.names())
@pytest.mark.parametrize("make", [CoopFuse, LateFusion])
def test_one_more_message_costs_a_few_calls_and_no_step_of_a_tracker(
    make: type[TrackingPolicy], delayed: str, late_frames: int
) -> None:
    few, many = (work_of_a_frame(make(delayed=delayed), agents, late_frames) for agents in (4, 40))
    assert 0 < many["steps"] == few["steps"]
    assert (many["calls"] - few["calls"]) / 36 < MOST_CALLS * (1 + late_frames)
