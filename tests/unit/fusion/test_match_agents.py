"""Matches of many agents' boxes against those of all pairs, two agents at a time."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest

from coopsim.fusion.pooling import match_agents
from coopsim.geometry.assignment import hungarian
from coopsim.geometry.iou import iou_3d


def two_at_a_time(boxes: np.ndarray, owner: np.ndarray, label: np.ndarray, threshold: float) -> list[tuple[int, int]]:
    pairs: list[tuple[int, int]] = []
    for one, other in combinations(range(owner.max() + 1), 2):
        mine, theirs = np.flatnonzero(owner == one), np.flatnonzero(owner == other)
        affinity = np.where(label[mine, None] == label[theirs], iou_3d(boxes[mine], boxes[theirs]), -np.inf)
        row, column = hungarian(affinity, threshold)
        pairs += zip(mine[row].tolist(), theirs[column].tolist(), strict=True)
    return pairs


@pytest.mark.parametrize("noise_m", [0.2, 1.0, 3.0])
@pytest.mark.parametrize("threshold", [0.01, 0.1, 0.5])
def test_matches_are_those_of_every_two_agents(noise_m: float, threshold: float) -> None:
    rng = np.random.default_rng(3)
    for _ in range(25):
        cars = np.column_stack([rng.uniform(-40, 40, (40, 2)), np.tile([0.8, 4.5, 1.9, 1.6, 0.3], (40, 1))])
        owner, label = np.sort(rng.integers(6, size=150)), rng.integers(2, size=150)
        boxes = cars[rng.integers(40, size=150)]
        boxes[:, :3] += rng.normal(scale=[noise_m, noise_m, 0.2], size=(150, 3))
        boxes[:, 6] += rng.normal(scale=0.1, size=150)
        pairs, value = match_agents(boxes, owner, label, threshold)
        assert [tuple(pair) for pair in pairs.tolist()] == two_at_a_time(boxes, owner, label, threshold)
        expected = [iou_3d(boxes[i : i + 1], boxes[j : j + 1])[0, 0] for i, j in pairs]
        np.testing.assert_array_equal(value, expected)


def test_no_boxes_have_no_matches() -> None:
    none = np.zeros(0, dtype=np.int64)
    pairs, value = match_agents(np.zeros((0, 7)), none, none, 0.1)
    assert pairs.shape == (0, 2) and value.shape == (0,)
