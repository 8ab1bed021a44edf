"""The encoder of points and pictures together, as DINO-CoDT (He et al., 2025, section III-C) has it.

Depths of pictures are predicted, and corrected by the depths that points measure: a *depth mask*. Points may be of
several agents; a measured depth weighs only as much as the prediction finds it possible, since another agent's point
may be hidden from the camera. What was laid on the canvas of pictures is then merged with that of points.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import torch
from torch import Tensor, nn
from torch.nn import functional

from coopsim.errors import InvalidValueError
from coopsim.nn.camera.lift_splat import LiftSplatConfig, PictureCanvas
from coopsim.nn.camera.picture_batch import PictureBatch
from coopsim.nn.camera.picture_net import DepthBins, PictureFeatures
from coopsim.nn.detector.detector_net import CentreHead
from coopsim.nn.detector.encoder import PillarEncoder
from coopsim.nn.detector.pillars import PillarBatch
from coopsim.support.checks import require_count

_TRUST = 4.0
"""Logit by which a fresh network prefers a measured depth."""


@dataclass(frozen=True, slots=True)
class PointsAndPicturesConfig:
    """Sizes of the encoder.

    Attributes:
        pictures: sizes of the encoder of pictures; its maps are those of the encoder of points, too.
        experts: kernels of each conditional convolution.
    """

    pictures: LiftSplatConfig = field(default_factory=LiftSplatConfig)
    experts: int = 4

    def __post_init__(self) -> None:
        require_count(1, 64, experts=self.experts)


class PointsAndPicturesEncoder(nn.Module):
    """The encoder of points, on whose canvas pictures are laid as well. Without pictures it is that encoder alone."""

    def __init__(self, config: PointsAndPicturesConfig | None = None) -> None:
        super().__init__()
        self.config = config = config or PointsAndPicturesConfig()
        self.points = PillarEncoder(config.pictures.maps)
        self.pictures = PictureCanvas(config.pictures)
        self.trust = nn.Parameter(torch.tensor(_TRUST))
        self.merge = ConditionalMerge(config.pictures.maps.pillar_features, config.experts)

    def forward(self, points: PillarBatch, pictures: PictureBatch) -> Tensor:
        """Return features (A, C, H / 2, W / 2), not negative, of the points and pictures of the same A agents.

        Raises:
            InvalidValueError: rows or columns of the canvas do not divide by 8, or points and pictures are of different
                numbers of agents or shapes of canvases.
        """
        return self.of_canvas(points, pictures, self.read(pictures))

    def read(self, pictures: PictureBatch) -> list[PictureFeatures]:
        """Return what is seen in each group of pictures, with depths as points correct them."""
        seen = self.pictures.read(pictures)
        return [
            masked_depth(each, views.measured_m, self.trust, self.config.pictures.bins)
            for each, views in zip(seen, pictures.views, strict=True)
        ]

    def of_canvas(self, points: PillarBatch, pictures: PictureBatch, seen: list[PictureFeatures]) -> Tensor:
        """Return the features of points, and of what was seen in pictures; shapes and errors as of `forward`."""
        if (points.clouds, points.shape) != (pictures.agents, pictures.shape):
            raise InvalidValueError(
                "points and pictures must be of the same agents and canvases, got "
                f"{points.clouds} of {points.shape} and {pictures.agents} of {pictures.shape}"
            )
        canvas = self.points.canvas(points)
        laid = self.pictures.canvas(pictures, seen).to(canvas)
        return self.points.of_canvas(self.merge(canvas, laid, confidences(canvas, pictures, seen)))


def masked_depth(seen: PictureFeatures, measured_m: Tensor, trust: Tensor, bins: DepthBins) -> PictureFeatures:
    """Return the features of M pictures, with the logits of measured depths (M, h, w) raised by `trust`; 0: not
    measured.
    """
    known = bins.shares(measured_m) * (measured_m > 0)[:, None]
    return PictureFeatures(seen.features, seen.depth + (trust * known).to(seen.depth), seen.label)


def confidences(canvas: Tensor, pictures: PictureBatch, seen: list[PictureFeatures]) -> Tensor:
    """Return how sure points and pictures are, (A, 4); see `CONFIDENCES`. Agents without pictures have zeros there."""
    out = canvas.new_zeros(len(canvas), CONFIDENCES, dtype=torch.float32)
    out[:, 0] = 10 * (canvas.detach() != 0).any(1).float().mean((1, 2))
    count = out.new_zeros(len(canvas))
    for views, each in zip(pictures.views, seen, strict=True):
        sure = each.depth.detach().float().softmax(1).amax(1).mean((1, 2))
        light = views.rgb.float() / 255
        stated = torch.stack([sure, light.mean((1, 2, 3)), 2 * light.std((1, 2, 3))], 1)
        out[:, 1:] = out[:, 1:].index_add(0, views.agent, stated)
        count = count.index_add(0, views.agent, torch.ones_like(sure))
    out[:, 1:] /= count.clamp_min(1)[:, None]
    return out


CONFIDENCES = 4
"""Length of s: ten times the share of cells with points; mean over pictures of the largest share of a bin of depth;
brightness of pictures; twice the standard deviation of their pixels."""


class ConditionalConv(nn.Module):
    """1 x 1 convolution whose kernel is a mixture of E, with weights for each sample: W = sum_e r_e W_e, r = sigmoid(R
    s) (Yang et al., "CondConv: Conditionally Parameterized Convolutions for Efficient Inference", NeurIPS 2019, eq. 1).
    """

    def __init__(self, before: int, after: int, experts: int) -> None:
        super().__init__()
        self.kernels = nn.Parameter(torch.empty(experts, after, before))
        self.biases = nn.Parameter(torch.zeros(experts, after))
        self.route = nn.Linear(CONFIDENCES, experts)
        for kernel in self.kernels.data:
            nn.init.kaiming_uniform_(kernel, a=5**0.5)

    def forward(self, maps: Tensor, confidences: Tensor) -> Tensor:
        """Convolve maps (A, before, H, W) by the kernels of confidences (A, 4). Return (A, after, H, W)."""
        weights = self.route(confidences).sigmoid().to(self.kernels.dtype)
        kernels = torch.einsum("ae,eok->aok", weights, self.kernels)
        biases = weights @ self.biases
        each = [
            functional.conv2d(maps[number : number + 1], kernel[:, :, None, None].to(maps.dtype), bias.to(maps.dtype))
            for number, (kernel, bias) in enumerate(zip(kernels, biases, strict=True))
        ]
        return torch.cat(each)


class ConditionalMerge(nn.Module):
    """Add a canvas of pictures to a canvas of points, by kernels that depend on the confidences of both. A fresh one
    adds nothing.

    DINO-CoDT (He et al., 2025, section III-C) merges the voxels of both by "confidence-aware fusion with conditional
    convolutions", without an equation.
    """

    def __init__(self, channels: int, experts: int = 4) -> None:
        super().__init__()
        self.first = ConditionalConv(2 * channels, channels, experts)
        self.second = ConditionalConv(channels, channels, experts)
        nn.init.zeros_(self.second.kernels)

    def forward(self, points: Tensor, pictures: Tensor, confidences: Tensor) -> Tensor:
        """Merge canvases (A, C, H, W) of both; where no picture laid anything, that of points stays as it is."""
        hidden = functional.relu(self.first(torch.cat([points, pictures], 1), confidences))
        laid = (pictures != 0).any(1, keepdim=True)
        merged: Tensor = points + self.second(hidden, confidences) * laid
        return merged


class PointsAndPicturesNet(nn.Module):
    """An encoder of points and pictures and the head on its features; state: `encoder.*`, `head.*`."""

    def __init__(self, config: PointsAndPicturesConfig | None = None) -> None:
        super().__init__()
        self.config = config or PointsAndPicturesConfig()
        self.encoder = PointsAndPicturesEncoder(self.config)
        self.head = CentreHead(self.config.pictures.features)
