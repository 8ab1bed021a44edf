"""What a receiver fuses in a scene of a stream, by a frozen cooperative network."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from coopsim.geometry.se3 import Floats
from coopsim.learn.samples.query_streams import QueryStream
from coopsim.nn.cooperative.cooperative_net import CooperativeNet
from coopsim.nn.cooperative.feature_flow import LONGEST_S, moved_on
from coopsim.nn.cooperative.warp import warp
from coopsim.nn.fusion import FusionContext, as_batch
from coopsim.types import BevGrid, stack_xyz_yaw

_ROUNDING_S = 1e-6


@dataclass(frozen=True, slots=True, eq=False)
class FusedView:
    """A fused map.

    Attributes:
        features: (C, h, w).
        grid: its cells, in the receiver's compass frame.
    """

    features: Tensor
    grid: BevGrid


@torch.no_grad()
def fused_view(
    net: CooperativeNet, sample: QueryStream, number: int, receiver: int, crop_cells: int | None
) -> FusedView:
    """Return what a receiver makes of its own map and the messages that it has in a scene.

    Late messages are moved to now by the network's flow, if it has one. Agents are all taken for cars.

    Args:
        net: the cooperative network.
        sample: the clip.
        number: of the scene.
        receiver: number of the agent.
        crop_cells: edge of the view, in cells of the features, around the receiver; None: that of its own map.
    """
    own = sample.clip.scenes[number].seen[receiver]
    grid, features = _middle(own.grid, crop_cells), own.features.float()
    inside, own_mask = warp(features[None], own.grid, grid, np.zeros((1, 3)))
    parts, delays = [], []
    for sender in sample.members:
        then = number - int(sample.late[sender])
        if sender != receiver and then >= 0:
            delays.append((number - then) * sample.clip.dt_s)
            values, cells = _message(net, sample, then, sender, delays[-1])
            way = sample.receiver_SE3_sender(number, receiver, sender, then).inverse()
            parts.append(warp(values, cells, grid, stack_xyz_yaw(way)[[0, 1, 3]][None]))
    if not parts:
        return FusedView(inside[0], grid)
    received, mask = torch.cat([each for each, _ in parts]), torch.cat([each for _, each in parts])
    kinds = torch.zeros(len(parts), dtype=torch.long)
    sure, _ = warp(net.confidence(as_batch(features))[None], own.grid, grid, np.zeros((1, 3)))
    context = FusionContext(torch.tensor(delays), kinds, received[:, -1], sure[0, 0])
    return FusedView(net(inside[0], own_mask[0], received[:, :-1], mask, context), grid)


def _message(
    net: CooperativeNet, sample: QueryStream, then: int, sender: int, delay_s: float
) -> tuple[Tensor, BevGrid]:
    """Return what a sender sent in a scene, a delay later, (1, C + 1, h, w) with confidences, and its cells."""
    seen = sample.clip.scenes[then].seen[sender]
    values, sure = net.message(as_batch(seen.features.float()))
    dt_s = sample.clip.dt_s
    if net.flow is not None and delay_s > 0 and then > 0 and dt_s <= LONGEST_S + _ROUNDING_S:
        earlier = sample.clip.scenes[then - 1].seen[sender]
        before, _ = net.message(as_batch(earlier.features.float()))
        placed, known = warp(before, earlier.grid, seen.grid, _before_SE2_then(sample, then, sender)[None])
        change = net.flow(values, placed, known, torch.tensor([dt_s]))
        values = moved_on(values, change, torch.tensor([delay_s]))
    return torch.cat([values, sure[:, None]], dim=1), seen.grid


def _before_SE2_then(sample: QueryStream, then: int, sender: int) -> Floats:
    """Return a sender's compass frame of a scene in that of the scene before: odometry does not err here."""
    shift = sample.clip.scenes[then].place_m[sender] - sample.clip.scenes[then - 1].place_m[sender]
    return np.array([shift[0], shift[1], 0.0])


def _middle(grid: BevGrid, cells: int | None) -> BevGrid:
    """Return the square of so many cells in the middle of a square grid."""
    left = 0 if cells is None else max(0, grid.shape[0] - cells) // 2
    reach_m = left * grid.cell_m
    (x_low, x_high), (y_low, y_high) = grid.x_m, grid.y_m
    return BevGrid((x_low + reach_m, x_high - reach_m), (y_low + reach_m, y_high - reach_m), grid.cell_m)
