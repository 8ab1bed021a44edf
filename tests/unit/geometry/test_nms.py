"""Suppression against a slow reference, and what it does with awkward boxes."""

from __future__ import annotations

import time

import numpy as np
import pytest

from coopsim.errors import InvalidValueError
from coopsim.geometry.iou import iou_bev
from coopsim.geometry.nms import nms_bev
from coopsim.geometry.se3 import Floats


def crowd(count: int, seed: int, spread_m: float = 20.0) -> tuple[Floats, Floats]:
    rng = np.random.default_rng(seed)
    at = rng.uniform(-spread_m, spread_m, (count, 2))
    size = rng.uniform((3, 1.5, 1), (6, 2.5, 2), (count, 3))
    boxes = np.column_stack([at, rng.uniform(-1, 1, count), size, rng.uniform(-7, 7, count)])
    return boxes, rng.uniform(0, 1, count)


def slow(boxes: Floats, score: Floats, iou_threshold: float) -> list[int]:
    """The definition, with all pairs."""
    overlap, kept = iou_bev(boxes, boxes), list[int]()
    for row in np.argsort(-score, kind="stable").tolist():
        if not any(overlap[other, row] >= iou_threshold for other in kept):
            kept.append(row)
    return kept


@pytest.mark.parametrize("iou_threshold", [0.05, 0.15, 0.5, 1.0])
@pytest.mark.parametrize("seed", range(4))
def test_equals_the_slow_definition(iou_threshold: float, seed: int) -> None:
    boxes, score = crowd(150, seed)
    score = np.round(score, 1)  # many ties
    assert nms_bev(boxes, score, iou_threshold).tolist() == slow(boxes, score, iou_threshold)


def test_of_equal_scores_the_first_stands() -> None:
    boxes = np.tile([[1.0, 2, 0, 4, 2, 1.5, 0.3]], (3, 1))
    assert nms_bev(boxes, np.full(3, 0.5), 0.15).tolist() == [0]


def test_boxes_without_area_and_boxes_that_are_no_numbers() -> None:
    boxes = np.tile([[0.0, 0, 0, 4, 2, 1.5, 0]], (5, 1))
    boxes[1, 4] = 0  # no area: overlaps nothing
    boxes[2, 0], boxes[3, 6] = np.nan, np.inf
    score = np.array([0.5, 0.9, 0.8, 0.7, np.nan])
    assert nms_bev(boxes, score, 0.15).tolist() == [1, 0]


def test_none_and_one() -> None:
    assert nms_bev(np.zeros((0, 7)), np.zeros(0), 0.15).tolist() == []
    assert nms_bev(np.ones((1, 7)), np.ones(1), 0.15).tolist() == [0]


def test_a_far_away_origin_changes_nothing() -> None:
    boxes, score = crowd(100, 7)
    moved = boxes.copy()
    moved[:, :2] += 2.0**14
    assert nms_bev(moved, score, 0.15).tolist() == nms_bev(boxes, score, 0.15).tolist()


def test_float32_and_rows_apart_in_memory() -> None:
    boxes, score = crowd(50, 3)
    boxes, score = boxes.astype(np.float32), score.astype(np.float32)
    wide = np.asfortranarray(np.column_stack([boxes, score]))
    expected = nms_bev(boxes.astype(float), score.astype(float), 0.15).tolist()
    assert nms_bev(wide[:, :7], wide[:, 7], 0.15).tolist() == expected


@pytest.mark.parametrize("iou_threshold", [0.0, 1.1, float("nan")])
def test_a_wrong_threshold_is_refused(iou_threshold: float) -> None:
    with pytest.raises(InvalidValueError, match="iou_threshold"):
        nms_bev(np.zeros((0, 7)), np.zeros(0), iou_threshold)


def test_wrong_shapes_are_refused() -> None:
    with pytest.raises(InvalidValueError, match="shape"):
        nms_bev(np.zeros((2, 8)), np.zeros(2), 0.15)
    with pytest.raises(InvalidValueError, match="shape"):
        nms_bev(np.zeros((2, 7)), np.zeros(3), 0.15)


def test_300_boxes_take_about_a_millisecond() -> None:
    boxes, score = crowd(300, 5)
    nms_bev(boxes, score, 0.15)

    def seconds() -> float:
        start = time.process_time()
        nms_bev(boxes, score, 0.15)
        return time.process_time() - start

    assert min(seconds() for _ in range(10)) < 0.005  # 0.3 ms on a quiet machine
