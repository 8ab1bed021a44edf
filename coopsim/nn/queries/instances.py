"""Instances: objects that an agent knows of, with their boxes, features and history."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import numpy as np
import torch
from torch import Tensor

from coopsim.geometry.se3 import SE3

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
        semantic: (K, D) what an object looks like.
        motion: (K, D) how it stands and moves.
        past_semantic: (K, H, D) semantics of earlier frames, the newest first.
        past_motion: (K, H, D) the same of motion.
        past_age_s: (K, H) their ages; infinite where there was no such frame.
        hits: (K,) int64, frames in which somebody saw it.
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

    def as_heard(self) -> Instances:
        """Return them as others get them: without history and number, but with velocities that are known."""
        width, frames = self.semantic.shape[1], self.past_age_s.shape[1]
        seen = Instances.seen(self.box, self.score, self.label, width, frames)
        return replace(seen, velocity=self.velocity, semantic=self.semantic, motion=self.motion, hits=seen.hits + 1)

    @classmethod
    def none(cls, width: int, frames: int) -> Instances:
        """Return no instances."""
        return cls.seen(torch.zeros(0, 7), torch.zeros(0), torch.zeros(0, dtype=torch.int64), width, frames)

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
