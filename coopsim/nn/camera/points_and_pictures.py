"""The encoder of points and pictures together, as DINO-CoDT (He et al., 2025, section III-C) has it.

Depths of pictures are predicted, and corrected by the depths that points measure: a *depth mask*. Points may be of
several agents; a measured depth weighs only as much as the prediction finds it possible, since another agent's point
may be hidden from the camera. What was laid on the canvas of pictures is then merged with that of points.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import torch
from torch import Tensor, nn

from coopsim.errors import InvalidValueError
from coopsim.nn.camera.conditional_merge import CONFIDENCES, ConditionalMerge
from coopsim.nn.camera.depth_bins import DepthBins
from coopsim.nn.camera.lift_splat import LiftSplatConfig, PictureCanvas
from coopsim.nn.camera.picture_batch import PictureBatch
from coopsim.nn.camera.picture_net import PictureFeatures
from coopsim.nn.detector.encoder import PillarEncoder
from coopsim.nn.detector.pillars import PillarBatch
from coopsim.support.checks import require_count

_TRUST = 4.0
"""Logit by which a fresh network prefers a measured depth."""


@dataclass(frozen=True, slots=True)
class PointsAndPicturesConfig:
    """Sizes of the encoder.

    Attributes:
        pictures: of the part that reads pictures; its maps are those of the encoder of points, too.
        experts: kernels of each conditional convolution.
    """

    pictures: LiftSplatConfig = field(default_factory=LiftSplatConfig)
    experts: int = 4

    def __post_init__(self) -> None:
        require_count(1, 64, experts=self.experts)


class PointsAndPicturesEncoder(nn.Module):
    """The encoder of points, on whose canvas pictures are laid as well. Without pictures it is that encoder alone.

    Args:
        config: its sizes.
    """

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
        return self.of_canvas(points, pictures, self.look(pictures))

    def look(self, pictures: PictureBatch) -> list[PictureFeatures]:
        """Return what is seen in each group of pictures, with depths as points correct them."""
        seen = self.pictures.look(pictures)
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
    """Return what is seen, with the logits of measured depths raised.

    Args:
        seen: in M pictures.
        measured_m: (M, h, w); 0: nothing was measured.
        trust: () by how much.
        bins: of depth.
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
