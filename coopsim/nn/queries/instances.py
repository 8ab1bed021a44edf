"""Instances: objects with boxes, features and history, carried over from frame to frame."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import numpy as np
import torch
from torch import Tensor

from coopsim.geometry.assignment import Pairs, hungarian
from coopsim.geometry.se3 import SE3, Floats
from coopsim.types.taxonomy import ObjectClass
from coopsim.types.units import Mask

UNNUMBERED = -1
"""The id of an instance that has none yet."""


@dataclass(frozen=True, slots=True, eq=False)
class Instances:
    """K objects, in the compass frame of the agent that knows of them.

    Attributes:
        box: (K, 7) x, y, z, l, w, h, yaw; x, y, z are the reference point.
        velocity: (K, 2) m/s over ground.
        score: (K,) in (0, 1).
        label: (K,) int64, an `ObjectClass`.
        semantic: (K, D) features of appearance.
        motion: (K, D) features of pose and motion.
        past_semantic: (K, H, D) semantics of earlier frames, the newest first.
        past_motion: (K, H, D) the same of motion.
        past_age_s: (K, H) their ages; infinite where there was no such frame.
        hits: (K,) int64, frames in which any agent saw it.
        missed: (K,) int64, frames since then.
        number: (K,) int64, its id; `UNNUMBERED` where it has none.
    """

    box: Tensor
    velocity: Tensor
    score: Tensor
    label: Tensor
    semantic: Tensor
    motion: Tensor
    past_semantic: Tensor
    past_motion: Tensor
    past_age_s: Tensor
    hits: Tensor
    missed: Tensor
    number: Tensor

    @classmethod
    def seen(cls, box: Tensor, score: Tensor, label: Tensor, width: int, frames: int) -> Instances:
        """Return K instances that are seen for the first time: without features, history and velocity."""
        count = len(box)
        past = box.new_zeros(count, frames, width)
        whole = torch.zeros(count, dtype=torch.int64, device=box.device)
        return cls(
            box, box.new_zeros(count, 2), score, label, box.new_zeros(count, width), box.new_zeros(count, width),
            past, past, box.new_full((count, frames), torch.inf), whole + 1, whole, whole + UNNUMBERED,
        )  # fmt: skip

    def as_received(self) -> Instances:
        """Return them as others get them: without history and number, but with velocities that are known."""
        width, frames = self.semantic.shape[1], self.past_age_s.shape[1]
        seen = Instances.seen(self.box, self.score, self.label, width, frames)
        return replace(seen, velocity=self.velocity, semantic=self.semantic, motion=self.motion, hits=seen.hits + 1)

    @classmethod
    def none(cls, width: int, frames: int, device: torch.device | None = None) -> Instances:
        """Return no instances."""
        box = torch.zeros(0, 7, device=device)
        return cls.seen(box, box[:, 0], box[:, 0].long(), width, frames)

    @classmethod
    def joined(cls, parts: Sequence[Instances]) -> Instances:
        """Return the instances of all parts, in order; at least one part."""
        return cls(*(torch.cat([getattr(part, each.name) for part in parts]) for each in fields(cls)))

    def __len__(self) -> int:
        return len(self.box)

    def __getitem__(self, rows: Tensor) -> Instances:
        return Instances(*(getattr(self, each.name)[rows] for each in fields(self)))

    def detached(self) -> Instances:
        """Return them without gradients."""
        return Instances(*(getattr(self, each.name).detach() for each in fields(self)))

    def moved(self, dst_SE3_src: SE3) -> Instances:
        """Return them in the frame dst (gravity-aligned) of whose frame src they are; features stay as they are."""
        box, velocity = moved_boxes(self.box, self.velocity, dst_SE3_src)
        return replace(self, box=box, velocity=velocity)

    def advanced(self, dt_s: float) -> Instances:
        """Return them a time later: moved on by their velocities, histories older."""
        box = torch.cat([self.box[:, :2] + dt_s * self.velocity, self.box[:, 2:]], dim=1)
        return replace(self, box=box, past_age_s=self.past_age_s + dt_s)

    def remembered(self) -> Instances:
        """Return them with what they are now as the newest of their past; the oldest frame falls out."""
        frames = self.past_age_s.shape[1]
        return replace(
            self,
            past_semantic=torch.cat([self.semantic[:, None], self.past_semantic], dim=1)[:, :frames],
            past_motion=torch.cat([self.motion[:, None], self.past_motion], dim=1)[:, :frames],
            past_age_s=torch.cat([torch.zeros_like(self.past_age_s[:, :1]), self.past_age_s], dim=1)[:, :frames],
        )

    def numbered(self, first: int) -> tuple[Instances, int]:
        """Return the instances, those without a number numbered from `first` on, and the number after these."""
        new = self.number == UNNUMBERED
        number = torch.where(new, first + torch.cumsum(new, 0) - 1, self.number)
        return replace(self, number=number), first + int(new.sum())

    def surest(self, most: int) -> Instances:
        """Return the `most` of the largest scores, in their order."""
        if len(self) <= most:
            return self
        return self[torch.argsort(self.score, descending=True, stable=True)[:most].sort().values]


def moved_boxes(box: Tensor, velocity: Tensor, dst_SE3_src: SE3) -> tuple[Tensor, Tensor]:
    """Return boxes (K, 7) and velocities (K, 2) in the frame dst (gravity-aligned) that are given in the frame src.

    In a network's pass, too, this is float32: bfloat16 knows places at 100 m in steps of half a metre.
    """
    turn = box.new_tensor(dst_SE3_src.rotation.tolist())
    shift = box.new_tensor(dst_SE3_src.translation.tolist())
    yaw_rad = float(np.arctan2(dst_SE3_src.rotation[1, 0], dst_SE3_src.rotation[0, 0]))
    with torch.autocast(box.device.type, enabled=False):
        place, velocity = box[:, :3] @ turn.T + shift, velocity @ turn[:2, :2].T
    return torch.cat([place, box[:, 3:6], box[:, 6:] + yaw_rad], dim=1), velocity


LONGEST_S = 2.0
"""After a longer time without a frame, instances are forgotten."""

_FASTEST_M_S = {
    ObjectClass.MOTORCYCLE: 15.0, ObjectClass.BICYCLE: 8.0, ObjectClass.SCOOTER: 8.0, ObjectClass.PEDESTRIAN: 3.0,
    ObjectClass.CHILD: 3.0,
}  # fmt: skip
_FASTEST = np.array([_FASTEST_M_S.get(cls, 20.0) for cls in ObjectClass])
_GROUPS = np.array([0 if cls not in _FASTEST_M_S else 1 if _FASTEST_M_S[cls] > 5 else 2 for cls in ObjectClass])
_LEAST_REACH_M, _CHANGE_M_S = 1.0, 4.0

_MOST_M_S = 40.0
_YOUNG_HITS = 3
"""Until so many sightings the velocity of what drives on a motorway may still be far from known."""

_ALIGNED = 0.5
"""Largest sine of the angle between the headings of two sightings of it; boxes may be turned around."""

_FIRST_GAIN_S, _GAIN_S = 0.15, 0.5
"""A difference of places says dt / (dt + this) of a velocity: the less, the closer in time the frames are."""

_FADE = 1.0
"""What the logit of a score loses in a frame in which nobody sees the object."""


def met(prior: Instances, seen: Instances, dt_s: float) -> Instances:
    """Return the instances of a frame: those carried over, updated by the ones seen now, and new ones.

    Pairs have the smallest distances (Hungarian), within a gate that is wide while the velocity is not known yet.
    Vehicles that are left over are paired as if they were fast: those known for a few frames with one ahead of or
    behind them in their direction. A pair keeps the history, features and number of the prior, and has box, score and
    class of the seen one; its velocity is corrected by how far it lies beside the prediction. Unseen ones stay for a
    while where they are predicted, with a falling score.

    Args:
        prior: instances `advanced` to now, in the frame of `seen`.
        seen: instances of the agent alone, now.
        dt_s: time since the frame before.
    """
    usual, fast = _pairs(prior, seen, dt_s)
    device = seen.box.device
    old, new = (torch.from_numpy(np.concatenate(each)).to(device) for each in zip(usual, fast, strict=True))
    fresh = torch.ones(len(seen), dtype=torch.bool, device=device)
    fresh[new] = False
    known, now = prior[old], seen[new]
    velocity = corrected_velocity(known, now, dt_s)
    if count := len(fast[0]):  # has moved so far that errors of places are small beside it
        beside = now.box[-count:, :2] - known.box[-count:, :2]
        velocity[-count:] = (known.velocity[-count:] + beside / dt_s).clamp(-_MOST_M_S, _MOST_M_S)
    left = prior[_others(old, len(prior))]
    paired = replace(
        known, box=now.box, velocity=velocity, score=now.score, label=now.label,
        hits=known.hits + 1, missed=torch.zeros_like(known.missed),
    )  # fmt: skip
    faded = replace(left, score=torch.sigmoid(logit(left.score) - _FADE), missed=left.missed + 1)
    return Instances.joined([paired, faded, seen[fresh]])


def _pairs(prior: Instances, seen: Instances, dt_s: float) -> tuple[Pairs, Pairs]:
    """Return the pairs of usual speed, and those of what is left over that are fast."""
    alike = _GROUPS[prior.label.cpu().numpy()][:, None] == _GROUPS[seen.label.cpu().numpy()]
    away_m = torch.cdist(prior.box[:, :2].detach().double(), seen.box[:, :2].detach().double()).cpu().numpy()
    near = alike & (away_m <= _gate_m(prior, dt_s)[:, None])
    rows, columns = _nearest(near, away_m)
    fast = alike & _fast(prior, seen, dt_s)
    fast[rows], fast[:, columns] = False, False
    return (rows, columns), _nearest(fast, away_m)


def _nearest(possible: Mask, away_m: Floats) -> Pairs:
    return hungarian(np.where(possible, -away_m, -np.inf), -np.inf)


def _gate_m(prior: Instances, dt_s: float) -> Floats:
    """Return how far from its prediction each object of usual speed may be, (K,) m."""
    unknown, fastest = prior.hits.cpu().numpy() == 1, _FASTEST[prior.label.cpu().numpy()]
    reach_m: Floats = _LEAST_REACH_M + dt_s * np.where(unknown, fastest, _CHANGE_M_S)
    return reach_m


def _fast(prior: Instances, seen: Instances, dt_s: float) -> Mask:
    """Return which vehicles (K, L) can be the same if they are as fast as on a motorway."""
    vehicle, young = _GROUPS[prior.label.cpu().numpy()] == 0, prior.hits.cpu().numpy() <= _YOUNG_HITS
    old, new = (each.box.detach().double().cpu().numpy() for each in (prior, seen))
    x, y = np.moveaxis(new[None, :, :2] - old[:, None, :2], 2, 0)
    cos, sin = np.cos(old[:, 6:]), np.sin(old[:, 6:])
    ahead_m, aside_m = np.abs(cos * x + sin * y), np.abs(cos * y - sin * x)
    aligned = np.abs(np.sin(new[None, :, 6] - old[:, 6:])) <= _ALIGNED
    possible: Mask = aligned & (ahead_m <= _LEAST_REACH_M + dt_s * _MOST_M_S) & (aside_m <= _LEAST_REACH_M)
    possible &= (vehicle & young)[:, None]
    return possible


def corrected_velocity(known: Instances, now: Instances, dt_s: float) -> Tensor:
    """Return velocities (P, 2): those of `known`, corrected by how far what is seen of them now lies beside them."""
    gain_s = torch.where(known.hits == 1, _FIRST_GAIN_S, _GAIN_S)[:, None]
    beside = now.box[:, :2] - known.box[:, :2]
    return (known.velocity + beside / (dt_s + gain_s)).clamp(-_MOST_M_S, _MOST_M_S)


def _others(rows: Tensor, count: int) -> Tensor:
    """Return the rows of `count` that are not among `rows`."""
    kept = torch.ones(count, dtype=torch.bool, device=rows.device)
    kept[rows] = False
    return torch.nonzero(kept).squeeze(1)


def logit(score: Tensor) -> Tensor:
    """Return logits of scores, which are kept away from 0 and 1."""
    return torch.logit(score, eps=0.01)
