"""The fusion of coop_fuse in numpy, a few lines per rule: slow, and what the library's kernels must agree with."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.special import expit

from coopsim.fusion.common_objects import turned
from coopsim.fusion.fused_boxes import FusedBoxes, SourceOdds
from coopsim.geometry.assignment import hungarian
from coopsim.geometry.boxes import Boxes3D
from coopsim.geometry.iou import giou_bev, iou_3d, iou_bev
from coopsim.geometry.se3 import Floats, wrap_angle
from coopsim.types import Detections, Ints, Mask
from coopsim.types.valid_detections import drop_invalid

_ROUNDS, _GATE, _NOISE_M, _STEPS, _FARTHEST_M = 2, -0.2, 0.4, 4, 1e5
_SHIFT, _RISE, _OUTLIER_M = np.array([0.7, 0.7, np.radians(1.0)]), np.array([0.7, 0.1, 0.1]), (0.6, 0.4)

_ON_OBJECT, _BLUR, _COMMON_GROUND, _CLOSER = 0.25, 0.03, 0.85, 0.02
_SHARES = np.linspace(0.0, 1.0, 9)
_FLOOR, _ROOF = (_SHARES[each][:, None] for each in np.triu_indices(len(_SHARES)))

_EVEN_ODDS_IOU, _STEEPNESS = 0.255, 6.4


def match_boxes(own: Boxes3D, own_label: Ints, other: Boxes3D, other_label: Ints, gate: float) -> tuple[Ints, Ints]:
    """Return the rows (K,) and (K,) of boxes of one class that lie on one object (Hungarian on the BEV GIoU).

    Args:
        own: N boxes.
        own_label: (N,) their classes.
        other: M boxes, in the same frame.
        other_label: (M,) their classes.
        gate: smallest BEV GIoU of two boxes on one object, in [-1, 1].
    """
    affinity = giou_bev(own.array, other.array)
    affinity[own_label[:, None] != other_label] = -np.inf
    return hungarian(affinity, gate)


@dataclass(frozen=True, slots=True, eq=False)
class Registration:
    """A transform that moves the other agent's boxes onto the own ones.

    Attributes:
        middle: (2,) m, centre of the turn and the tilt.
        shift: (3,) x, y m over ground, and the turn in rad.
        rise: (3,) m up at the middle, and the slopes along x and y, metres up per metre.
        common: number of objects that both agents see.
    """

    middle: Floats = field(default_factory=lambda: np.zeros(2))
    shift: Floats = field(default_factory=lambda: np.zeros(3))
    rise: Floats = field(default_factory=lambda: np.zeros(3))
    common: int = 0

    def place(self, boxes: Boxes3D) -> Boxes3D:
        """Return the boxes moved onto the own ones."""
        off = boxes.center[:, :2] - self.middle
        height = boxes.center[:, 2] + self.rise[0] + off @ self.rise[1:]
        center = np.column_stack([self.middle + self.shift[:2] + turned(off, self.shift[2]), height])
        return Boxes3D(center, boxes.size, wrap_angle(boxes.yaw + self.shift[2]))


def register(own: Detections, other: Detections) -> Registration:
    """Return the most likely registration of another agent's boxes with the own ones, in one frame.

    Pairs of a class are matched (Hungarian on the BEV GIoU), and shift and rise follow by least squares with Gaussian
    priors, each reweighted by how well pairs agree (Cauchy's weights). A turn is taken as small. Without common objects
    the registration moves nothing.
    """
    found = Registration(_middle(other.boxes))
    fitted: list[tuple[int, int]] = []
    for _ in range(_ROUNDS):
        mine, theirs = match_boxes(own.boxes, own.label, found.place(other.boxes), other.label, _GATE)
        within = _near(own.boxes[mine]) & _near(other.boxes[theirs])
        mine, theirs = mine[within], theirs[within]
        pairs = list(zip(mine.tolist(), theirs.tolist(), strict=True))
        if not pairs or pairs == fitted:  # the same pairs give the same result
            return found
        fitted = pairs
        weight = np.clip(np.minimum(own.score[mine], other.score[theirs]), 1e-3, 1.0)
        off = other.boxes.center[theirs, :2] - found.middle
        apart = own.boxes.center[mine] - other.boxes.center[theirs]
        apart[:, 2] = own.boxes.bottom[mine] - other.boxes.bottom[theirs]
        found = Registration(
            found.middle, _shift(off, apart[:, :2], weight), _rise(off, apart[:, 2], weight), len(mine)
        )
    return found


def _middle(boxes: Boxes3D) -> Floats:
    """Return the mean centre (2,) m over ground of the boxes that are not too far away."""
    near = boxes.center[_near(boxes), :2]
    return near.mean(axis=0) if len(near) else np.zeros(2)


def _near(boxes: Boxes3D) -> Mask:
    """Return the mask (N,) of boxes within `_FARTHEST_M` of the origin."""
    near: Mask = np.abs(boxes.center).max(axis=1, initial=0.0) <= _FARTHEST_M
    return near


def _shift(off: Floats, apart: Floats, weight: Floats) -> Floats:
    """Fit x, y (m) and the turn (rad) to gaps (N, 2) m of pairs at offsets (N, 2) m from the middle."""
    one, none = np.ones(len(off)), np.zeros(len(off))
    rows = np.stack([np.column_stack([one, none, -off[:, 1]]), np.column_stack([none, one, off[:, 0]])], axis=1)
    return _least_squares(rows, apart, weight, _SHIFT, _OUTLIER_M[0])


def _rise(off: Floats, apart: Floats, weight: Floats) -> Floats:
    """Fit height (m) and its slopes to gaps (N,) m of pairs at offsets (N, 2) m from the middle."""
    rows = np.column_stack([np.ones(len(off)), off])
    return _least_squares(rows[:, None], apart[:, None], weight, _RISE, _OUTLIER_M[1])


def _least_squares(rows: Floats, target: Floats, weight: Floats, expected: Floats, outlier_m: float) -> Floats:
    """Return the most likely x (3,) of `rows` (N, D, 3) x = `target` (N, D) m with prior deviations `expected`."""
    trusted = weight
    for _ in range(_STEPS):
        normal = np.einsum("n,ndi,ndj->ij", trusted, rows, rows) / _NOISE_M**2 + np.diag(expected**-2.0)
        found: Floats = np.linalg.solve(normal, np.einsum("n,ndi,nd->i", trusted, rows, target) / _NOISE_M**2)
        error_m = np.linalg.norm(rows @ found - target, axis=1)
        trusted = weight / (1 + (error_m / outlier_m) ** 2)
    return found


def compromise(own: Boxes3D, other: Boxes3D, other_right: Floats) -> tuple[Boxes3D, Floats]:
    """Place boxes between own ones and another agent's, each where it most likely overlaps the object enough.

    Over ground a box is the mean of the two, weighted by their probabilities, or, where the mean would miss both,
    half-way or either of the two; it has the heading of the likelier one. Floor and roof are chosen separately, between
    those of the two: where they differ little the mean overlaps both; where they differ more, a box in between, taller
    than either, does; where they differ by more than their own height and one is far likelier, that one is taken.

    Args:
        own: N boxes.
        other: N boxes.
        other_right: (N,) probability that the other box is right; else the own one is.

    Returns:
        The boxes, and the probabilities (2, N) that each overlaps the object enough if the own box, and if the other
        one, is right.
    """
    floors = np.stack([own.bottom, other.bottom])
    order = np.argsort(floors, axis=0, kind="stable")
    lows, highs = (
        np.take_along_axis(each, order, axis=0)
        for each in (floors, floors + np.stack([own.size[:, 2], other.size[:, 2]]))
    )
    floor, roof = lows[0] + _FLOOR * (lows[1] - lows[0]), highs[0] + _ROOF * (highs[1] - highs[0])
    boxes = _between(own, other, other_right)
    overlaps = np.stack([_overlaps(boxes, floor, roof, each) for each in (own, other)])
    reaches: Floats = expit((overlaps - _ON_OBJECT) / _BLUR)
    chances = np.stack([1 - other_right, other_right])[:, None, None]
    value = (chances * (reaches + _CLOSER * overlaps)).sum(axis=0)
    way, height = np.unravel_index(np.concatenate(value).argmax(axis=0), value.shape[:2])
    pair = np.arange(len(other_right))
    chosen = boxes[way, pair]
    chosen[:, 2], chosen[:, 5] = (floor + roof)[height, pair] / 2, (roof - floor)[height, pair]
    return Boxes3D.from_array(chosen), reaches[:, way, height, pair]


def _between(own: Boxes3D, other: Boxes3D, other_right: Floats) -> Floats:
    """Return mean, own, other and half-way boxes over ground (4, N, 7), with the heading of the likelier one."""
    ways = np.stack(
        [other_right, np.zeros_like(other_right), np.ones_like(other_right), np.full_like(other_right, 0.5)]
    )
    between = own.array + ways[..., None] * (other.array - own.array)
    between[..., 6] = np.where(other_right > 0.5, other.yaw, own.yaw)
    return between


def _overlaps(boxes: Floats, floor: Floats, roof: Floats, right: Boxes3D) -> Floats:
    """Return the 3D IoU (W, C, N) of `boxes` (W, N, 7), between floors and roofs (C, N) m, with the right boxes."""
    from_above = np.nan_to_num([np.diag(iou_bev(each, right.array)) for each in boxes])
    sides = np.stack(np.broadcast_arrays(boxes[..., 3:5], right.size[:, :2]))
    area, its_area = (sides / sides.max(axis=(0, 3))[..., None]).prod(axis=3)  # a scale cancels, and might overflow
    ground = _COMMON_GROUND * from_above * (area + its_area) / (1 + from_above)
    its_floor, its_height = right.bottom, right.size[:, 2]
    shared = np.maximum(np.minimum(roof, its_floor + its_height) - np.maximum(floor, its_floor), 0.0)
    common = ground[:, None] * shared
    union = (roof - floor) * area[:, None] + (its_height * its_area)[:, None] - common
    overlap: Floats = common / union
    return overlap


def clear_middle(detections: Detections) -> Floats:
    if not len(detections):
        return np.zeros(2)
    score = np.maximum(detections.score, 1e-6)
    weight = (score / score.max()) ** 4
    middle: Floats = weight @ detections.boxes.center[:, :2] / weight.sum()
    return middle


def away_from(boxes: Boxes3D, middle: Floats) -> Floats:
    distance: Floats = np.linalg.norm(boxes.center[:, :2] - middle, axis=1)
    return distance


def of_agent(detections: Detections) -> FusedBoxes:
    away_m = away_from(detections.boxes, clear_middle(detections))
    return FusedBoxes(detections, np.ones(len(detections)), away_m, detections.score, away_m)


def join(one: FusedBoxes, two: FusedBoxes) -> FusedBoxes:
    columns = ("chance", "nearest_m", "score", "away_m")
    joined = [np.concatenate([getattr(one, each), getattr(two, each)]) for each in columns]
    return FusedBoxes(Detections.concatenate([one.detections, two.detections]), *joined)


def correspond(own: FusedBoxes, other: FusedBoxes, gate: float) -> tuple[Ints, Ints, Ints, FusedBoxes | None]:
    """Match two agents' boxes under their registration, which removes a common error of a pose or a clock."""
    registration = register(own.detections, other.detections)
    placed = registration.place(other.detections.boxes)
    own_rows, other_rows = match_boxes(own.detections.boxes, own.detections.label, placed, other.detections.label, gate)
    new = np.setdiff1d(np.arange(len(other.detections)), other_rows)
    if not registration.common:
        return own_rows, other_rows, new, None
    boxes, alone = placed[new], other[new]
    # No agent detected them there: the score is 0, and only the distance is from the receiver's clear area.
    away_m = away_from(boxes, clear_middle(own.detections))
    expected = replace(
        alone, detections=replace(alone.detections, boxes=boxes), away_m=away_m, score=np.zeros(len(new))
    )
    return own_rows, other_rows, new, expected


def trust_likelier(
    groups: Sequence[Detections],
    gate: float,
    doubt: SourceOdds,
    hearsay: SourceOdds | None = None,
    least_chance: float = 1.0,
) -> FusedBoxes:
    fused, replaced = of_agent(Detections.empty()), of_agent(Detections.empty())
    for group in (of_agent(drop_invalid(each)) for each in groups):
        mine, theirs, others, expected = correspond(fused, group, gate)
        agreed, spare = _fuse(fused[mine], group[theirs], doubt)
        new = group[others]
        if hearsay is not None and expected is not None:
            new, other_spare = _fuse(expected, new, hearsay)
            spare = join(spare, other_spare)
        replaced = join(replaced, spare[spare.chance >= least_chance])
        alone = np.setdiff1d(np.arange(len(fused.detections)), mine)
        order = np.argsort(np.concatenate([mine, alone]), kind="stable")
        fused = join(join(agreed, fused[alone])[order], new)
    return join(fused, replaced)


def _fuse(own: FusedBoxes, other: FusedBoxes, doubt: SourceOdds) -> tuple[FusedBoxes, FusedBoxes]:
    """Fuse N pairs of boxes.

    Returns:
        The fused boxes (N,), and the pairs' originals (2 N,), all own ones first, each with the probability that it is
        right where the fused box is not as its chance.
    """
    gap_m = other.detections.boxes.bottom - own.detections.boxes.bottom
    gap_m = np.abs(gap_m)
    features = [own.score, other.score, own.away_m, other.away_m, gap_m, gap_m * own.away_m]
    other_right = expit(doubt.weights[0] + np.stack(features, axis=1) @ doubt.weights[1:])
    boxes, reaches = compromise(own.detections.boxes, other.detections.boxes, other_right)
    best = np.maximum(own.detections.score, other.detections.score)
    nearest_m = np.minimum(own.nearest_m, other.nearest_m)
    right = np.stack([(1 - other_right) * own.chance, other_right * other.chance])
    overlaps = np.stack([np.diag(iou_3d(boxes.array, each.detections.boxes.array)) for each in (own, other)])
    originals = join(own, other)
    spare = replace(
        originals,
        detections=replace(originals.detections, score=np.tile(best, 2)),
        chance=(right * (1 - _probability_on_object(overlaps))).ravel(),
        nearest_m=np.tile(nearest_m, 2),
    )
    count = len(other_right)
    likelier = spare[np.arange(count) + count * (other_right > 0.5)]
    fused = replace(likelier.detections, boxes=boxes)
    return replace(likelier, detections=fused, chance=(right * reaches).sum(axis=0)), spare


def _probability_on_object(overlap: Floats) -> Floats:
    """Return the probability that a box with this 3D IoU (...) with a right one overlaps the object enough too."""
    power = overlap**_STEEPNESS
    probability: Floats = power / (power + _EVEN_ODDS_IOU**_STEEPNESS)
    return probability
