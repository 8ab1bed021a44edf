"""Pairs, and the two rules of matching."""

from __future__ import annotations

import numpy as np
from perceived_frames import detections, objects, overlaps


def _all(count: int) -> np.ndarray:
    return np.ones(count, dtype=bool)


def test_boxes_of_different_frames_make_no_pair() -> None:
    pairs = overlaps([(detections((0, 0.9)), objects(50)), (detections((50, 0.9)), objects(0))])
    assert len(pairs.frame) == 0


def test_pairs_have_rows_among_all_frames() -> None:
    pairs = overlaps([(detections((0, 0.9)), objects(0)), (detections((9, 0.9), (30, 0.8)), objects(33.9, 10))])
    assert pairs.frame.tolist() == [0, 1, 1]
    assert pairs.truth.tolist() == [0, 1, 2] and pairs.found.tolist() == [0, 2, 1]
    np.testing.assert_allclose(pairs.similarity["distance"], [0, -3.9, -1])
    np.testing.assert_allclose(pairs.similarity["BEV"], [1, 0.1 / 7.9, 0.6])


def test_by_score_the_surest_chooses_first_and_by_object_the_nearest_is_taken() -> None:
    pairs = overlaps([(detections((0.5, 0.9), (0, 0.5)), objects(0, 1))])
    masks = _all(2), _all(2)
    assert pairs.matched_by_score(*masks, "BEV", 0.5).tolist() == [0, 1]  # a tie: the first object, then what is left
    assert pairs.matched_by_object(*masks, "BEV", 0.5).tolist() == [1, 0]


def test_of_equal_overlaps_an_object_takes_the_unsurest() -> None:
    pairs = overlaps([(detections((1, 0.9), (-1, 0.5)), objects(0))])
    assert pairs.matched_by_object(_all(2), _all(1), "3D", 0.3).tolist() == [-1, 0]


def test_only_those_that_take_part_are_matched() -> None:
    pairs = overlaps([(detections((0, 0.9), (0.1, 0.8)), objects(0))])
    assert pairs.matched_by_score(np.array([False, True]), _all(1), "BEV", 0.5).tolist() == [-1, 0]
    assert pairs.matched_by_score(_all(2), np.array([False]), "BEV", 0.5).tolist() == [-1, -1]
    assert pairs.best_on(np.array([False]), "BEV").tolist() == [0, 0]
