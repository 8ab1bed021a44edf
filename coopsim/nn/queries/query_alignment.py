"""Cross-agent alignment (CoopTrack's CAA): received instances as if the receiver had seen them, now."""

from __future__ import annotations

from dataclasses import replace

import torch
from torch import Tensor, nn

from coopsim.geometry.se3 import SE3
from coopsim.nn.attention.delay_code import DelayCode
from coopsim.nn.fusion.feature_fusion import start_as_zeros
from coopsim.nn.queries.instance_attention import mlp
from coopsim.nn.queries.instances import Instances

_FAR_M = 50.0
BLOCK = 16
"""Edge of the blocks of the latent rotation."""


def aligned_boxes(received: Instances, receiver_SE3_sender: SE3, delay_s: float) -> Instances:
    """Align explicitly: move boxes on by their velocities over the delay, and into the receiver's frame (P R^T + t).

    Args:
        received: in the sender's compass frame at capture.
        receiver_SE3_sender: of that frame, in the receiver's compass frame now.
        delay_s: age of the message.
    """
    return received.advanced(delay_s).moved(receiver_SE3_sender)


class LatentAlignment(nn.Module):
    """Align implicitly: turn and shift features by what the motion between two frames is in the space of features.

    With x an instance's features, out = x + proj(in(x) R^T + t + x), where R is a block-diagonal matrix and t a vector
    that two networks make of the explicit motion: R of the first two columns of the rotation (Zhou et al., CVPR 2019,
    six numbers that change continuously), t of the translation and the delay. R begins as the identity, t and proj as
    zeros.

    Args:
        width: channels of an instance; `BLOCK` divides it.
    """

    def __init__(self, width: int) -> None:
        super().__init__()
        self.blocks = width // BLOCK
        self.turn, self.shift = mlp(6, width, width, self.blocks * BLOCK**2), mlp(3, width, width, width)
        self.delay = DelayCode(width)
        self.into = nn.ModuleDict({part: _layer(width) for part in _PARTS})
        self.out = nn.ModuleDict({part: nn.Sequential(_layer(width), nn.Linear(width, width)) for part in _PARTS})
        for net in (self.turn[-1], self.shift[-1], *(each[-1] for each in self.out.values())):  # type: ignore[index]
            start_as_zeros(net)

    def rotation(self, rotation: Tensor) -> Tensor:
        """Return the latent rotation's blocks (D / 16, 16, 16) for a rotation (3, 3)."""
        change = self.turn(rotation[:, :2].T.reshape(6)).view(self.blocks, BLOCK, BLOCK)
        turned: Tensor = torch.eye(BLOCK, device=change.device) + change
        return turned

    def forward(self, received: Instances, receiver_SE3_sender: SE3, delay_s: float) -> Instances:
        """Return the instances with aligned features; arguments as of `aligned_boxes`, boxes stay as they are."""
        like = received.semantic
        blocks = self.rotation(like.new_tensor(receiver_SE3_sender.rotation.tolist()))
        shift = self.shift(like.new_tensor(receiver_SE3_sender.translation.tolist()) / _FAR_M)
        tokens = shift.expand(2, 1, 1, -1)  # of which the second one is the message's
        shift = self.delay(tokens, like.new_tensor([delay_s]))[1, 0, 0]
        made = {}
        for part in _PARTS:
            given = getattr(received, part)
            inner = self.into[part](given).view(-1, self.blocks, BLOCK)
            turned = torch.einsum("kbj,bij->kbi", inner, blocks).flatten(1)
            made[part] = given + self.out[part](turned + shift + given)
        return replace(received, **made)


_PARTS = ("semantic", "motion")


def _layer(width: int) -> nn.Sequential:
    return nn.Sequential(nn.Linear(width, width), nn.LayerNorm(width), nn.ReLU())
