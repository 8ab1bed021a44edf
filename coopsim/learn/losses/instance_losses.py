"""Losses of instances: of queries (classes, boxes, association of two agents) and of integrated tracking's branches."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional

from coopsim.geometry.assignment import hungarian
from coopsim.learn.samples.query_streams import TrueObjects
from coopsim.nn.detector.decode import GROUP_OF_LABEL
from coopsim.nn.integrated.integrated_net import IntegratedStep
from coopsim.nn.queries.cooptrack_fusion import ComparedInstances
from coopsim.nn.queries.instance_fusion import IMPOSSIBLE
from coopsim.nn.queries.instances import Instances

LABEL_REACH_M = 3.0
"""Largest distance on the ground of an instance and its object."""

_FAST_M_S = 10.0
_VELOCITY = 0.2
"""Weight of the two numbers of the velocity; those of the others are 1."""


@dataclass(frozen=True, slots=True, eq=False)
class LabelledInstances:
    """Instances that are of an object: numbers (P,) of the instances, and of their objects."""

    rows: Tensor
    objects: Tensor

    def shown(self, truth: TrueObjects) -> LabelledInstances:
        """Return those whose objects are to be found."""
        kept = truth.shown[self.objects]
        return LabelledInstances(self.rows[kept], self.objects[kept])

    def by_row(self, count: int) -> Tensor:
        """Return the object of each of `count` instances, (count,), or -1."""
        found = self.rows.new_full((count,), -1)
        found[self.rows] = self.objects
        return found


def labelled(known: Instances, truth: TrueObjects) -> LabelledInstances:
    """Match instances with objects of their group of classes by the distances of their centres (Hungarian)."""
    away = torch.cdist(known.box[:, :2].detach(), truth.box[:, :2]).double().cpu().numpy()
    group, others = (GROUP_OF_LABEL[each.label.cpu().numpy()] for each in (known, truth))
    possible = (away <= LABEL_REACH_M) & (group[:, None] == others)
    pairs = hungarian(np.where(possible, -away, -np.inf), -np.inf)
    return LabelledInstances(*(torch.from_numpy(each).to(known.box.device) for each in pairs))


def instance_losses(
    known: Instances, logits: Tensor, truth: TrueObjects, labels: LabelledInstances
) -> dict[str, Tensor]:
    """Return the losses of K instances with class logits (K, 9) by name, for each object that is to be found.

    Classes have `class_loss`, boxes L1 of x, y, z (m), logs of sizes, sine of the yaw's error, and velocity (10 m/s).
    """
    found = labels.shown(truth)
    rows, objects = found.rows, found.objects
    box, true = known.box[rows], truth.box[objects]
    errors = torch.cat(
        [
            (box[:, :3] - true[:, :3]).abs(), torch.log(box[:, 3:6] / true[:, 3:6]).abs(),
            torch.sin(box[:, 6:] - true[:, 6:]).abs(),
            _VELOCITY * (known.velocity[rows] - truth.velocity[objects]).abs() / _FAST_M_S,
        ],
        dim=1,
    )  # fmt: skip
    return {"instance class": class_loss(logits, truth, labels), "instance box": errors.sum() / max(len(rows), 1)}


def class_loss(logits: Tensor, truth: TrueObjects, labels: LabelledInstances) -> Tensor:
    """Return the focal loss (Lin et al., ICCV 2017, alpha 0.25, gamma 2) of class logits (K, 9), per object.

    Instances of objects that are not to be found do not count.
    """
    found = labels.shown(truth)
    counted = torch.ones(len(logits), dtype=torch.bool, device=logits.device)
    counted[labels.rows[~truth.shown[labels.objects]]] = False
    target = torch.zeros_like(logits)
    target[found.rows, truth.label[found.objects]] = 1.0
    return focal_loss(logits, target, alpha=0.25, gamma=2.0)[counted].sum() / max(len(found.rows), 1)


def association_loss(compared: ComparedInstances, own: LabelledInstances, others: LabelledInstances) -> Tensor:
    """Return the focal loss (alpha 0.5, gamma 1) of pairs of instances, per pair of one object."""
    mine, theirs = own.by_row(len(compared.own)), others.by_row(len(compared.others))
    same = (mine[:, None] == theirs) & (mine >= 0)[:, None]
    near = compared.logits > IMPOSSIBLE
    loss = focal_loss(compared.logits[near], same[near].float(), alpha=0.5, gamma=1.0)
    return loss.sum() / max(int((same & near).sum()), 1)


def focal_loss(logits: Tensor, target: Tensor, alpha: float, gamma: float) -> Tensor:
    """Return the focal loss of each logit, whose target is 0 or 1 (Lin et al., eq. 5)."""
    right = torch.where(target > 0.5, logits, -logits)
    weight = torch.where(target > 0.5, alpha, 1 - alpha)
    return -weight * (1 - right.sigmoid()) ** gamma * functional.logsigmoid(right)


@dataclass(frozen=True, slots=True, eq=False)
class TaughtFrame:
    """A frame of a receiver: the network's step, the objects around, and the objects of the tracks before."""

    step: IntegratedStep
    truth: TrueObjects
    same: LabelledInstances


