"""Which anchors are objects, by cases made by hand and by a slow reference."""

from __future__ import annotations

import numpy as np
import pytest

from coopsim.errors import InvalidValueError
from coopsim.geometry.iou import iou_bev
from coopsim.geometry.se3 import Floats
from coopsim.learn.losses.anchor_targets import AnchorAssignment, anchor_targets, join_anchor_targets
from coopsim.nn.detector.anchor_head import upright_extent
from coopsim.nn.detector.anchors import AnchorConfig, anchor_boxes
from coopsim.types import BevGrid

GRID = BevGrid((-12.0, 12.0), (-6.0, 6.0), 1.2)
IGNORED = AnchorAssignment(between="ignored")


def car(x: float, y: float, yaw: float = 0.0, length: float = 3.9, width: float = 1.6) -> list[float]:
    return [x, y, 0.78, length, width, 1.56, yaw]


def cell(row: int, column: int) -> tuple[float, float]:
    """The middle of a cell of the grid."""
    return -12 + (column + 0.5) * 1.2, -6 + (row + 0.5) * 1.2


def places(boxes: list[list[float]], **options: AnchorAssignment) -> tuple[list[tuple[int, ...]], Floats]:
    """Anchor, row and column of the objects, and all roles."""
    role = anchor_targets(np.array(boxes).reshape(-1, 7), GRID, **options).role[0].numpy()
    return [tuple(map(int, each)) for each in np.argwhere(role == 1)], role


def test_a_car_like_the_anchor_is_that_anchor_and_its_code_is_zero() -> None:
    targets = anchor_targets(np.array([car(*cell(4, 7))]), GRID)
    assert np.argwhere(targets.role[0].numpy() == 1).tolist() == [[0, 4, 7]]
    assert targets.codes.abs().max() < 1e-6 and targets.backwards.tolist() == [False]


def test_a_car_across_is_the_anchor_across_and_one_that_looks_back_is_marked() -> None:
    targets = anchor_targets(np.array([car(*cell(2, 3), yaw=-np.pi / 2), car(*cell(6, 15), yaw=0.1)]), GRID)
    at = np.argwhere(targets.role[0].numpy() == 1).tolist()
    assert at == [[0, 6, 15], [1, 2, 3]]
    assert targets.backwards.tolist() == [False, True]


def test_each_truth_has_its_best_anchor_however_little_they_overlap() -> None:
    """A bus overlaps no anchor by 0.6: it has the one at its middle, though it covers others as well."""
    at, _ = places([car(*cell(5, 10), length=12, width=2.5)])
    assert at == [(0, 5, 10)]


def test_between_the_thresholds_anchors_are_negative_or_ignored() -> None:
    """0.6 m beside an anchor along x the IoU is 3.3 / 4.5 = 0.73, 1.2 m beside it 2.7 / 5.1 = 0.53."""
    x, y = cell(4, 7)
    at, role = places([car(x, y)])
    assert at == [(0, 4, 7)] and (role == -1).sum() == 0
    at, role = places([car(x, y)], assignment=IGNORED)
    assert at == [(0, 4, 7)] and np.argwhere(role == -1).tolist() == [[0, 4, 6], [0, 4, 8]]
    assert places([car(x + 0.6, y)])[0] == [(0, 4, 7), (0, 4, 8)]


def test_no_truth_and_truth_far_away_and_at_the_edge() -> None:
    assert places([])[0] == [] and (places([], assignment=IGNORED)[1] == 0).all()
    at, role = places([car(60.0, 0.0)], assignment=IGNORED)
    assert at == [] and (role == 0).all()
    targets = anchor_targets(np.zeros((0, 7)), GRID)
    assert targets.codes.shape == (0, 7) and targets.index.shape == (0,)
    assert places([car(12.5, cell(3, 0)[1])])[0] == [(0, 3, 19)]  # its middle is beyond the grid


def test_of_two_with_one_best_anchor_the_nearer_one_has_it() -> None:
    x, y = cell(4, 7)
    for boxes in ([car(x, y), car(x + 0.1, y, length=9)], [car(x + 0.1, y, length=9), car(x, y)]):
        targets = anchor_targets(np.array(boxes), GRID)
        assert targets.codes[targets.index == 4 * 20 + 7].abs().max() < 1e-6


@pytest.mark.parametrize("seed", range(3))
def test_roles_equal_a_slow_reference(seed: int) -> None:
    rng = np.random.default_rng(seed)
    boxes = np.array([car(*rng.uniform((-13, -7), (13, 7)), rng.uniform(-4, 4), *rng.uniform((3, 1.4), (5, 2.2)))
                      for _ in range(9)])  # fmt: skip
    anchors = anchor_boxes(GRID, AnchorConfig())
    overlap = iou_bev(upright(boxes), upright(anchors))
    expected = np.where(overlap.max(axis=0) >= 0.45, -1, 0)
    expected[overlap.max(axis=0) > 0.6] = 1
    for box, row in zip(boxes, overlap, strict=True):
        best = np.flatnonzero((row > 0) & (row > row.max() - 1e-7))
        if len(best):
            expected[best[np.hypot(*(anchors[best, :2] - box[:2]).T).argmin()]] = 1
    role = anchor_targets(boxes, GRID, assignment=IGNORED).role[0].numpy()
    np.testing.assert_array_equal(role.reshape(-1), expected)


def upright(boxes: Floats) -> Floats:
    around = boxes.copy()
    around[:, 3:5], around[:, 6] = upright_extent(boxes), 0
    return around


def test_joined_targets_are_numbered_through_all_samples() -> None:
    parts = [anchor_targets(np.array(boxes).reshape(-1, 7), GRID)
             for boxes in ([car(*cell(1, 1))], [], [car(*cell(8, 18), yaw=1.6), car(*cell(2, 5))])]  # fmt: skip
    joined = join_anchor_targets(parts)
    assert joined.role.shape == (3, 2, 10, 20) and (joined.role.reshape(-1)[joined.index] == 1).all()
    assert len(joined.index) == (joined.role == 1).sum() == len(joined.codes) == len(joined.backwards)


def test_broken_boxes_and_thresholds_are_refused() -> None:
    with pytest.raises(InvalidValueError, match="finite"):
        anchor_targets(np.array([car(np.nan, 0)]), GRID)
    with pytest.raises(InvalidValueError, match="sizes"):
        anchor_targets(np.array([car(0, 0, width=0)]), GRID)
    with pytest.raises(InvalidValueError, match="negative_iou"):
        AnchorAssignment(positive_iou=0.4)
    with pytest.raises(InvalidValueError, match="between"):
        AnchorAssignment(between="positive")
