"""A second look at found boxes: which end is the front, and how well they fit (CenterPoint, section 4.2)."""

from __future__ import annotations

import torch
from torch import Tensor, nn
from torch.nn import functional

from coopsim.nn.covariance.covariance_net import PLACES, patch_places
from coopsim.types import BevGrid

_HIDDEN = (128, 64)


class BoxJudge(nn.Module):
    """A small network on the features in and around a box, at places that turn with it.

    The way round is odd under half a turn of the box: a box and the same one backwards have opposite ones. The fit is
    even. A map's axes do not matter to either, so a street in one direction teaches those of all others.

    Args:
        channels: channels of the features.
        fits: it also judges how well a box fits.
    """

    def __init__(self, channels: int, *, fits: bool = True) -> None:
        super().__init__()
        self.channels = channels
        first, second = _HIDDEN
        self.layers = nn.Sequential(
            nn.Linear(PLACES**2 * channels, first),
            nn.ReLU(),
            nn.Linear(first, second),
            nn.ReLU(),
            nn.Linear(second, 1 + fits),
        )

    def forward(self, patches: Tensor) -> tuple[Tensor, Tensor | None]:
        """Return logits (N,) of `box_patches` (N, 9 C): the box is the right way round, and it fits.

        The latter is of the quality min(1, max(0, 2 IoU - 0.5)), and None without `fits`.
        """
        patches = patches.float()
        backwards = patches.view(len(patches), PLACES**2, self.channels).flip(1).flatten(1)
        with torch.autocast(patches.device.type, enabled=False):
            one, other = self.layers(patches), self.layers(backwards)
        fits = one[:, 1] + other[:, 1] if one.shape[1] > 1 else None
        return one[:, 0] - other[:, 0], fits


def turned_round(boxes: Tensor, forward: Tensor) -> Tensor:
    """Return boxes (N, 7), those with a negative logit `forward` (N,) turned by half a turn."""
    yaw = boxes[:, 6] + torch.pi * (forward < 0)
    return torch.cat([boxes[:, :6], torch.atan2(torch.sin(yaw), torch.cos(yaw))[:, None]], dim=1)


def patches_of(features: Tensor, boxes: Tensor, number: Tensor, grid: BevGrid) -> Tensor:
    """Return `box_patches` (N, 9 C) of boxes (N, 7) in the maps (A, C, h, w) of these numbers (N,).

    All maps are looked at together, in as many rows as the fullest needs: a GPU waits for each call.
    """
    if not len(boxes):
        return features.new_zeros(0, PLACES**2 * features.shape[1])
    count = torch.bincount(number, minlength=len(features))
    order = torch.argsort(number, stable=True)
    row = torch.empty_like(number)
    row[order] = torch.arange(len(number), device=number.device) - (count.cumsum(0) - count)[number[order]]
    rows = boxes.new_zeros(len(features), int(count.max()), boxes.shape[1]).to(features.dtype)
    rows[number, row] = boxes.to(features.dtype)
    found = functional.grid_sample(features, patch_places(rows, grid), align_corners=False)  # (A, C, n, 9)
    return found[number, :, row].transpose(1, 2).flatten(1)