def frame_losses(taught: TaughtFrame) -> dict[str, Tensor]:
    """Return the losses of a frame of integrated tracking by name.

    Classes have the focal loss, in which s_t is to be high for tracks whose object any agent sees now. Boxes have 1 -
    XIOU ("xiou") or, for comparison, 1 - (GIoU + 1) / 2 ("giou"), which is the same but for headings; velocities L1
    (10 m/s), turns by half a circle cross entropy ("turn"). Predictions of hidden objects learn boxes, no class.
    """
    step, truth = taught.step, taught.truth
    labels = labelled(step.detected, truth)
    parts = {
        "detection class": class_loss(step.detected_logits, truth, labels),
        "prediction class": class_loss(step.predicted_logits, truth, taught.same.shown(truth)),
    }
    branches = (
        (step.detected, step.detected_turn, labels.shown(truth)),
        (step.predicted, step.predicted_turn, taught.same),
    )
    for known, turn, pairs in branches:
        for name, part in _box_losses(known, turn, truth, pairs).items():
            parts[name] = parts.get(name, 0.0) + part
    return parts


def _box_losses(known: Instances, turn: Tensor, truth: TrueObjects, pairs: LabelledInstances) -> dict[str, Tensor]:
    total = max(len(pairs.rows), 1)
    box, true = known.box[pairs.rows], truth.box[pairs.objects]
    giou = (giou_of_pairs(box, true) + 1) / 2
    agree = (torch.cos(box[:, 6] - true[:, 6]) + 1) / 2
    apart = (known.velocity[pairs.rows] - truth.velocity[pairs.objects]).abs() / _FAST_M_S
    logits = turn[pairs.rows]
    asked = box[:, 6].detach() - torch.pi * (logits > 0)
    wrong = (torch.cos(asked - true[:, 6]) < 0).to(logits)
    turned = functional.binary_cross_entropy_with_logits(logits, wrong, reduction="sum")
    errors = {"xiou": 1 - giou * agree, "giou": 1 - giou, "speed": apart, "turn": turned}
    return {name: each.sum() / total for name, each in errors.items()}


_PARALLEL = 1e-9
"""Sides whose direction differs by less run beside a line, or on it."""


def xiou_of_pairs(first: Tensor, second: Tensor) -> Tensor:
    """Return the XIOU (N,), in [0, 1], of boxes (N, 7) and (N, 7), as `coopsim.geometry.iou.xiou` has it.

    Source: Hu, Wang and Wang, eq. 19-23; boxes are x, y, z, l, w, h, yaw.
    """
    agree = torch.cos(first[:, 6].double() - second[:, 6].double()) + 1
    return (giou_of_pairs(first, second).double() + 1).mul(agree).div(4).to(first.dtype)


def giou_of_pairs(first: Tensor, second: Tensor) -> Tensor:
    """Return the 3D GIoU (N,), in (-1, 1], of boxes (N, 7) and (N, 7), as `coopsim.geometry.iou.giou_3d` has it.

    It is computed in double precision: where boxes are alike, sides run on sides, and rounding decides what is inside.
    """
    kind = first.dtype
    first, second = first.double(), second.double()
    area, hull = _shared_area(first, second), _hull_area(first, second)
    rise, half, other = second[:, 2] - first[:, 2], first[:, 5] / 2, second[:, 5] / 2
    top, bottom = torch.minimum(rise + other, half), torch.maximum(rise - other, -half)
    depth = torch.maximum(rise + other, half) - torch.minimum(rise - other, -half)
    sizes = first[:, 3:6].prod(1), second[:, 3:6].prod(1)
    shared = torch.minimum(area * (top - bottom).clamp_min(0.0), torch.minimum(*sizes))
    union = sizes[0] + sizes[1] - shared
    enclosing = torch.maximum(hull * depth, union)
    return (shared / union - (enclosing - union) / enclosing).to(kind)


def _corners(box: Tensor, of: Tensor) -> Tensor:
    """Return the corners (N, 4, 2) of boxes, counter-clockwise, in the axes of the boxes `of`."""
    turn = box[:, 6] - of[:, 6]
    half = box[:, 3:5] / 2
    signs = box.new_tensor([[1.0, 1.0], [-1.0, 1.0], [-1.0, -1.0], [1.0, -1.0]])
    middle = _turned(box[:, None, :2] - of[:, None, :2], -of[:, 6])
    return _turned(signs * half[:, None], turn) + middle


def _turned(points: Tensor, angle: Tensor) -> Tensor:
    """Return points (N, P, 2), turned by angles (N,)."""
    cos, sin = angle.cos()[:, None], angle.sin()[:, None]
    x, y = points.unbind(-1)
    return torch.stack([cos * x - sin * y, sin * x + cos * y], dim=-1)


