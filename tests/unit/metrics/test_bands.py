"""Scores by distance from the reporting agent."""

from __future__ import annotations

import json

import pytest
from test_clear import Frame, evaluate, tracks, truth

from coopsim.metrics.evaluator import Evaluator
from coopsim.metrics.log_pool import BANDS_M
from coopsim.metrics.score import Score, summarize

NAMES = list(BANDS_M)


def bands(frames: list[Frame]) -> dict[str, dict[str, float]]:
    return {name: dict(band.all_tracks) for name, band in evaluate(frames)[1].bands.items()}


def test_objects_count_where_they_are() -> None:
    found = bands([({1: 10, 2: 30, 3: -49, 4: 99.9}, {9: 10, 8: 30})] * 3)
    assert list(found) == NAMES == ["0-30 m", "30-50 m", "50-100 m"]
    assert [found[name]["GT"] for name in NAMES] == [3, 6, 3]
    assert [found[name]["TP"] for name in NAMES] == [3, 3, 0]


def test_beyond_the_last_band_only_the_whole_counts() -> None:
    _, score = evaluate([({1: 100}, {9: 100})])
    assert not score.bands and score["GT"] == 1


def test_a_track_follows_its_object_over_a_border() -> None:
    found = bands([({1: 29.9}, {9: 30.1})] * 3)
    assert list(found) == ["0-30 m"]
    assert (found["0-30 m"]["TP"], found["0-30 m"]["FP"]) == (3, 0)


def test_a_track_follows_the_nearest_of_two_objects() -> None:
    found = bands([({1: 28.5, 2: 31.5}, {9: 29.8, 8: 31.0})])
    assert [found[name]["TP"] for name in NAMES[:2]] == [1, 1]


def test_a_false_track_counts_where_it_is() -> None:
    found = bands([({1: 10, 2: 40}, {9: 10, 8: 40, 7: 45, 6: 48})])
    assert [found[name]["FP"] for name in NAMES[:2]] == [0, 2]


def test_bands_have_every_value_and_go_along() -> None:
    _, score = evaluate([({1: 10}, {9: 10})] * 3)
    assert set(score.bands["0-30 m"].values) == set(score.classes["car"].values)
    assert "0-30 m" in score.table()
    assert json.loads(json.dumps(score.to_dict()))["bands"]["0-30 m"]["HOTA"] == 100


def test_the_mean_is_over_agents_that_met_the_band() -> None:
    near, far = (evaluate(frames)[1] for frames in ([({1: 10}, {9: 10})], [({1: 10, 2: 40}, {8: 40})]))
    mean = Score.mean({"cav_0": near, "cav_1": far})
    assert mean.bands["0-30 m"].all_tracks["MOTA"] == 50
    assert mean.bands["30-50 m"].all_tracks["MOTA"] == 100


def test_classes_stay_apart_at_a_border() -> None:
    evaluator = Evaluator()
    evaluator.update(truth({1: 29.9}), tracks({9: 30.1}, label=7))
    found = summarize([evaluator.log]).bands
    assert list(found) == ["0-30 m"] and found["0-30 m"].all_tracks["FP"] == pytest.approx(0)
