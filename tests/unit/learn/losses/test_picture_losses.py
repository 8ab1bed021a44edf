"""Losses of pictures: known values, and what they do not depend on."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from coopsim.learn.losses.head_losses import alike_loss, depth_loss, label_loss
from coopsim.nn.camera.picture_net import DepthBins

BINS = DepthBins(2.0, 30.0, 4)
SCENERY = torch.full((1, 1, 2), 255, dtype=torch.uint8)
ONE_CAR = torch.tensor([[[0, 255]]], dtype=torch.uint8)


def test_unknown_depths_and_classes_cost_the_logarithm_of_their_number() -> None:
    depth_m = torch.tensor([[[2.0, 0.0]]])
    for label in (SCENERY, ONE_CAR):
        assert depth_loss(torch.zeros(1, 5, 1, 2), depth_m, label, BINS) == pytest.approx(np.log(5))
        assert label_loss(torch.zeros(1, 10, 1, 2), label) == pytest.approx(np.log(10))


def test_true_depths_and_classes_cost_nothing() -> None:
    depth_m = torch.tensor([[[2.0, 0.0]]])
    true = 50 * BINS.shares(depth_m)
    assert depth_loss(true, depth_m, ONE_CAR, BINS) < 1e-6
    assert depth_loss(true.flip(3), depth_m, ONE_CAR, BINS) > 40
    classes = torch.zeros(1, 10, 1, 2)
    classes[0, 0, 0, 0] = classes[0, 9, 0, 1] = 50.0
    assert label_loss(classes, ONE_CAR) < 1e-6
    assert label_loss(classes.flip(3), ONE_CAR) > 40


def test_a_cell_of_an_object_counts_four_times() -> None:
    """Of a car's cell, all is known, and nothing of the cell of scenery; and the other way round."""
    depth_m = torch.tensor([[[2.0, 2.0]]])
    for known, share in ((0, 1 / 5), (1, 4 / 5)):
        depth, label = torch.zeros(1, 5, 1, 2), torch.zeros(1, 10, 1, 2)
        depth[0, 0, 0, known] = label[0, 0 if known == 0 else 9, 0, known] = 100.0
        assert depth_loss(depth, depth_m, ONE_CAR, BINS) == pytest.approx(share * np.log(5))
        assert label_loss(label, ONE_CAR) == pytest.approx(share * np.log(10))


def test_a_depth_between_two_bins_is_best_told_by_both() -> None:
    depth_m = torch.full((1, 1, 2), float(BINS.middles()[1:3].mean()))
    both = torch.tensor([-50.0, 0, 0, -50, -50]).reshape(1, 5, 1, 1).expand(1, 5, 1, 2)
    one = torch.tensor([-50.0, 5, 0, -50, -50]).reshape(1, 5, 1, 1).expand(1, 5, 1, 2)
    assert depth_loss(both, depth_m, SCENERY, BINS) == pytest.approx(np.log(2))
    assert depth_loss(one, depth_m, SCENERY, BINS) > 2


def test_likeness_is_a_share_of_energy_near_objects_alone() -> None:
    draws = torch.Generator().manual_seed(0)
    of_points, heat = 3 * torch.randn(2, 3, 4, 4, generator=draws), torch.zeros(2, 9, 4, 4)
    heat[0, 1, 1:3, 2] = 0.5
    near = of_points.clone()
    near[0, :, 1:3, 2] = 0
    assert alike_loss(of_points, of_points, heat) == 0
    assert alike_loss(near, of_points, heat) == pytest.approx(1.0)
    assert alike_loss(torch.zeros_like(of_points), of_points, heat) == pytest.approx(1.0)
    assert alike_loss(2 * of_points - near, of_points, heat) == pytest.approx(1.0)
    assert alike_loss(near, of_points, torch.full_like(heat, 0.04)) == 0  # nothing is near


def test_losses_of_short_floats_are_those_of_floats() -> None:
    draws = torch.Generator().manual_seed(0)
    logits, label = torch.randn(1, 10, 1, 2, generator=draws).bfloat16(), ONE_CAR
    assert label_loss(logits, label) == label_loss(logits.float(), label)
    depth_m = torch.tensor([[[3.0, 9.0]]])
    assert depth_loss(logits[:, :5], depth_m, label, BINS) == depth_loss(logits[:, :5].float(), depth_m, label, BINS)
