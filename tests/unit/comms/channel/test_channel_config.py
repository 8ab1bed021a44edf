"""Agents speak at their own times, and read their own clocks."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from coopsim.comms.channel.channel_config import AgentClock
from coopsim.errors import InvalidValueError

FRAME_NS = 100_000_000


def frames(clock: AgentClock, count: int, frame_s: float = 0.1) -> list[int]:
    """In which frames it ticks."""
    times_ns = [round(k * frame_s * 1e9) for k in range(count)]
    return [k for k in range(count) if clock.ticks(times_ns[k - 1] if k else None, times_ns[k])]


def test_half_the_rate_is_every_second_frame_from_the_phase_on() -> None:
    assert frames(AgentClock(5.0), 9) == [0, 2, 4, 6, 8]
    assert frames(AgentClock(5.0, phase_s=0.1), 9) == [1, 3, 5, 7]
    assert frames(AgentClock(5.0, phase_s=0.05), 9) == [1, 3, 5, 7]
    assert frames(AgentClock(phase_s=0.25), 6) == [3, 4, 5]


def test_frames_are_the_fastest() -> None:
    assert frames(AgentClock(1000.0), 5) == frames(AgentClock(), 5) == [0, 1, 2, 3, 4]


def test_a_rate_that_frames_round_is_kept() -> None:
    assert frames(AgentClock(10.0), 12, 1 / 30) == [0, 3, 6, 9]


@given(rate_hz=st.floats(0.2, 10), phase_s=st.floats(0, 1))
def test_ticks_are_as_many_as_the_rate_says(rate_hz: float, phase_s: float) -> None:
    assert abs(len(frames(AgentClock(rate_hz, phase_s), 600)) - (59.9 - phase_s) * rate_hz) <= 1.001


def test_stamps_are_off_by_offset_and_drift() -> None:
    clock = AgentClock(offset_s=0.01, drift_ppm=50)
    assert clock.stamp_ns(0) == 10_000_000
    assert clock.stamp_ns(100 * 10**9) == 100 * 10**9 + 10_000_000 + 5_000_000
    assert AgentClock(offset_s=-1).stamp_ns(FRAME_NS) == 0
    assert AgentClock().stamp_ns(2**61 + 1) == 2**61 + 1


def test_an_episodes_clock_has_errors_of_the_size_asked_for() -> None:
    clock, rng = AgentClock(5.0, 0.1, offset_s=0.3, offset_noise_s=0.02, drift_noise_ppm=30.0), np.random.default_rng(0)
    sampled = [clock.sample(rng) for _ in range(4000)]
    offsets, drifts = np.array([(each.offset_s, each.drift_ppm) for each in sampled]).T
    assert {(each.rate_hz, each.phase_s) for each in sampled} == {(5.0, 0.1)}
    assert offsets.mean() == pytest.approx(0.3, abs=0.002) and offsets.std() == pytest.approx(0.02, rel=0.05)
    assert drifts.mean() == pytest.approx(0.0, abs=2.0) and drifts.std() == pytest.approx(30.0, rel=0.05)
    assert AgentClock(offset_s=0.3).sample(rng) == AgentClock(offset_s=0.3)
    assert AgentClock(offset_s=3600, offset_noise_s=3600).sample(np.random.default_rng(0)).offset_s <= 3600


@pytest.mark.parametrize(
    ("options", "match"),
    [
        ({"rate_hz": 0}, "rate_hz must be in .* None: in each frame, got 0"),
        ({"phase_s": -0.1}, r"phase_s must be in \[0, 3600\], got -0.1"),
        ({"offset_s": float("nan")}, "offset_s must be in"),
        ({"drift_ppm": 1e5}, "drift_ppm must be in"),
        ({"offset_noise_s": -1}, "offset_noise_s must be in"),
        ({"drift_noise_ppm": "5"}, "drift_noise_ppm must be in .* got '5'"),
    ],
)
def test_bad_clock(options: dict, match: str) -> None:  # type: ignore[type-arg]
    with pytest.raises(InvalidValueError, match=match):
        AgentClock(**options)