def _shared_area(first: Tensor, second: Tensor) -> Tensor:
    """Return the area (N,) that two footprints share, by Green's theorem.

    The border of what they share is what of each one's sides lies in the other. A part of a side from a to b adds half
    the cross product of a and b. A side that runs on the other's border counts once: as the first one's.
    """
    corners = _corners(second, first)
    total = torch.zeros_like(first[:, 0])
    for polygon, seen, half, border in (
        (_corners(first, first), _corners(first, second), second[:, 3:5] / 2, True),
        (corners, corners, first[:, 3:5] / 2, False),
    ):
        begin, end = _part_within(seen, half, border=border)
        start, along = polygon, polygon.roll(-1, 1) - polygon
        a, b = start + begin[..., None] * along, start + end[..., None] * along
        cross = a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]
        total = total + torch.where(end > begin, cross, 0.0).sum(1) / 2
    return total.clamp_min(0.0)


def _part_within(polygon: Tensor, half: Tensor, *, border: bool) -> tuple[Tensor, Tensor]:
    """Return from where to where, (N, 4) each in [0, 1], sides are within |x| <= half[0], |y| <= half[1].

    Args:
        polygon: (N, 4, 2) corners; side k goes from corner k to the next one.
        half: (N, 2).
        border: a side that runs on the border is within.
    """
    along = polygon.roll(-1, 1) - polygon
    begin, end = torch.zeros_like(polygon[..., 0]), torch.ones_like(polygon[..., 0])
    for axis in (0, 1):
        for sign in (1.0, -1.0):  # room is how far within a corner is, and shrinks by `speed` along the side
            room, speed = half[:, None, axis] - sign * polygon[..., axis], sign * along[..., axis]
            beside = speed.abs() < _PARALLEL
            at = room / torch.where(beside, 1.0, speed)
            end = torch.where(~beside & (speed > 0), torch.minimum(end, at), end)
            begin = torch.where(~beside & (speed < 0), torch.maximum(begin, at), begin)
            within = room >= -_PARALLEL if border else room > _PARALLEL
            end = torch.where(beside & ~within, -torch.ones_like(end), end)
    return begin, end


def _hull_area(first: Tensor, second: Tensor) -> Tensor:
    """Return the area (N,) of the convex hull of two footprints.

    In the axes of the first, it is the upright box around both less what is cut off at its four corners. By symmetry
    each cut is that of the upper right one, in mirrored coordinates.
    """
    half_x, half_y = (first[:, 3:5] / 2).T
    x, y = _turned(second[:, None, :2] - first[:, None, :2], -first[:, 6])[:, 0].T
    right_x, right_y, top_x, top_y = _extremes(second[:, 3] / 2, second[:, 4] / 2, second[:, 6] - first[:, 6])
    width = torch.maximum(half_x, x + right_x) - torch.minimum(-half_x, x - right_x)
    height = torch.maximum(half_y, y + top_y) - torch.minimum(-half_y, y - top_y)
    cut = _cut(half_x, half_y, x + right_x, y + right_y, x + top_x, y + top_y)
    cut = cut + _cut(half_x, half_y, right_x - x, right_y - y, top_x - x, top_y - y)
    cut = cut + _cut(half_x, half_y, right_x - x, y - right_y, -top_x - x, y + top_y)
    cut = cut + _cut(half_x, half_y, x + right_x, -y - right_y, x - top_x, top_y - y)
    return width * height - cut


def _extremes(half_length: Tensor, half_width: Tensor, angle: Tensor) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """Return the rightmost and the topmost corner of rectangles around the origin, x and y of each, (N,).

    A rectangle turned by a quarter is one with its sides swapped, so any angle becomes one within the first quarter.
    """
    cos, sin = angle.cos(), angle.sin()
    swapped = cos * sin < 0
    length, across = torch.where(swapped, half_width, half_length), torch.where(swapped, half_length, half_width)
    cos, sin = torch.where(swapped, sin, cos).abs(), torch.where(swapped, cos, sin).abs()
    right = length * cos + across * sin, length * sin - across * cos
    return *right, length * cos - across * sin, length * sin + across * cos


def _cut(half_x: Tensor, half_y: Tensor, right_x: Tensor, right_y: Tensor, top_x: Tensor, top_y: Tensor) -> Tensor:
    """Return the area (N,) between the hull and the upper right corner of the box around it.

    The hull runs there from its rightmost to its topmost point. Only three points can lie on the way: the upright
    rectangle's corner, and the other's rightmost and topmost one. Two are the ends; the third bulges out, or not.
    """
    upright_first, upright_last = half_x >= right_x, half_y >= top_y
    first_x, first_y = torch.where(upright_first, half_x, right_x), torch.where(upright_first, half_y, right_y)
    last_x, last_y = torch.where(upright_last, half_x, top_x), torch.where(upright_last, half_y, top_y)
    x = torch.where(upright_first, right_x, torch.where(upright_last, top_x, half_x))
    y = torch.where(upright_first, right_y, torch.where(upright_last, top_y, half_y))
    left, up = first_x - last_x, last_y - first_y
    bulge = left * (y - first_y) + up * (x - first_x)
    area = (left * up - bulge.clamp_min(0.0)) / 2
    return torch.where(upright_first & upright_last, 0.0, area)
