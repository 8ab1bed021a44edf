"""Which frames are measured, and how far they are apart."""

from __future__ import annotations

import pytest

from coopsim.bench.detect.episode import Pace, pace_of


@pytest.mark.parametrize(
    ("every_s", "delay_s", "fixed_s", "step_s", "every", "warm_up"),
    [
        (0.5, 0.0, None, 0.5, 1, 1),
        (0.5, 0.5, None, 0.5, 1, 3),
        (0.5, 0.1, None, 0.1, 5, 3),
        (0.5, 0.2, None, 0.2, 3, 3),
        (0.1, 0.3, None, 0.1, 1, 7),
        (0.5, 0.3, 0.1, 0.1, 5, 7),
        (0.05, 0.0, 0.1, 0.1, 1, 1),
    ],
)
def test_a_delay_is_a_whole_number_of_frames(
    every_s: float, delay_s: float, fixed_s: float | None, step_s: float, every: int, warm_up: int
) -> None:
    made, pace = pace_of(10, every_s, delay_s, fixed_s)
    assert made == pytest.approx(step_s) and pace == Pace(10, every, warm_up)


def test_the_frames_of_a_pace() -> None:
    pace = Pace(3, 2, 1)
    assert [frame for frame in range(10) if pace.measures(frame)][:3] == [1, 3, 5] and pace.cycles == 6
