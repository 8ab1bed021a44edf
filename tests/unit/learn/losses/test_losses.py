"""Losses: what lowers them, and what cannot."""

import numpy as np
import torch

from coopsim.learn.losses.head_losses import code_losses, heat_loss
from coopsim.learn.samples.targets import join_targets, make_targets
from coopsim.types import BevGrid

GRID = BevGrid((-24.0, 24.0), (-12.0, 12.0), 1.2)
BOXES = np.array([[0.3, 0.4, 0.8, 4.6, 1.9, 1.6, 0.3], [9.0, -5.0, 0.9, 0.8, 0.5, 1.7, 2.0]])


def targets():
    return make_targets(BOXES, np.ones((2, 2)), np.array([0, 7]), GRID)


def test_the_true_heat_costs_next_to_nothing_and_false_heat_a_lot() -> None:
    heat = targets().heat
    right = torch.where(heat == 1, 8.0, -8.0)
    elsewhere = right.roll(5, dims=-1)
    assert heat_loss(right, heat, 2) < 0.01
    assert heat_loss(elsewhere, heat, 2) > 5


def test_cells_beside_a_centre_may_be_warm() -> None:
    heat = targets().heat
    right = torch.where(heat == 1, 8.0, -8.0)
    beside = torch.where((heat > 0.5) & (heat < 1), 0.0, right)
    far = right.clone()
    far[0, 0, 0, :4] = 0.0
    assert heat_loss(beside, heat, 2) < heat_loss(far, heat, 2)


def test_a_map_without_objects_has_a_finite_loss() -> None:
    empty = torch.zeros(1, 9, 4, 4)
    assert torch.isfinite(heat_loss(torch.zeros_like(empty), empty, 0))


def test_true_codes_cost_nothing_and_variances_fit_errors_without_moving_boxes() -> None:
    true = targets()
    code = torch.zeros(len(true.cell), 19)
    code[:, :12] = true.code
    parts = code_losses(code, true)
    assert all(float(parts[name]) < 1e-6 for name in ("place", "size", "yaw", "velocity"))
    wrong = code.clone().requires_grad_()
    code_losses(wrong + torch.tensor([0.3] * 12 + [0.0] * 7), true)["variance"].backward()
    assert not wrong.grad[:, :12].any()
    assert wrong.grad[:, 12:].any()


def test_velocities_count_where_a_sample_shows_them_and_are_not_diluted_by_the_others() -> None:
    moves, shows_none = targets(), make_targets(BOXES, np.ones((2, 2)), np.array([0, 7]), GRID, moves=False)
    none = torch.zeros(len(moves.cell), 19)
    alone, beside = code_losses(none, moves), code_losses(none.repeat(2, 1), join_targets([moves, shows_none]))
    assert float(alone["velocity"]) > 0
    assert float(beside["velocity"]) == float(alone["velocity"])
    assert float(code_losses(none, shows_none)["velocity"]) == 0


def test_joined_targets_are_those_of_a_batch() -> None:
    one, other = targets(), make_targets(BOXES[:1], np.zeros((1, 2)), np.array([0]), GRID)
    both = join_targets([one, other])
    assert both.heat.shape[0] == 2
    assert both.objects == 3
    assert both.cell[len(one.cell) :].tolist() == (other.cell + 20 * 40).tolist()
