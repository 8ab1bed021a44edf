"""What is kept of a sequence: enough at any time, and little."""

from __future__ import annotations

import math
import tracemalloc

import numpy as np
import pytest
from test_clear import tracks, truth

from coopsim.geometry.boxes import Boxes3D
from coopsim.metrics.evaluator import Evaluator
from coopsim.metrics.matching import find_candidate_pairs
from coopsim.metrics.score import summarize
from coopsim.types import GroundTruth, Tracks


def busy_frame() -> tuple[GroundTruth, Tracks]:
    """20 objects, each with a track."""
    return truth({k: 10.0 * k for k in range(20)}), tracks({k: 10.0 * k for k in range(20)})


def test_a_summary_at_any_time_changes_nothing() -> None:
    frames = [(truth({1: 0, 2: 20}), tracks({9: 0.1 * k, k: 20})) for k in range(10)]
    running = Evaluator()
    for count, frame in enumerate(frames, start=1):
        running.update(*frame)
        fresh = Evaluator()
        for each in frames[:count]:
            fresh.update(*each)
        assert summarize([running.log]).to_dict() == summarize([fresh.log]).to_dict()


def test_a_log_of_many_frames_has_every_value_in_order() -> None:
    evaluator, places = Evaluator(), [0.01 * k for k in range(300)]
    for k, place in enumerate(places):
        evaluator.update(truth({k: place, k + 1: 50}), tracks({2 * k: place}))
        if k % 50 == 0:
            evaluator.log.flat()  # which packs what there is
    log = evaluator.log.flat()
    assert log.truth_start.tolist() == list(range(0, 602, 2))
    assert log.track_id.tolist() == [2 * k for k in range(300)]
    assert log.iou_3d == pytest.approx(np.ones(300))
    assert log.truth_range_m[::2] == pytest.approx(np.float32(places))


def test_no_frames_have_an_undefined_score() -> None:
    score = summarize([Evaluator().log])
    assert all(math.isnan(score[name]) for name in ("HOTA", "MOTA", "IDF1", "AP3D@0.5", "mAP3D@0.5"))
    assert score["GT"] == 0


def test_little_is_kept_of_a_frame() -> None:
    """2,000 steps of four agents with 20 objects each then take less than 20 MB."""
    evaluator, frame = Evaluator(), busy_frame()
    evaluator.update(*frame)
    tracemalloc.start()
    try:
        for _ in range(500):
            evaluator.update(*frame)
        grown, _ = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert grown / 500 * 8000 < 20e6


def test_pairs_overlap_or_are_near_and_are_of_one_class() -> None:
    boxes = Boxes3D.from_array(
        [
            [0, 0, 0, 4, 2, 1.5, 0],
            [1.5, 0, 9, 4, 2, 1.5, 0],  # above: no common volume
            [0, 1.9, 0, 1, 0.5, 1.5, 0],  # beside: near only
            [3.5, 0, 0, 4, 2, 1.5, 0],  # in front: overlaps, though not near
            [0, 2.1, 0, 1, 0.5, 1.5, 0],  # neither
            [0, 0, 0, 4, 2, 1.5, 0],  # of another class
        ]
    )
    found = find_candidate_pairs(boxes.array[:1], np.array([0]), boxes.array, np.array([0, 0, 0, 0, 0, 7]))
    assert found.truth.tolist() == [0, 0, 0, 0]
    assert found.track.tolist() == [0, 1, 2, 3]
    assert found.iou_3d == pytest.approx([1, 0, 0, 1 / 15])
    assert found.iou_bev == pytest.approx([1, 5 / 11, 0, 1 / 15])
    assert found.distance_m == pytest.approx([0, 1.5, 1.9, 3.5])
