"""The second look at boxes: odd and even under half a turn, of any map of a batch, and at work in the decoder."""

from __future__ import annotations

import numpy as np
import torch

from coopsim.learn.losses.head_losses import head_loss, sum_of
from coopsim.learn.samples.targets import make_targets
from coopsim.nn.covariance.covariance_net import box_patches
from coopsim.nn.detector.box_judge import BoxJudge, patches_of
from coopsim.nn.detector.decode import decode
from coopsim.nn.detector.detector_net import CentreHead, JudgedHead
from coopsim.types import BevGrid

torch.set_num_threads(1)
GRID = BevGrid((-9.6, 9.6), (-9.6, 9.6), 0.8)


def some_boxes(count: int = 6) -> torch.Tensor:
    rng = np.random.default_rng(0)
    return torch.tensor(np.column_stack([rng.uniform(-7, 7, (count, 2)), np.ones(count), np.full((count, 2), 3.0),
                                         np.ones(count), rng.uniform(-3, 3, count)])).float()  # fmt: skip


def test_a_box_and_the_same_one_backwards_are_judged_as_opposites() -> None:
    features, boxes, judge = torch.rand(8, *GRID.shape), some_boxes(), BoxJudge(8)
    backwards = boxes.clone()
    backwards[:, 6] += torch.pi
    one, other = (judge(box_patches(features, each, GRID)) for each in (boxes, backwards))
    torch.testing.assert_close(one[0], -other[0], atol=1e-4, rtol=1e-4)
    torch.testing.assert_close(one[1], other[1], atol=1e-4, rtol=1e-4)
    assert one[0].abs().max() > 1e-3


def test_patches_are_of_each_box_s_own_map() -> None:
    features, boxes = torch.rand(3, 8, *GRID.shape), some_boxes()
    number = torch.tensor([2, 0, 2, 1, 0, 2])
    found = patches_of(features, boxes, number, GRID)
    for row, k in enumerate(number.tolist()):
        torch.testing.assert_close(found[row], box_patches(features[k], boxes[row : row + 1], GRID)[0])


def trained(steps: int) -> tuple[JudgedHead, torch.Tensor, np.ndarray]:
    """Return a head that was trained on a map with two cars whose fronts stand out, and some ghosts; and the cars."""
    torch.manual_seed(0)
    boxes = np.array([[-4.2, -3.1, 0.8, 4.4, 1.8, 1.5, 0.3], [4.6, 3.4, 0.8, 4.4, 1.8, 1.5, -2.5]])
    targets = make_targets(boxes, np.zeros((2, 2)), np.zeros(2, np.int64), GRID)
    features = torch.rand(1, 16, *GRID.shape) * (torch.rand(1, 1, *GRID.shape) < 0.5)
    for x, y, *_, yaw in boxes:
        for part, channel in ((-1.5, 0), (0.0, 1), (1.5, 2)):
            column = int((x + part * np.cos(yaw) + 9.6) / 0.8)
            row = int((y + part * np.sin(yaw) + 9.6) / 0.8)
            features[0, channel, row - 1 : row + 2, column - 1 : column + 2] += 2.0
    head = JudgedHead(16)
    adam = torch.optim.Adam(head.parameters(), lr=3e-3)
    for _ in range(steps):
        loss = sum_of(head_loss(head, features, targets))
        adam.zero_grad()
        loss.backward()
        adam.step()
    return head.eval(), features, boxes


def test_a_trained_judge_turns_boxes_round_and_scores_them_by_their_fit() -> None:
    head, features, boxes = trained(250)
    head.shared.norm.momentum = None
    found = decode(head, features, GRID, least_score=0.3)[0]
    assert len(found) == 2
    order = np.argsort(found.boxes.array[:, 0])
    away = found.boxes.array[order] - boxes
    assert np.abs(away[:, :2]).max() < 0.5
    assert (np.cos(away[:, 6]) > 0.9).all()
    with torch.no_grad():  # a head that has every direction wrong
        head.code_of[2].weight[8:10] *= -1
        head.code_of[2].bias[8:10] *= -1
    again = decode(head, features, GRID, least_score=0.3)[0]
    np.testing.assert_allclose(np.sort(again.boxes.array[:, 6]), np.sort(found.boxes.array[:, 6]), atol=1e-4)


def test_scores_are_moved_by_the_calibration_and_velocities_are_stated_if_motion_shows() -> None:
    head, features, _ = trained(250)
    plain = decode(head, features, GRID, least_score=0.05, moving=[True])[0]
    assert plain.velocity is not None and plain.velocity.shape == (len(plain), 2)
    head.calibration[0] = torch.tensor([1.0, -1.0])
    doubting = decode(head, features, GRID, least_score=0.01)[0]
    assert doubting.velocity is None
    logit = np.log(plain.score[0] / (1 - plain.score[0]))
    np.testing.assert_allclose(doubting.score[0], 1 / (1 + np.exp(1 - logit)), atol=1e-4)


def test_nothing_is_found_where_there_are_no_features() -> None:
    assert len(decode(JudgedHead(8).eval(), torch.zeros(2, 8, *GRID.shape), GRID, least_score=0.001)[1]) == 0


def test_a_turned_head_turns_vehicles_alone_and_leaves_scores_as_they_are() -> None:
    torch.manual_seed(0)
    plain, features = CentreHead(8).eval(), torch.rand(1, 8, *GRID.shape)
    turned = CentreHead(8, turned=True).eval()
    turned.load_state_dict(plain.state_dict(), strict=False)
    with torch.no_grad():
        plain.heat_of.bias.fill_(0.0)
        turned.heat_of.bias.fill_(0.0)
    one, other = (decode(head, features, GRID)[0] for head in (plain, turned))
    np.testing.assert_array_equal(one.score, other.score)
    np.testing.assert_array_equal(one.boxes.array[:, :6], other.boxes.array[:, :6])
    wrong_way = np.cos(one.boxes.array[:, 6] - other.boxes.array[:, 6]) < 0
    vehicle = one.label <= 3
    assert vehicle.any() and (~vehicle).any()
    assert wrong_way[vehicle].any() and not wrong_way[~vehicle].any()
