"""The tracks of a tracker, as one struct of arrays."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from coopsim.geometry.se3 import Floats
from coopsim.tracking.embedding_memory import EmbeddingMemory
from coopsim.tracking.motion.constant_velocity import Beliefs
from coopsim.types import Ints, Mask


@dataclass(frozen=True, slots=True, eq=False)
class Tracked:
    """N tracks, reported or not; all fields have N rows.

    A tracker writes into the arrays of the frame that it is working on, never into those of a frame before.

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
        return Tracked(
            Beliefs(self.beliefs.mean[index], self.beliefs.covariance[index]),
            self.boxes[index],
            self.velocity[index],
            self.id[index],
            self.label[index],
            self.score[index],
            self.latest[index],
            self.confidence[index],
            self.hits[index],
            self.misses[index],
            self.age[index],
            self.foreign[index],
            self.appearance.take(index),
        )

    def moved(self, boxes: Floats, velocity: Floats, appearance: EmbeddingMemory) -> Tracked:
        """Return these tracks with other boxes, velocities and embeddings; all else is shared with them."""
        return Tracked(
            self.beliefs,
            boxes,
            velocity,
            self.id,
            self.label,
            self.score,
            self.latest,
            self.confidence,
            self.hits,
            self.misses,
            self.age,
            self.foreign,
            appearance,
        )

    def join(self, other: Tracked) -> Tracked:
        """Return these tracks followed by the others."""
        first, second = self.beliefs, other.beliefs
        return Tracked(
            Beliefs(np.concatenate([first.mean, second.mean]), np.concatenate([first.covariance, second.covariance])),
            np.concatenate([self.boxes, other.boxes]),
            np.concatenate([self.velocity, other.velocity]),
            np.concatenate([self.id, other.id]),
            np.concatenate([self.label, other.label]),
            np.concatenate([self.score, other.score]),
            np.concatenate([self.latest, other.latest]),
            np.concatenate([self.confidence, other.confidence]),
            np.concatenate([self.hits, other.hits]),
            np.concatenate([self.misses, other.misses]),
            np.concatenate([self.age, other.age]),
            np.concatenate([self.foreign, other.foreign]),
            self.appearance.join(other.appearance),
        )
