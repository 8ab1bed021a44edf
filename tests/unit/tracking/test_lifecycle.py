"""Who is reported, and who is dropped."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from some_tracks import tracks

from coopsim.errors import InvalidValueError
from coopsim.tracking.lifecycle import ByScore, HitsAndAge, VelocityAdaptiveAge


def test_hits_confirm_and_misses_end() -> None:
    rule, known = HitsAndAge(hits=3, age=2), tracks(0, 1, 2, hits=[1, 3, 9], misses=[0, 1, 2])
    assert rule.reported(known, frame=10).tolist() == [False, True, True]
    assert rule.reported(known, frame=3).tolist() == [True, True, True]
    assert rule.alive(known).tolist() == [True, True, False]


def test_score_reports_and_drops() -> None:
    rule = ByScore(report=0.5, drop=0.1, age=3, coast=1)
    known = tracks(0, 1, 2, 3, score=[0.6, 0.4, 0.05, 0.6], misses=[1, 0, 0, 2])
    assert rule.reported(known, frame=1).tolist() == [True, False, False, False]
    assert rule.alive(known).tolist() == [True, True, False, True]


def test_by_score_reports_by_what_would_be_said_and_drops_by_the_score() -> None:
    known = replace(tracks(0, 10, score=[0.9, 0.3]), confidence=np.array([0.3, 0.9]))
    rule = ByScore(report=0.5, drop=0.5)
    assert rule.reported(known, frame=1).tolist() == [False, True]
    assert rule.alive(known).tolist() == [True, False]


def test_fast_objects_are_kept_longer() -> None:
    rule = VelocityAdaptiveAge(age=2, age_per_m_s=0.2, coast=1)  # at 10 m/s: 4 frames
    slow, fast = (tracks(*range(5), misses=[0, 1, 2, 3, 4], speed_m_s=speed) for speed in (0.0, 10.0))
    assert rule.alive(slow).tolist() == [True, True, False, False, False]
    assert rule.alive(fast).tolist() == [True, True, True, True, False]
    assert rule.reported(fast, frame=10).tolist() == [True, True, False, False, False]


def test_fast_objects_may_be_reported_while_they_are_kept() -> None:
    rule = VelocityAdaptiveAge(age=2, age_per_m_s=0.2, coast=None)
    fast = tracks(*range(5), misses=[0, 1, 2, 3, 4], hits=[3, 3, 3, 2, 3], speed_m_s=10.0)
    assert rule.reported(fast, frame=10).tolist() == [True, True, True, False, False]


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: HitsAndAge(hits=0), "hits must be an integer >= 1"),
        (lambda: HitsAndAge(age=-1), "age must be an integer >= 1"),
        (lambda: ByScore(report=float("nan")), "report and drop must be numbers"),
        (lambda: ByScore(report=0.5, coast=-1), "coast must be an integer >= 0"),
        (lambda: VelocityAdaptiveAge(coast=-1), "coast must be an integer >= 0"),
        (lambda: VelocityAdaptiveAge(age_per_m_s=-0.1), "age_per_m_s must be a finite number >= 0"),
    ],
)
def test_bad_settings(make: object, message: str) -> None:
    with pytest.raises(InvalidValueError, match=message):
        make()  # type: ignore[operator]
