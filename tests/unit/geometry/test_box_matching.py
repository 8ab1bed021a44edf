"""Boxes are matched as the Hungarian method matches all pairs of a class."""

from __future__ import annotations

import numpy as np
import pytest

from coopsim.geometry.assignment import hungarian
from coopsim.geometry.box_matching import match_boxes
from coopsim.geometry.boxes import Boxes3D
from coopsim.geometry.iou import giou_bev
from coopsim.geometry.se3 import Floats


def random_boxes(rng: np.random.Generator, count: int, reach_m: float) -> Floats:
    places = rng.uniform(-reach_m, reach_m, (count, 2))
    return np.column_stack([places, rng.normal(size=count), rng.uniform(0.3, 9, (count, 3)), rng.uniform(-4, 4, count)])


@pytest.mark.parametrize("reach_m", [3.0, 20.0, 100.0, 1e4, 1e7])
@pytest.mark.parametrize("classes", [1, 3])
def test_as_hungarian_on_all_pairs(reach_m: float, classes: int) -> None:
    rng = np.random.default_rng(int(reach_m) + classes)
    for _ in range(100):
        count, width = rng.integers(0, 25, 2)
        own, other = random_boxes(rng, count, reach_m), random_boxes(rng, width, reach_m)
        same = rng.integers(0, min(count, width) + 1)  # objects that both see
        other[:same] = own[:same] + rng.normal(0, 1, (same, 7)) * [0.6, 0.6, 1, 0.05, 0.05, 0.05, 0.2]
        label, other_label = rng.integers(0, classes, count), rng.integers(0, classes, width)
        affinity = np.where(label[:, None] == other_label, giou_bev(own, other), -np.inf)
        for gate in (-1.0, -0.2, 0.14):
            found = match_boxes(Boxes3D.from_array(own), label, Boxes3D.from_array(other), other_label, gate)
            for rows, expected in zip(found, hungarian(affinity, gate), strict=True):
                np.testing.assert_array_equal(rows, expected)


def test_equal_boxes_are_matched_in_order() -> None:
    boxes, label = Boxes3D.from_array(np.tile([0, 0, 0, 4, 2, 1.5, 0.3], (4, 1))), np.zeros(4, dtype=np.int64)
    own_rows, rows = match_boxes(boxes, label, boxes, label, 0.5)
    assert own_rows.tolist() == rows.tolist() == [0, 1, 2, 3]


def test_a_box_without_an_overlap_to_compute_stays_alone() -> None:
    rows = [[0, 0, 0, 4, 2, 1.5, 0], [1.7e308, 0, 0, 1.7e308, 1.7e308, 1, 0]]
    boxes, label = Boxes3D.from_array(rows), np.zeros(2, dtype=np.int64)
    own_rows, columns = match_boxes(boxes, label, boxes, label, -1.0)
    assert own_rows.tolist() == columns.tolist() == [0]
