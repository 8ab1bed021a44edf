"""nuScenes' averages by hand; `tests/golden/test_metric_parity.py` compares them with the development kit's steps."""

from __future__ import annotations

import numpy as np
import pytest
from test_clear import evaluate, tracks, truth

from coopsim.metrics.clear import score_thresholds
from coopsim.metrics.evaluator import Evaluator
from coopsim.metrics.score import summarize


def test_perfect_tracks() -> None:
    _, score = evaluate([({1: 0}, {9: 0})] * 4)
    assert score["AMOTA@2m"] == 100 and score["AMOTP@2m"] == pytest.approx(0)


def test_what_is_not_reached_counts_as_the_worst() -> None:
    """Half of the objects are found, 0.5 m off: that reaches 18 of the 40 levels from 0.1 to 1."""
    _, score = evaluate([({1: 0, 2: 30}, {9: 0.5})] * 10)
    assert score["AMOTA@2m"] == pytest.approx(100 * 18 / 40)
    assert score["AMOTP@2m"] == pytest.approx((18 * 0.5 + 22 * 2.0) / 40)


@pytest.mark.parametrize("frames", [[({1: 0}, {})], [({1: 0}, {9: 2.0})]])
def test_nothing_found_is_the_worst(frames: list[tuple[dict[int, float], dict[int, float]]]) -> None:
    _, score = evaluate(frames)
    assert (score["AMOTA@2m"], score["AMOTP@2m"]) == (0, 2)


def test_false_tracks_of_low_score_cost_nothing_before_they_are_needed() -> None:
    evaluator = Evaluator()
    for _ in range(10):
        evaluator.update(truth({1: 0}), tracks({9: 0, 8: 50}, scores={9: 0.9, 8: 0.1}))
    assert summarize([evaluator.log])["AMOTA@2m"] == 100


def test_thresholds_are_interpolated() -> None:
    found = score_thresholds(np.array([0.2, 0.8]), 2)
    assert len(found) == 40 and found[0] == 0.8 and found[-1] == 0.2
    assert sorted(found, reverse=True) == found
    assert 0.2 < found[-2] < 0.8
    assert len(score_thresholds(np.array([0.2, 0.8]), 4)) == 18
