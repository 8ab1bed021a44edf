"""Duplicates become one box, neighbours stay."""

from dataclasses import replace

import numpy as np
import pytest

from coopsim.fusion.pooling import merge_duplicates, merge_matched, pool
from coopsim.geometry.boxes import Boxes3D
from coopsim.geometry.iou import iou_bev
from coopsim.geometry.se3 import Floats
from coopsim.types import Detections, Ints


def found(*rows: tuple[float, float, int], z: float = 0.0) -> Detections:
    """x, score, label of cars in a row."""
    boxes = Boxes3D.from_array(np.array([[x, 0, z, 4, 2, 1.5, 0] for x, _, _ in rows]).reshape(-1, 7))
    return Detections(boxes, np.array([s for _, s, _ in rows]), np.array([c for _, _, c in rows], dtype=int))


def kept(detections: Detections, iou_threshold: float = 0.2) -> list[tuple[float, float]]:
    merged = merge_duplicates(detections, iou_threshold)
    return list(zip(merged.boxes.center[:, 0].tolist(), merged.score.tolist(), strict=True))


def test_a_heap_becomes_its_weighted_mean_with_the_best_score() -> None:
    (x, score), neighbour = kept(found((0.0, 0.5, 0), (0.3, 0.9, 0), (0.1, 0.2, 0), (10.0, 0.4, 0)))
    assert x == pytest.approx((0.3 * 0.9 + 0.1 * 0.2) / 1.6) and score == 0.9
    assert neighbour == (10.0, 0.4)


def test_a_suppressed_box_suppresses_nobody() -> None:
    """A chain of three: the middle one goes to the first, so the last has no rival left."""
    (first, _), last = kept(found((0.0, 0.9, 0), (2.5, 0.8, 0), (5.0, 0.7, 0)))
    assert first == pytest.approx(2.5 * 0.8 / 1.7) and last == (5.0, 0.7)


def test_size_is_averaged_and_heading_is_the_best_ones() -> None:
    """A detector that confuses front and back must not turn the merged box aside."""
    rows = np.array([[0, 0, 0, 4, 2, 1.5, 0.1], [0, 0, 0, 5, 2, 1.5, 0.1 + np.pi]])
    merged = merge_duplicates(Detections(Boxes3D.from_array(rows), np.array([0.6, 0.3]), np.zeros(2, dtype=int)), 0.2)
    np.testing.assert_allclose(merged.boxes.array, [[0, 0, 0, 4 * 2 / 3 + 5 / 3, 2, 1.5, 0.1]])


def test_scores_need_not_be_probabilities() -> None:
    assert kept(found((0.0, -3.0, 0), (0.4, -1.0, 0))) == [(pytest.approx(0.2), -1.0)]
    assert kept(found((0.0, -3.0, 0), (0.4, 5.0, 0)))[0][0] == pytest.approx(0.4, abs=1e-6)


def test_boxes_without_duplicates_and_without_area_keep_their_bits() -> None:
    rows = np.array([[0.1, 0, 0, 4, 2, 1.5, 0.3], [9.7, 0, 0, 0, 0, 0, 0], [30.3, 1, 0, 4, 2, 1.5, 7]])
    score = np.array([0.7, 0.31, 0.13])
    merged = merge_duplicates(Detections(Boxes3D.from_array(rows), score, np.zeros(3, dtype=int)), 0.2)
    np.testing.assert_array_equal(merged.boxes.array, rows)


def test_other_classes_are_no_rivals() -> None:
    assert len(kept(found((0.0, 0.9, 0), (0.0, 0.8, 7)))) == 2


def test_height_does_not_matter() -> None:
    low, high = found((0.0, 0.9, 0)), found((0.0, 0.8, 0), z=1.4)
    assert len(kept(Detections.concatenate([low, high]))) == 1


def test_nothing_and_rubbish() -> None:
    assert kept(Detections.empty()) == []
    assert kept(found((np.nan, 0.9, 0), (1.0, 0.3, 0), (1.0, np.nan, 0))) == [(1.0, 0.3)]


def test_the_best_one_with_an_embedding_lends_it_and_all_who_saw_it_are_named() -> None:
    near = found((0.0, 0.9, 0), (20.0, 0.4, 0))
    groups = [
        replace(near, embedding=[[np.nan, np.nan], [1.0, 2.0]]),
        replace(found((0.1, 0.5, 0)), embedding=[[3.0, 4.0]]),
        found((0.2, 0.7, 0), (40.0, 0.3, 0)),
    ]
    merged = merge_duplicates(pool(groups), 0.2)
    assert merged.boxes.center[1:, 0].tolist() == [20, 40]
    np.testing.assert_array_equal(merged.embedding, [[3, 4], [1, 2], [np.nan, np.nan]])
    np.testing.assert_array_equal(merged.seen_by, [[True] * 3, [True, False, False], [False, False, True]])


def test_embeddings_of_another_width_than_the_first_are_none() -> None:
    groups = [replace(found((x, 0.5, 0)), embedding=np.ones((1, width))) for x, width in ((0, 2), (20, 3), (40, 2))]
    merged = merge_duplicates(pool([Detections.empty(), *groups]), 0.2)
    np.testing.assert_array_equal(merged.embedding, [[1, 1], [np.nan, np.nan], [1, 1]])
    assert merged.seen_by is not None and merged.seen_by.shape == (3, 4)


