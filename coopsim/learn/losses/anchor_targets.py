"""Which anchors are objects: the assignment of truth to anchors, and what the anchor head shall say of them.

The overlap is that of upright rectangles, as in SECOND and OpenCOOD. It separates into x and y, so that all pairs of
truth and anchors cost one product each.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from coopsim.errors import InvalidValueError
from coopsim.geometry.se3 import Floats
from coopsim.nn.detector.anchor_head import upright_extent
from coopsim.nn.detector.anchors import AnchorConfig, anchor_boxes, encode_relative
from coopsim.support.arrays import Ints, frozen, require_finite
from coopsim.support.checks import require_threshold
from coopsim.types import BevGrid

_Map = NDArray[np.float32]

_EQUAL = 1e-6
"""IoUs that differ by less are equal but for rounding."""


@dataclass(frozen=True, slots=True)
class AnchorAssignment:
    """From which overlap an anchor is an object, or none.

    Attributes:
        positive_iou: above it an anchor is an object.
        negative_iou: below it an anchor is none.
        between: what an anchor between the two is: "negative", as OpenCOOD takes it, or "ignored", as HEAL does.
    """

    positive_iou: float = 0.6
    negative_iou: float = 0.45
    between: str = "negative"

    def __post_init__(self) -> None:
        require_threshold(positive_iou=self.positive_iou, negative_iou=self.negative_iou)
        if self.negative_iou > self.positive_iou:
            raise InvalidValueError(f"negative_iou {self.negative_iou} must be <= positive_iou {self.positive_iou}")
        if self.between not in ("negative", "ignored"):
            raise InvalidValueError(f'between must be "negative" or "ignored", got {self.between!r}')


@dataclass(frozen=True, slots=True, eq=False)
class AnchorTargets:
    """What the head shall say, of B samples with A anchors per cell. P anchors are objects.

    Attributes:
        role: (B, A, h, w) int8: 1 an object, 0 none, -1 not to be counted.
        index: (P,) int64 numbers of the objects in the flattened role.
        codes: (P, 7) float32.
        backwards: (P,) bool: the object looks the other way than its anchor.
    """

    role: Tensor
    index: Tensor
    codes: Tensor
    backwards: Tensor

    def to(self, device: torch.device | str) -> AnchorTargets:
        """Return the targets on a device."""
        return AnchorTargets(*(each.to(device) for each in (self.role, self.index, self.codes, self.backwards)))


def anchor_targets(
    boxes: Floats, grid: BevGrid, config: AnchorConfig | None = None, assignment: AnchorAssignment | None = None
) -> AnchorTargets:
    """Return the targets of one sample (B = 1).

    An anchor is an object if it overlaps a true box by more than `positive_iou`, and is then the one that it overlaps
    most; further, each true box has the anchor that overlaps it most, of several the one whose centre is nearest. A box
    that no anchor touches, as one beyond the grid, has none.

    Args:
        boxes: (N, 7) true boxes in the grid's frame.
        grid: of the features.
        config: the anchors; None: the defaults.
        assignment: thresholds; None: the defaults.

    Raises:
        InvalidValueError: a box is not finite, or has no size.
    """
    anchors, rule = config or AnchorConfig(), assignment or AnchorAssignment()
    truth = _checked(boxes)
    overlap = _overlaps(truth, grid, anchors)
    owner = _owners(truth, overlap, grid, anchors, rule)
    role = np.where(owner >= 0, 1, 0).astype(np.int8)
    if rule.between == "ignored" and len(truth):
        role[(owner < 0) & (overlap.max(axis=0) >= rule.negative_iou)] = -1
    index = np.flatnonzero(owner >= 0)
    own = truth[owner.reshape(-1)[index]]
    at = anchor_boxes(grid, anchors, index)
    codes = encode_relative(torch.from_numpy(own), torch.from_numpy(at))
    return AnchorTargets(
        torch.from_numpy(role)[None], torch.from_numpy(index), codes.float(), torch.cos(codes[:, 6]) < 0
    )


def join_anchor_targets(samples: Sequence[AnchorTargets]) -> AnchorTargets:
    """Join the targets of samples on one grid."""
    size = samples[0].role[0].numel()
    starts = np.cumsum([0, *(len(each.role) * size for each in samples[:-1])]).tolist()
    return AnchorTargets(
        torch.cat([each.role for each in samples]),
        torch.cat([each.index + start for each, start in zip(samples, starts, strict=True)]),
        torch.cat([each.codes for each in samples]),
        torch.cat([each.backwards for each in samples]),
    )


def _checked(boxes: Floats) -> Floats:
    truth = np.array(frozen(boxes, (None, 7), np.float64, "true boxes"))
    require_finite(truth, "true boxes")
    if len(truth) and truth[:, 3:6].min() <= 0:
        raise InvalidValueError(f"true boxes: sizes must be > 0 m, got {truth[:, 3:6].min()}")
    return truth


def _overlaps(truth: Floats, grid: BevGrid, config: AnchorConfig) -> _Map:
    """Return the IoU (N, A, h, w) of the upright rectangles around true boxes (N, 7) and all anchors."""
    size = np.tile([0.0, 0, 0, *config.size_m, 0], (len(config.yaw_rad), 1))
    size[:, 6] = config.yaw_rad
    own, extent = upright_extent(truth), upright_extent(size)
    x, y = (_shared(truth[:, axis], own[:, axis], _centres(grid, axis), extent[:, axis]) for axis in (0, 1))
    common = y[:, :, :, None] * x[:, :, None, :]
    area = (own.prod(axis=1)[:, None] + extent.prod(axis=1)).astype(np.float32)
    result: _Map = common / (area[:, :, None, None] - common)
    return result


def _shared(at: Floats, length: Floats, centres: Floats, anchor_length: Floats) -> _Map:
    """Return the length (N, A, K) m that N intervals share with those of A anchors at K centres on a line."""
    low = np.maximum((at - length / 2)[:, None, None], centres - anchor_length[:, None] / 2)
    high = np.minimum((at + length / 2)[:, None, None], centres + anchor_length[:, None] / 2)
    shared: _Map = np.maximum(high - low, 0).astype(np.float32)
    return shared


def _centres(grid: BevGrid, axis: int) -> Floats:
    """Return the middles of the cells along x (axis 0) or y (axis 1)."""
    start = (grid.x_m, grid.y_m)[axis][0]
    centres: Floats = start + (np.arange(grid.shape[1 - axis], dtype=np.float64) + 0.5) * grid.cell_m
    return centres


def _owners(truth: Floats, overlap: _Map, grid: BevGrid, config: AnchorConfig, rule: AnchorAssignment) -> Ints:
    """Return the row of the true box that each anchor (A, h, w) is, or -1."""
    if not len(truth):
        return np.full((len(config.yaw_rad), *grid.shape), -1, dtype=np.int64)
    most = overlap.max(axis=0)
    owner = np.where(most > rule.positive_iou, overlap.argmax(axis=0), -1)
    best = overlap.max(axis=(1, 2, 3))
    along, across = (truth[:, axis, None] - _centres(grid, axis) for axis in (0, 1))
    apart = across[:, :, None] ** 2 + along[:, None, :] ** 2
    tied = overlap >= best[:, None, None, None] - _EQUAL
    nearest = np.where(tied, apart[:, None], np.inf).reshape(len(truth), -1).argmin(axis=1)
    # By rising IoU: of two boxes with one best anchor, the one that overlaps it more has it.
    order = np.argsort(best, kind="stable")
    order = order[best[order] > 0]
    owner.reshape(-1)[nearest[order]] = order
    return owner
