"""Losses of motions: of full size, and not diluted by what stands."""

from __future__ import annotations

import torch

from coopsim.learn.losses.street_losses import motion_loss


def test_motions_of_what_moves_are_not_diluted_by_what_stands() -> None:
    moving, silent = torch.tensor([[10.0, 0.0]]), torch.zeros(1, 2)
    assert motion_loss(moving, moving) == 0
    alone = motion_loss(silent, moving)
    assert motion_loss(0.1 * moving, moving) > 0.8 * alone > 0.5
    assert motion_loss(silent[:0], moving[:0]) == 0
    for others in (2, 9):
        stand = torch.zeros(others, 2)
        both = motion_loss(torch.zeros(1 + others, 2), torch.cat([moving, stand]))
        torch.testing.assert_close(both, alone)


def test_speeds_of_what_stands_count_half() -> None:
    still = torch.zeros(4, 2)
    error = torch.tensor([[1.0, 0.0]]).expand(4, 2)
    torch.testing.assert_close(motion_loss(error, still), torch.tensor(0.5 * 0.95))