def test_pooling_nobody() -> None:
    for groups in ([], [Detections.empty()] * 2):
        assert len(merge_duplicates(pool(groups), 0.2)) == 0


def test_nms_keeps_the_best_box_as_it_is() -> None:
    both = found((0.0, 0.9, 0), (0.6, 0.6, 0), (20.0, 0.5, 0))
    mean, nms = (merge_duplicates(both, 0.2, merge) for merge in ("mean", "nms"))
    assert nms.boxes.center[:, 0].tolist() == [0.0, 20.0]
    np.testing.assert_allclose(mean.boxes.center[:, 0], [0.24, 20.0])
    assert nms.score.tolist() == mean.score.tolist() == [0.9, 0.5]


@pytest.mark.parametrize("seed", range(30))
def test_a_crowd_is_merged_as_by_comparing_all_pairs(seed: int) -> None:
    rng = np.random.default_rng(seed)
    count, objects = rng.integers(0, 120), rng.integers(1, 12)
    rows = rng.uniform([-20, -20, 0, 0, 0, 1, -4], [20, 20, 2, 9, 3, 2, 4], (objects, 7))[
        rng.integers(objects, size=count)
    ]
    rows += rng.normal(0, [0.4, 0.4, 0.1, 0, 0, 0, 0.1], (count, 7))
    score, label = rng.uniform(-0.2, 1, count).round(1), rng.integers(2, size=count)
    merged = merge_duplicates(Detections(Boxes3D.from_array(rows), score, label), 0.15)
    order = np.argsort(-score, kind="stable")
    expected = all_pairs_merged(rows[order], score[order], label[order], 0.15)
    np.testing.assert_array_equal(merged.boxes.array, expected)


def all_pairs_merged(rows: Floats, score: Floats, label: Ints, iou_threshold: float) -> Floats:
    """The reference: `merge_duplicates` of rows (N, 7), best first, by the overlap of all pairs."""
    overlap = iou_bev(rows, rows)
    rivals = (overlap >= iou_threshold) & (label[:, None] == label)
    stays = np.ones(len(rows), dtype=bool)
    for row in range(len(rows)):
        if stays[row]:
            stays[row + 1 :] &= ~rivals[row, row + 1 :]
    best = np.flatnonzero(stays)
    owner = np.where(rivals[best], overlap[best], -1.0).argmax(axis=0) if len(best) else best
    owner[best] = np.arange(len(best))
    weight = np.maximum(score, 1e-6)
    share = weight / np.bincount(owner, weights=weight, minlength=len(best))[owner]
    extent = np.zeros((len(best), 6))
    np.add.at(extent, owner, share[:, None] * rows[:, :6])
    return np.column_stack([extent, rows[best, 6]])


def matched(*groups: Detections, iou: float = 0.1) -> list[tuple[float, float]]:
    merged = merge_matched(groups, iou)
    return list(zip(merged.boxes.center[:, 0].tolist(), merged.score.tolist(), strict=True))


def test_boxes_of_two_agents_are_matched_for_the_largest_sum_of_overlaps() -> None:
    """The best box overlaps the third most, which the second needs: greedy suppression merges those three."""
    one, other = found((0.0, 0.9, 0), (3.4, 0.6, 0)), found((1.4, 0.95, 0), (-1.8, 0.5, 0))
    assert matched(one, other) == [
        (pytest.approx((1.4 * 0.95 + 3.4 * 0.6) / 1.55), 0.95),
        (pytest.approx(-1.8 * 0.5 / 1.4), 0.9),
    ]
    assert kept(pool([one, other]))[0][0] == pytest.approx((1.4 * 0.95 + 3.4 * 0.6) / 2.45)


def test_an_agents_own_duplicates_stay_and_so_does_what_only_one_sees() -> None:
    assert matched(found((0.0, 0.9, 0), (0.2, 0.8, 0)), found()) == [(0.0, 0.9), (0.2, 0.8)]
    assert matched(found((0.0, 0.3, 0)), found((50.0, 0.8, 0), (0.0, 0.5, 7))) == [(50.0, 0.8), (0.0, 0.5), (0.0, 0.3)]
    assert matched() == [] and matched(found(), found()) == []


def test_three_agents_boxes_of_an_object_become_one_whatever_their_order() -> None:
    groups = [found((0.0, 0.9, 0), (9.0, 0.2, 0)), found((0.3, 0.8, 0)), found((0.6, 0.7, 0), (9.3, 0.4, 0))]
    expected = [(pytest.approx((0.24 + 0.42) / 2.4), 0.9), (pytest.approx((1.8 + 3.72) / 0.6), 0.4)]
    assert matched(*groups) == matched(*groups[::-1]) == expected
    np.testing.assert_array_equal(merge_matched(groups, 0.1).seen_by, [[1, 1, 1], [1, 0, 1]])


def test_what_is_not_finite_is_left_out_of_a_matching() -> None:
    assert matched(found((np.nan, 0.9, 0)), found((1.0, 0.5, 0), (2.0, np.nan, 0))) == [(1.0, 0.5)]
