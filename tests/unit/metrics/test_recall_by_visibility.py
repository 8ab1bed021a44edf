"""Recall by who saw an object."""

from __future__ import annotations

import math

import numpy as np
import pytest

from coopsim.bench.text.score_text import format_visibility
from coopsim.geometry.boxes import Boxes3D
from coopsim.metrics.evaluator import Evaluator
from coopsim.metrics.score import GroupRecall, Score, summarize
from coopsim.types import GroundTruth, Ints, Tracks


def boxes(x_m: list[float]) -> Boxes3D:
    return Boxes3D.from_array([[x, 0.0, 0.0, 4.0, 2.0, 1.5, 0.0] for x in x_m]) if x_m else Boxes3D.empty()


def score(frames: list[tuple[list[int], list[int]]], *, known: bool = True) -> Score:
    """Objects 20 m apart; per frame who saw each, and which of them are tracked."""
    evaluator = Evaluator()
    for seen_by, tracked in frames:
        ids: Ints = np.arange(len(seen_by))
        truth = GroundTruth(ids, boxes([20.0 * k for k in ids.tolist()]), 0 * ids, np.array(seen_by) if known else None)
        count = len(tracked)
        none = np.zeros(count, dtype=np.int64)
        where = boxes([20.0 * k for k in tracked])
        evaluator.update(truth, Tracks(np.array(tracked, dtype=int), where, np.zeros((count, 2)), np.ones(count), none))
    return summarize([evaluator.log])


def test_groups_are_counted_by_frame_and_add_up() -> None:
    frames = [([0, 1, 1, 2], [0, 1]), ([1, 1, 0, 2], [0, 2, 3])]  # who sees an object changes
    groups = score(frames).visibility
    assert groups == {"me": GroupRecall(2, 2, 8), "others only": GroupRecall(2, 4, 8), "nobody": GroupRecall(1, 2, 8)}
    assert (groups["others only"].recall, groups["others only"].share, groups["others only"].gain) == (50, 50, 25)
    assert sum(group.gain for group in groups.values()) == pytest.approx(score(frames).all_tracks["recall"])


def test_false_tracks_belong_to_no_group() -> None:
    with_false, without = score([([0, 1], [0, 1, 7])]), score([([0, 1], [0, 1])])
    assert with_false.visibility == without.visibility
    assert with_false["FP"] == 1


def test_where_nobody_knows_there_are_no_groups() -> None:
    assert score([([0, 1], [0])], known=False).visibility == {}
    assert "visibility" not in score([([0, 1], [0])], known=False).to_dict()
    assert format_visibility([({"policy": "x"}, {})]) == "it is not known which agents saw what"


def test_agents_are_pooled_and_an_empty_group_has_no_recall() -> None:
    one, other = score([([0, 0, 1], [0])]), score([([0, 1], [0, 1])])
    mean = Score.mean({"cav_0": one, "cav_1": other})
    assert mean.visibility["others only"] == GroupRecall(1, 2, 5)
    assert mean.agents["cav_1"].visibility["others only"].recall == 100
    assert math.isnan(mean.visibility["nobody"].recall) and mean.visibility["nobody"].share == 0
    assert mean.to_dict()["visibility"]["nobody"] == {"share": 0, "gain": 0, "TP": 0, "GT": 0}
    assert mean.ignoring_false_positives().visibility == mean.visibility


def test_the_table_shows_what_there_is() -> None:
    groups = score([([0, 0, 1, 1], [0, 2])]).visibility
    heading, _, row = format_visibility([({"policy": "late"}, groups)]).splitlines()
    assert "seen by others only" in heading and "nobody" not in heading
    assert row.split() == ["late", "50.0", "50.0", "50.0", "50.0", "25.0"]
