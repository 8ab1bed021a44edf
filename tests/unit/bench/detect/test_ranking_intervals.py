"""Intervals over episodes."""

from __future__ import annotations

import numpy as np

from coopsim.bench.detect.ranking import Ranking, _drawn_areas, area_interval


def _ranking(share: float, seed: int, count: int = 50) -> Ranking:
    rng = np.random.default_rng(seed)
    score = np.sort(rng.uniform(size=count))[::-1]
    return Ranking(score, rng.uniform(size=count) < share, count, 1)


def rounded(ranking: Ranking) -> Ranking:
    """Return the ranking with scores of one digit, so that many are equal."""
    return Ranking(ranking.score.round(1), ranking.hit, ranking.objects, ranking.frames)


def test_equal_episodes_have_no_spread_and_unequal_ones_do() -> None:
    same = area_interval([_ranking(0.7, 0)] * 5)
    assert same is not None and same[1] - same[0] < 1e-9
    parts = [_ranking(share, k) for k, share in enumerate((0.2, 0.5, 0.8, 0.9))]
    low, high = area_interval(parts) or (0.0, 0.0)
    assert low < Ranking.joined(parts).area() < high and high - low > 0.1
    assert area_interval(parts) == (low, high)


def test_a_draw_of_each_episode_once_is_the_area() -> None:
    for part in (_ranking(0.6, 1), rounded(_ranking(0.6, 1))):
        assert np.allclose(_drawn_areas([part], pooled=True), part.area())


def test_frames_may_be_ranked_one_after_another() -> None:
    surer, worse = _ranking(0.9, 1), _ranking(0.2, 2)
    by_frame = Ranking.joined([worse, surer])
    drawn = _drawn_areas([by_frame], pooled=False)
    assert np.allclose(drawn, by_frame.area_by_frame()) and not np.allclose(drawn, by_frame.area())


def test_two_episodes_say_nothing() -> None:
    assert area_interval([_ranking(0.5, 0), _ranking(0.6, 1)]) is None
