"""The tracks of a tracker, as one struct of arrays."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from coopsim.geometry.se3 import Floats
from coopsim.tracking.embedding_memory import EmbeddingMemory
from coopsim.tracking.motion.constant_velocity import Beliefs
from coopsim.types import Ints, Mask


@dataclass(frozen=True, slots=True, eq=False)
class Tracked:
    """N tracks, reported or not; all fields have N rows.

    Attributes:
        beliefs: the motion model's state estimates.
        boxes: (N, 7) x, y, z, l, w, h, yaw, of the beliefs' means.
        velocity: (N, 2) m/s, of the beliefs' means.
        id: (N,) int.
        label: (N,) int, an `ObjectClass`.
        score: (N,) as the tracker's scoring keeps it.
        latest: (N,) score of the last detection.
        confidence: (N,) last reported score; the first score before any report.
        hits: (N,) frames with a detection so far.
        misses: (N,) frames since the last detection; 0 if detected in this one.
        age: (N,) frames since birth; 0 in the frame of birth.
        foreign: (N,) bool, whether the last detection came from other agents only, not from the receiver.
        appearance: embeddings of the last detections, if the tracker keeps them.
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
        """Return these tracks followed by the others."""
        first, second = self.beliefs, other.beliefs
        beliefs = Beliefs(
            np.concatenate([first.mean, second.mean]), np.concatenate([first.covariance, second.covariance])
        )
        arrays = {name: np.concatenate([getattr(self, name), getattr(other, name)]) for name in _ARRAYS}
        return Tracked(beliefs=beliefs, appearance=self.appearance.join(other.appearance), **arrays)


_ARRAYS = tuple(field.name for field in fields(Tracked) if field.name not in ("beliefs", "appearance"))
