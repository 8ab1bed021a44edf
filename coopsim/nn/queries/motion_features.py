"""Features of how an object stands and moves, from its box and velocity alone (CoopTrack's MDFE)."""

from __future__ import annotations

import torch
from torch import Tensor, nn

_CORNERS = torch.tensor([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)])
_FAST_M_S = 10.0


class MotionFeatures(nn.Module):
    """Encode a box's eight corners, seen from its middle, as a set of points, and its heading and velocity.

    Args:
        width: channels of the result.
    """

    def __init__(self, width: int) -> None:
        super().__init__()
        self.corners, self.speed = _layers(3, width), _layers(4, width)
        self.join = nn.Sequential(nn.Linear(2 * width, width), nn.LayerNorm(width), nn.ReLU())

    def forward(self, box: Tensor, velocity: Tensor) -> Tensor:
        """Return (K, width) of boxes (K, 7) and velocities (K, 2) m/s."""
        yaw = box[:, 6]
        speed = torch.column_stack([yaw.cos(), yaw.sin(), velocity / _FAST_M_S])
        shape = self.corners(corners(box)).amax(1)
        features: Tensor = self.join(torch.cat([shape, self.speed(speed)], dim=1))
        return features


def corners(box: Tensor) -> Tensor:
    """Return the corners (K, 8, 3) m of boxes (K, 7), seen from their middles."""
    x, y, z = (box[:, None, 3:6] * _CORNERS.to(box)).unbind(-1)
    cos, sin = box[:, 6:].cos(), box[:, 6:].sin()
    return torch.stack([cos * x - sin * y, sin * x + cos * y, z], dim=-1)


def _layers(inputs: int, width: int) -> nn.Sequential:
    layers: list[nn.Module] = []
    for before in (inputs, width, width):
        layers += [nn.Linear(before, width), nn.LayerNorm(width), nn.ReLU()]
    return nn.Sequential(*layers)
