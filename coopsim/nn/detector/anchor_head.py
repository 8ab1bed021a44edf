"""The anchor head of PointPillars as OpenCOOD has it: for rows that are made as its rows are. One class, no covariance.

See `coopsim.nn.detector.centre_head` for the head that finds all classes.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor, nn

from coopsim.geometry.boxes import Boxes3D
from coopsim.geometry.nms import nms_bev
from coopsim.geometry.se3 import Floats, wrap_angle
from coopsim.nn.detector.anchors import CODE, AnchorConfig, anchor_boxes, decode_relative, turn_to_side
from coopsim.support.checks import require_count, require_positive, require_probability, require_threshold
from coopsim.types import BevGrid, Detections, ObjectClass

_RARE = 0.01
"""Probability of an object that an untrained head states, so that the many empty anchors do not drown the loss (Lin et
al., "Focal Loss for Dense Object Detection", ICCV 2017, section 3.3)."""

_LONGEST_LOG = math.log(20.0)
"""Sizes beyond 20 times the anchor's are an untrained network's: no exponent overflows."""


class AnchorMaps(NamedTuple):
    """What the head says of each of A anchors at each of h x w cells, of B samples.

    Attributes:
        logits: (B, A, h, w) of an object.
        codes: (B, A, 7, h, w) of its box, see `coopsim.nn.detector.anchors`.
        backwards: (B, A, 2, h, w) logits of looking the anchor's way and the other; None: no direction classifier.
    """

    logits: Tensor
    codes: Tensor
    backwards: Tensor | None


@dataclass(frozen=True, slots=True)
class AnchorDecoding:
    """How anchors become detections. The defaults are OpenCOOD's, but for `most_extent_m`.

    Attributes:
        least_score: below it no detection.
        most: candidates that take part in the suppression, the surest ones.
        nms_iou: rotated BEV IoU from which the worse of two boxes is left out.
        most_extent_m: boxes whose upright bounding rectangle in the grid's axes is longer or wider are left out.
            OpenCOOD's is 6, so that it can report no bus, no truck, and no car of 4.6 m by 2 m on the diagonal; None:
            no limit.
    """

    least_score: float = 0.2
    most: int = 1000
    nms_iou: float = 0.15
    most_extent_m: float | None = None

    def __post_init__(self) -> None:
        require_probability(least_score=self.least_score)
        require_threshold(nms_iou=self.nms_iou)
        require_count(1, most=self.most)
        if self.most_extent_m is not None:
            require_positive(most_extent_m=self.most_extent_m)


class AnchorHead(nn.Module):
    """Score, box and direction of anchors, by one 1x1 convolution of the features.

    Args:
        channels: of the features.
        config: the anchors.
        direction: with a classifier of which way a box looks, as HEAL has it. Without it, as OpenCOOD has it, headings
            are known but for half a turn.
        label: class of the detections.
    """

    def __init__(
        self,
        channels: int = 64,
        config: AnchorConfig | None = None,
        *,
        direction: bool = True,
        label: int = ObjectClass.CAR,
    ) -> None:
        super().__init__()
        self.config, self.direction, self.label = config or AnchorConfig(), direction, int(label)
        self.anchors_per_cell = len(self.config.yaw_rad)
        self.outputs = 1 + CODE + (2 if direction else 0)
        self.out = nn.Conv2d(channels, self.anchors_per_cell * self.outputs, 1)
        with torch.no_grad():
            assert self.out.bias is not None
            self.out.bias.zero_()
            self.out.bias.view(self.anchors_per_cell, self.outputs)[:, 0] = -math.log((1 - _RARE) / _RARE)

    def forward(self, features: Tensor) -> AnchorMaps:
        """Return the head's maps, in float32, of features (B, C, h, w)."""
        out = self.out(features).float().unflatten(1, (self.anchors_per_cell, self.outputs))
        backwards = out[:, :, 1 + CODE :] if self.direction else None
        return AnchorMaps(out[:, :, 0], out[:, :, 1 : 1 + CODE], backwards)

    @torch.no_grad()
    def decode(self, features: Tensor, grid: BevGrid, decoding: AnchorDecoding | None = None) -> list[Detections]:
        """Return the detections in the grid's frame of each of B samples, best score first.

        Args:
            features: (B, C, h, w).
            grid: of the features: h rows, w columns.
            decoding: thresholds; None: the defaults.
        """
        logits, codes, backwards = self(features)
        return [
            self._detections(
                AnchorMaps(logits[k], codes[k], None if backwards is None else backwards[k]), grid, decoding
            )
            for k in range(len(features))
        ]

    def _detections(self, maps: AnchorMaps, grid: BevGrid, decoding: AnchorDecoding | None) -> Detections:
        """Return the detections of one sample, whose maps lack the first dimension."""
        rule = decoding or AnchorDecoding()
        score = torch.sigmoid(maps.logits).flatten()
        index = torch.nonzero(score > rule.least_score).squeeze(1)
        if len(index) > rule.most:
            index = index[torch.topk(score[index], rule.most).indices]
        boxes, chosen = self._boxes(maps, index, grid), score[index].double().cpu().numpy()
        if rule.most_extent_m is not None:
            within = (upright_extent(boxes) <= rule.most_extent_m).all(axis=1)
            boxes, chosen = boxes[within], chosen[within]
        kept = nms_bev(boxes, chosen, rule.nms_iou)
        label = np.full(len(kept), self.label, dtype=np.int64)
        return Detections(Boxes3D.from_array(boxes[kept]), chosen[kept], label)

    def _boxes(self, maps: AnchorMaps, index: Tensor, grid: BevGrid) -> Floats:
        """Return the boxes (K, 7) of the anchors with numbers (K,), headings in [-pi, pi)."""
        codes = maps.codes.movedim(1, -1).reshape(-1, CODE)[index].double().cpu()
        codes[:, 3:6] = codes[:, 3:6].clamp(-_LONGEST_LOG, _LONGEST_LOG)
        if maps.backwards is not None:
            side = maps.backwards.movedim(1, -1).reshape(-1, 2)[index].cpu()
            codes[:, 6] = turn_to_side(codes[:, 6], side[:, 1] > side[:, 0])
        anchors = torch.from_numpy(anchor_boxes(grid, self.config, index.cpu().numpy()))
        boxes: Floats = decode_relative(codes, anchors).numpy()
        boxes[:, 6] = wrap_angle(boxes[:, 6])
        return boxes


def upright_extent(boxes: Floats) -> Floats:
    """Return the sides (N, 2) m along x and y of the smallest upright rectangles around footprints of boxes (N, 7)."""
    cos, sin = np.abs(np.cos(boxes[:, 6])), np.abs(np.sin(boxes[:, 6]))
    length, width = boxes[:, 3], boxes[:, 4]
    return np.column_stack([length * cos + width * sin, length * sin + width * cos])
