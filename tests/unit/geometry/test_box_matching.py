"""Matching of boxes that are compared only where it decides, against all pairs."""

from __future__ import annotations

import numpy as np
import pytest

from coopsim.geometry.assignment import hungarian
from coopsim.geometry.box_matching import Likeness, ScoredBoxes, match_boxes
from coopsim.geometry.iou import giou_3d


@pytest.mark.parametrize("score_weight", [0.0, 0.6, 30.0])
@pytest.mark.parametrize("reach_m", [3.0, 30.0, 1e5])
def test_pairs_are_those_of_all_pairs_compared(reach_m: float, score_weight: float) -> None:
    rng = np.random.default_rng(int(reach_m + score_weight))
    for _ in range(40):
        a, b = (
            np.column_stack([rng.uniform(-reach_m, reach_m, (n, 2)), rng.normal(size=n), rng.uniform(0.3, 9, (n, 4))])
            for n in rng.integers(0, 25, 2)
        )
        same = rng.integers(0, min(len(a), len(b)) + 1)
        b[:same] = a[:same] + rng.normal(0, 1, (same, 7)) * [0.6, 0.6, 0.3, 0.05, 0.05, 0.05, 0.2]
        ours, theirs = (ScoredBoxes(each, rng.random(len(each)), rng.integers(0, 3, len(each))) for each in (a, b))
        affinity = giou_3d(a, b) - score_weight * np.abs(ours.score[:, None] - theirs.score)
        affinity[ours.label[:, None] != theirs.label] = -np.inf
        row_of, value = match_boxes(ours, theirs, Likeness(True, score_weight))
        rows, columns = hungarian(affinity, -np.inf)
        assert np.flatnonzero(row_of >= 0).tolist() == sorted(columns.tolist())
        assert row_of[columns].tolist() == rows.tolist()
        np.testing.assert_array_equal(value[columns], affinity[rows, columns])


def test_boxes_that_are_no_numbers_have_no_partner() -> None:
    a = np.array([[0, 0, 0, 4, 2, 1.5, 0], [np.nan, 0, 0, 4, 2, 1.5, 0]])
    ours = ScoredBoxes(a, np.ones(2), np.zeros(2, dtype=np.int64))
    assert match_boxes(ours, ours, Likeness(True, 0.0))[0].tolist() == [0, -1]
