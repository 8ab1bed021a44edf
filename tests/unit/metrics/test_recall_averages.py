"""AB3DMOT's averages: where levels of recall are cut, and what they average."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from test_clear import tracks, truth

from coopsim.metrics import clear
from coopsim.metrics.clear import Clear, count_clear, recall_thresholds
from coopsim.metrics.evaluator import Evaluator
from coopsim.metrics.log_pool import LogPool
from coopsim.metrics.score import summarize


def authors_thresholds(scores: list[float], truth_count: int) -> tuple[list[float], list[float]]:
    """AB3DMOT's procedure, followed step by step."""
    ordered = sorted(scores, reverse=True)
    level, levels, cuts = 0.0, [], []
    for i, score in enumerate(ordered):
        left = (i + 1) / truth_count
        right = (i + 2) / truth_count if i < len(ordered) - 1 else left
        if (right - level) < (level - left) and i < len(ordered) - 1:
            continue
        cuts.append(score)
        levels.append(level)
        level += 1 / 40.0
    return levels[1:], cuts[1:]


@pytest.mark.parametrize(
    ("matches", "objects"), [(0, 50), (1, 41), (41, 41), (3, 45), (50, 55), (100, 130), (1000, 1000)]
)
def test_thresholds_follow_the_authors(matches: int, objects: int) -> None:
    scores = np.random.default_rng(matches).random(matches)
    got = recall_thresholds(scores, objects)
    levels, cuts = authors_thresholds(scores.tolist(), objects)
    np.testing.assert_allclose([level for level, _ in got], levels)
    np.testing.assert_allclose([cut for _, cut in got], cuts)
    assert len(got) <= 40


@pytest.mark.parametrize("objects", [1, 2, 7, 20, 39, 40, 41])
def test_few_boxes_reach_every_level_that_their_recall_allows(objects: int) -> None:
    for matches in range(objects + 1):
        scores = np.linspace(1, 0.1, matches)
        got = recall_thresholds(scores, objects)
        wanted = [level for level in range(1, 41) if level * objects <= matches * 40]
        if objects <= 40:
            assert [level for level, _ in got] == [level / 40 for level in wanted]
        for level, cut in got if objects <= 40 or matches == objects else []:
            found = (scores >= cut).sum()
            assert found / objects >= level - 1e-9 > (found - 1) / objects - 1e-9, "the first match to reach it"


@pytest.mark.parametrize("boxes", [1, 2, 5, 20, 39, 40, 41, 42, 60])
def test_a_perfect_tracker_of_any_number_of_boxes_has_all(boxes: int) -> None:
    evaluator = Evaluator()
    for k in range(boxes):
        evaluator.update(truth({k: 0}), tracks({k: 0}, scores={k: 1 - k / 1000}))
    score = summarize([evaluator.log])
    # From 42 on the nearest match may be just below a level, as in AB3DMOT's code.
    assert score["sAMOTA"] == pytest.approx(100, abs=1e-9 if boxes <= 41 else 0.5)
    assert score["AMOTP"] == pytest.approx(100)
    if boxes <= 41:  # the mean over levels of the first recall that reaches each
        assert score["AMOTA"] == pytest.approx(100 * np.mean([-(-k * boxes // 40) / boxes for k in range(1, 41)]))


def test_half_of_few_boxes_is_half() -> None:
    evaluator = Evaluator()
    for k in range(20):
        evaluator.update(truth({k: 0}), tracks({k: 0} if k % 2 else {}, scores={k: 1 - k / 1000}))
    score = summarize([evaluator.log])
    assert score["sAMOTA"] == pytest.approx(50) and score["AMOTP"] == pytest.approx(50)


def test_a_perfect_tracker_gets_all_there_is() -> None:
    evaluator = Evaluator()
    for k in range(400):
        evaluator.update(truth({k: 0}), tracks({k: 0}, scores={k: 1 - k / 1000}))
    score = summarize([evaluator.log])
    assert score["sAMOTA"] == pytest.approx(100, abs=0.5)
    assert score["AMOTP"] == pytest.approx(100, abs=0.5)
    # The mean of the levels themselves: (1 + 2 + ... + 40) / 40 / 40.
    assert score["AMOTA"] == pytest.approx(51.25, abs=0.5)


def test_sure_tracks_are_cut_last() -> None:
    """False tracks with low scores cost nothing at the levels of recall that the good ones reach alone."""
    evaluator = Evaluator()
    for k in range(100):
        evaluator.update(truth({k: 0}), tracks({k: 0, 1000 + k: 40}, scores={k: 0.9, 1000 + k: 0.1}))
    score = summarize([evaluator.log])
    assert score["FP"] == 0 and score["MOTA"] == 100
    assert score.all_tracks["FP"] == 100 and score.all_tracks["MOTA"] == 0


def test_scores_are_those_of_whole_tracks() -> None:
    """A track is cut by its mean score, not frame by frame."""
    evaluator = Evaluator()
    for k in range(10):
        evaluator.update(truth({1: 0}), tracks({9: 0}, scores={9: 0.1 if k % 2 else 0.9}))
    points = summarize([evaluator.log]).sweep
    assert points is not None
    assert all(point.clear.tp == 10 for point in points.points)


def test_scaled_mota_of_a_tracker_that_only_misses() -> None:
    half = Clear(tp=50, fn=50, objects=1)
    assert half.mota == 0.5
    assert half.scaled_mota(0.5) == pytest.approx(1.0)
    assert half.scaled_mota(1.0) == pytest.approx(0.5)
    assert Clear(tp=10, fp=500, fn=90).scaled_mota(0.1) == 0.0


def test_levels_that_leave_the_same_tracks_are_counted_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """A short episode has many levels of recall and few tracks."""
    thresholds: list[float] = []

    def counted(sequences: Any, *, threshold: float = -np.inf, **settings: Any) -> Any:
        thresholds.append(threshold)
        return count_clear(sequences, threshold=threshold, **settings)

    monkeypatch.setattr(clear, "count_clear", counted)
    evaluator = Evaluator()
    for _ in range(30):
        evaluator.update(truth({1: 0, 2: 20, 3: 40}), tracks({7: 0, 8: 20}, scores={7: 0.9, 8: 0.5}))
    pool = LogPool.of([evaluator.log])
    assert len(pool.sweep.points) == 27 and len(thresholds) == 1 + 2, "once for all tracks, and for each two levels"
    assert [point.clear.tp for point in pool.sweep.points] == [30] * 13 + [60] * 14
    assert pool.near_sweep.amotp < 2.0 and len(thresholds) == 1 + 2 + 2
