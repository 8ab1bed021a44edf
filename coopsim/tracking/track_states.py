"""All tracks of a tracker as one struct of arrays, with the embeddings by which a lost track is found again."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from coopsim.geometry.se3 import Floats
from coopsim.support.arrays import sealed
from coopsim.tracking.motion.constant_velocity import Beliefs
from coopsim.types import Detections, Ints, Mask
from coopsim.types.valid_detections import normalize_embeddings

Index = NDArray[np.integer] | NDArray[np.bool_]

_NEVER_NS = np.iinfo(np.int64).min


@dataclass(frozen=True, slots=True, eq=False)
class TrackStates:
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

    def __getitem__(self, index: Any) -> TrackStates:
        beliefs = Beliefs(self.beliefs.mean[index], self.beliefs.covariance[index])
        values: list[Any] = [beliefs, *(column[index] for column in self._columns), self.appearance.take(index)]
        return TrackStates(*values)

    def join(self, other: TrackStates) -> TrackStates:
        """Return these tracks followed by the others."""
        one, two = self.beliefs, other.beliefs
        beliefs = Beliefs(np.concatenate([one.mean, two.mean]), np.concatenate([one.covariance, two.covariance]))
        columns = (np.concatenate(pair) for pair in zip(self._columns, other._columns, strict=True))
        values: list[Any] = [beliefs, *columns, self.appearance.join(other.appearance)]
        return TrackStates(*values)

    @property
    def _columns(self) -> Iterator[Any]:
        return (getattr(self, name) for name in _COLUMNS)


_COLUMNS = [each.name for each in fields(TrackStates)][1:-1]
"""Names of the fields that are arrays of N rows."""


@dataclass(frozen=True, slots=True, eq=False)
class EmbeddingMemory:
    """Embeddings of each of N tracks, at most W, first in, first out. Immutable: every change makes a new memory.

    DINO-CoDT (sec. III-G) keeps each track's vectors within a temporal window (eq. 8) and compares an otherwise
    unmatched detection with them by cosine similarity (eq. 9); `appearance` is the use of it by a tracker.

    An embedding that is not finite, or all zeros, is invalid: it is not stored, displaces no other, and is similar to
    nothing. `readable` makes such rows for detections without an embedding. Until the first embedding comes, D is 0.

    Attributes:
        vectors: (N, W, D) unit vectors, the newest last; of no meaning where there is none.
        valid: (N, W) bool, where there is an embedding.
        time_ns: (N, W) int64, when each was seen; the smallest integer where there never was one.
    """

    vectors: NDArray[np.float32]
    valid: NDArray[np.bool_]
    time_ns: NDArray[np.int64]

    def __post_init__(self) -> None:
        for each in (self.vectors, self.valid, self.time_ns):
            sealed(each)

    @classmethod
    def blank(cls, count: int, dim: int, window: int) -> EmbeddingMemory:
        """Return the memory of N tracks without embeddings, of length D and at most W of a track."""
        none = np.zeros((count, window), dtype=np.bool_)
        return cls(np.zeros((count, window, dim), dtype=np.float32), none, np.full((count, window), _NEVER_NS))

    @property
    def window(self) -> int:
        """Largest number of embeddings kept of a track, W."""
        return int(self.vectors.shape[1])

    @property
    def dim(self) -> int:
        """Length of an embedding, D."""
        return int(self.vectors.shape[2])

    def __len__(self) -> int:
        return len(self.vectors)

    @property
    def known(self) -> Mask:
        """Mask (N,) of tracks with an embedding."""
        known: Mask = np.any(self.valid, axis=1)  # numpy types the method as a scalar
        return known

    @property
    def ever_known(self) -> Mask:
        """Mask (N,) of tracks that have or had an embedding."""
        ever: Mask = np.any(self.time_ns != _NEVER_NS, axis=1)
        return ever

    def since(self, oldest_ns: int) -> EmbeddingMemory:
        """Return the memory without the embeddings that were seen before a time."""
        valid = self.valid & (self.time_ns >= oldest_ns)
        return self if (valid == self.valid).all() else EmbeddingMemory(self.vectors, valid, self.time_ns)

    def ready_for(self, found: Detections) -> EmbeddingMemory:
        """Return a blank memory of the width of these detections' embeddings or, once an embedding is stored, this one.

        So the first width stands until all tracks with embeddings of it are gone.
        """
        if found.embedding is None or found.embedding.shape[1] == self.dim or self.valid.any():
            return self
        return EmbeddingMemory.blank(len(self), found.embedding.shape[1], self.window)

    def readable(self, found: Detections) -> Floats:
        """Return the detections' embeddings (M, D); NaN where they have none, or of another width."""
        if found.embedding is None or found.embedding.shape[1] != self.dim:
            return np.full((len(found), self.dim), np.nan)
        return found.embedding

    def begin(self, embeddings: Floats, time_ns: int) -> EmbeddingMemory:
        """Return the memory of M new tracks alone, with one embedding (M, D) each; `join` adds them."""
        fresh = EmbeddingMemory.blank(len(embeddings), self.dim, self.window)
        return fresh.update(np.arange(len(embeddings)), embeddings, time_ns)

    def update(self, rows: Index, embeddings: ArrayLike, time_ns: int) -> EmbeddingMemory:
        """Return the memory with one more embedding (M, D) for M different tracks; a full one loses its oldest."""
        if not self.dim:
            return self
        at = np.arange(len(self))[rows]
        unit, present = normalize_embeddings(embeddings, (len(at), self.dim))
        if not present.any():
            return self
        at, unit = at[present], unit[present]
        vectors, valid, times_ns = self.vectors.copy(), self.valid.copy(), self.time_ns.copy()
        vectors[at, :-1], valid[at, :-1], times_ns[at, :-1] = (
            before[at, 1:] for before in (self.vectors, self.valid, self.time_ns)
        )
        vectors[at, -1], valid[at, -1], times_ns[at, -1] = unit, True, time_ns
        return EmbeddingMemory(vectors, valid, times_ns)

    def take(self, index: Index) -> EmbeddingMemory:
        """Return the memory of some tracks, given by a mask (N,) or indices."""
        return EmbeddingMemory(self.vectors[index], self.valid[index], self.time_ns[index])

    def join(self, other: EmbeddingMemory) -> EmbeddingMemory:
        """Return the memory of these tracks, then the other's; windows and lengths of embeddings must agree."""
        return EmbeddingMemory(
            np.concatenate([self.vectors, other.vectors]),
            np.concatenate([self.valid, other.valid]),
            np.concatenate([self.time_ns, other.time_ns]),
        )

    def similarity(self, embeddings: ArrayLike) -> Floats:
        """Return the cosine similarity of every track with every detection (eq. 9): (N, M) in [-1, 1].

        It is the largest over a track's embeddings, as in the paper any one vector may trigger the match, and -inf
        where the track or the detection has no embedding, so that no threshold lets the pair pass.
        """
        unit, present = normalize_embeddings(embeddings, (None, self.dim))
        each = np.clip(self.vectors @ unit.T, -1.0, 1.0)  # (N, W, M)
        best = np.where(self.valid[:, :, None], each, -np.inf).max(axis=1)
        return np.where(np.logical_and.outer(self.known, present), best, -np.inf).astype(np.float64)
