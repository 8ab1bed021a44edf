"""The tracks of a tracker, all of them as one struct of arrays."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from coopsim.geometry.se3 import Floats
from coopsim.tracking.affinity.reid import EmbeddingMemory
from coopsim.tracking.motion.constant_velocity import Beliefs
from coopsim.types import Ints, Mask


@dataclass(frozen=True, slots=True, eq=False)
class Tracked:
    """N tracks, reported or not; all fields have N rows.

    Attributes:
        beliefs: the motion model's, about each object.
        boxes: (N, 7) x, y, z, l, w, h, yaw, as the beliefs have them.
        velocity: (N, 2) m/s, as the beliefs have it.
        id: (N,) int.
        label: (N,) int, an `ObjectClass`.
        score: (N,) as the tracker's scoring keeps it.
        latest: (N,) score of the last detection.
        confidence: (N,) what reports said of it last; the first score before any did.
        hits: (N,) frames with a detection so far.
        misses: (N,) frames since the last detection; 0 if detected in this one.
        age: (N,) frames since birth; 0 in the frame of birth.
        foreign: (N,) bool, whether the last detection was another agent's alone, and not the receiver's own.
        appearance: what they looked like, as far as the tracker keeps it.
    """

    beliefs: Beliefs
    boxes: Floats
    velocity: Floats
    id: Ints
    label: Ints
    score: Floats
    latest: Floats
    confidence: Floats
    hits: Ints
    misses: Ints
    age: Ints
    foreign: Mask
    appearance: EmbeddingMemory

    def __len__(self) -> int:
        return len(self.id)

    def __getitem__(self, index: Any) -> Tracked:
        beliefs = Beliefs(self.beliefs.mean[index], self.beliefs.covariance[index])
        arrays = {name: getattr(self, name)[index] for name in _ARRAYS}
        return Tracked(beliefs=beliefs, appearance=self.appearance.take(index), **arrays)

    def join(self, other: Tracked) -> Tracked:
        """These tracks, then the others."""
        mine, theirs = self.beliefs, other.beliefs
        beliefs = Beliefs(
            np.concatenate([mine.mean, theirs.mean]), np.concatenate([mine.covariance, theirs.covariance])
        )
        arrays = {name: np.concatenate([getattr(self, name), getattr(other, name)]) for name in _ARRAYS}
        return Tracked(beliefs=beliefs, appearance=self.appearance.join(other.appearance), **arrays)


_ARRAYS = tuple(field.name for field in fields(Tracked) if field.name not in ("beliefs", "appearance"))
