"""What the head says becomes boxes again, with the thresholds that are asked for."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from torch import Tensor

from coopsim.geometry.se3 import Floats
from coopsim.learn.losses.anchor_targets import AnchorTargets, anchor_targets
from coopsim.nn.detector.anchor_head import AnchorDecoding, AnchorHead, AnchorMaps, upright_extent
from coopsim.nn.detector.decode import decode
from coopsim.types import BevGrid, Detections, ObjectClass

torch.set_num_threads(1)

GRID = BevGrid((-38.4, 38.4), (-19.2, 19.2), 1.2)


class SaysTheTruth(AnchorHead):
    """A head whose maps are those of targets."""

    def __init__(self, targets: AnchorTargets, direction: bool = True) -> None:
        super().__init__(8, direction=direction)
        self.targets = targets

    def forward(self, features: Tensor) -> AnchorMaps:
        batch, kinds, rows, columns = self.targets.role.shape
        logits = torch.where(self.targets.role == 1, 5.0, -5.0)
        codes = torch.zeros(batch * kinds * rows * columns, 7)
        codes[self.targets.index] = self.targets.codes
        sides = torch.zeros(len(codes), 2)
        sides[self.targets.index, self.targets.backwards.long()] = 3.0
        shaped = codes.view(batch, kinds, rows, columns, 7).movedim(-1, 2)
        return AnchorMaps(
            logits, shaped, sides.view(batch, kinds, rows, columns, 2).movedim(-1, 2) if self.direction else None
        )


def said(boxes: Floats, rule: AnchorDecoding | None = None, direction: bool = True) -> Detections:
    head = SaysTheTruth(anchor_targets(boxes, GRID), direction)
    (found,) = head.decode(torch.zeros(1, 8, *GRID.shape), GRID, rule)
    return found


def street() -> Floats:
    """Cars of all headings, a bus and a truck, far from each other."""
    rng = np.random.default_rng(3)
    at = np.stack(np.meshgrid(np.arange(-30, 31, 15.0), [-12.0, 0, 12]), axis=-1).reshape(-1, 2)
    boxes = np.column_stack([at + rng.uniform(-1, 1, at.shape), np.tile([0.8, 4.4, 1.8, 1.5, 0], (len(at), 1))])
    boxes[:, 6] = rng.uniform(-np.pi, np.pi, len(at))
    boxes[3, 3:6], boxes[9, 3:6] = (12, 2.5, 3.3), (8.5, 2.5, 3.3)
    return boxes


def sorted_rows(boxes: Floats) -> Floats:
    return boxes[np.lexsort(np.round(boxes[:, :2], 3).T)]


def test_what_is_taught_is_what_is_found() -> None:
    boxes = street()
    found = said(boxes)
    np.testing.assert_allclose(sorted_rows(found.boxes.array), sorted_rows(boxes), atol=1e-4)
    assert set(found.label.tolist()) == {ObjectClass.CAR} and found.score.min() > 0.99


def test_without_direction_headings_are_known_but_for_half_a_turn() -> None:
    boxes = street()
    boxes[:, 6] = np.pi - 0.1
    turn = sorted_rows(said(boxes, direction=False).boxes.array)[:, 6] - boxes[:, 6]
    np.testing.assert_allclose(np.sin(turn), 0, atol=1e-4)


def test_the_limit_of_extent_is_off_unless_asked_for() -> None:
    boxes = street()
    assert len(said(boxes)) == len(boxes)
    short = (upright_extent(boxes) <= 6).all(axis=1)
    assert 0 < short.sum() < len(boxes) - 1
    found = said(boxes, AnchorDecoding(most_extent_m=6.0))
    np.testing.assert_allclose(sorted_rows(found.boxes.array), sorted_rows(boxes[short]), atol=1e-4)


def test_scores_below_the_threshold_are_no_detections_and_the_surest_are_kept() -> None:
    torch.manual_seed(0)  # weights that are drawn may make a lucky guess
    head = AnchorHead(4)
    features = torch.randn(2, 4, *GRID.shape, generator=torch.Generator().manual_seed(0))
    assert [len(each) for each in head.decode(features, GRID)] == [0, 0]  # an untrained head finds nothing
    few = head.decode(features, GRID, AnchorDecoding(least_score=0.0, most=10, nms_iou=1.0))
    assert all(len(each) <= 10 and (np.diff(each.score) <= 0).all() for each in few)
    best = torch.sigmoid(head(features).logits).flatten(1).max(dim=1).values.detach().double().numpy()
    np.testing.assert_allclose([each.score[0] for each in few], best)


def test_extremes_stay_finite() -> None:
    torch.manual_seed(0)  # weights that are drawn may make a lucky guess
    head = AnchorHead(4)
    with torch.no_grad():
        head.out.weight.zero_()
        head.out.bias.fill_(1e4)  # type: ignore[union-attr]
    (found,) = head.decode(torch.zeros(1, 4, *GRID.shape), GRID)
    assert len(found) and np.isfinite(found.boxes.array).all()


def test_decode_takes_either_head() -> None:
    torch.manual_seed(0)  # weights that are drawn may make a lucky guess
    head = AnchorHead(4)
    with torch.no_grad():
        head.out.bias.zero_()  # type: ignore[union-attr]
    features = torch.zeros(1, 4, *GRID.shape)
    (through,) = decode(head, features, GRID, least_score=0.4, most=50)
    (direct,) = head.decode(features, GRID, AnchorDecoding(0.4, 50))
    np.testing.assert_array_equal(through.boxes.array, direct.boxes.array)
    assert len(through)


@pytest.mark.parametrize(("yaw", "extent"), [(0.0, (4, 2)), (np.pi / 2, (2, 4)), (np.pi / 4, (4.2426407, 4.2426407))])
def test_upright_extent(yaw: float, extent: tuple[float, float]) -> None:
    boxes = np.array([[9.0, 9, 9, 4, 2, 1, yaw], [0, 0, 0, 4, 2, 1, yaw - np.pi]])
    np.testing.assert_allclose(upright_extent(boxes), [extent, extent])
