"""What tracks looked like: the memory by which a lost track is found again.

DINO-CoDT, sec. III-G ("Data Association and Tracklet RE-IDentification"), keeps a look-up table of each track's last
feature vectors (its eq. 8) and compares a detection that nothing else matched (eq. 7) with them by cosine similarity
(eq. 9): above a strict threshold they are the same object. Then the same is tried with other agents' vectors of the
same time. The table is here, what a tracker does with it in `appearance`. What makes the vectors is the caller's
choice: the paper takes layer 31 of DINOv2.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from coopsim.geometry.se3 import Floats
from coopsim.support.arrays import frozen
from coopsim.support.checks import require_choice, require_count
from coopsim.types import Detections, Mask
from coopsim.types.embedding import directions

Index = NDArray[np.integer] | NDArray[np.bool_]


@dataclass(frozen=True, slots=True, eq=False)
class EmbeddingMemory:
    """The last W embeddings of each of N tracks, first in, first out. Never changes; every change is a new memory.

    An embedding that is not finite, or all zeros, is none: it is not stored, pushes no other out, and is like nothing.
    `readable` makes such rows for detections without an embedding. Until there is one, D is 0.

    Attributes:
        vectors: (N, W, D), of length 1, the newest last; zeros where there is none.
        valid: (N, W) bool, where there is one.
    """

    vectors: NDArray[np.float32]
    valid: NDArray[np.bool_]

    def __post_init__(self) -> None:
        object.__setattr__(self, "vectors", frozen(self.vectors, (None, None, None), np.float32, "vectors"))
        object.__setattr__(self, "valid", frozen(self.valid, self.vectors.shape[:2], np.bool_, "valid"))
        require_count(1, window=self.window)

    @classmethod
    def blank(cls, count: int, dim: int, window: int) -> EmbeddingMemory:
        """Of tracks of which nothing is known.

        Args:
            count: N.
            dim: D, length of an embedding.
            window: W, how many embeddings of a track are kept.
        """
        require_count(0, count=count, dim=dim)
        require_count(1, window=window)
        return cls(np.zeros((count, window, dim), dtype=np.float32), np.zeros((count, window), dtype=np.bool_))

    @property
    def window(self) -> int:
        """W."""
        return int(self.vectors.shape[1])

    @property
    def dim(self) -> int:
        """D."""
        return int(self.vectors.shape[2])

    def __len__(self) -> int:
        return len(self.vectors)

    @property
    def known(self) -> Mask:
        """(N,) of which tracks there is an embedding."""
        known: Mask = np.any(self.valid, axis=1)  # numpy types the method as a scalar
        return known

    def ready_for(self, found: Detections) -> EmbeddingMemory:
        """A blank one with the width of these detections' embeddings, or, once something is known, this one.

        So the first width that comes stands, until all tracks that were known by it are gone.
        """
        if found.embedding is None or found.embedding.shape[1] == self.dim or self.valid.any():
            return self
        return EmbeddingMemory.blank(len(self), found.embedding.shape[1], self.window)

    def readable(self, found: Detections) -> Floats:
        """The detections' embeddings, (M, D): NaN where they have none, or of a width that says nothing here."""
        if found.embedding is None or found.embedding.shape[1] != self.dim:
            return np.full((len(found), self.dim), np.nan)
        return found.embedding

    def born(self, embeddings: ArrayLike) -> EmbeddingMemory:
        """Of M new tracks alone, one embedding each, (M, D); `join` adds them."""
        unit, present = directions(embeddings, (None, self.dim))
        vectors = np.zeros((len(unit), self.window, self.dim), dtype=np.float32)
        valid = np.zeros((len(unit), self.window), dtype=np.bool_)
        vectors[:, -1], valid[:, -1] = unit, present
        return EmbeddingMemory(vectors, valid)

    def update(self, rows: Index, embeddings: ArrayLike) -> EmbeddingMemory:
        """With one more embedding for some tracks; where a window was full, its oldest is gone.

        Args:
            rows: M different ones: indices, or a mask (N,).
            embeddings: (M, D).
        """
        at = np.arange(len(self))[rows]
        unit, present = directions(embeddings, (len(at), self.dim))
        if not present.any():
            return self
        at, unit = at[present], unit[present]
        vectors, valid = self.vectors.copy(), self.valid.copy()
        vectors[at, :-1], valid[at, :-1] = self.vectors[at, 1:], self.valid[at, 1:]
        vectors[at, -1], valid[at, -1] = unit, True
        return EmbeddingMemory(vectors, valid)

    def take(self, index: Index) -> EmbeddingMemory:
        """Of some tracks: a mask (N,) or indices."""
        return EmbeddingMemory(self.vectors[index], self.valid[index])

    def join(self, other: EmbeddingMemory) -> EmbeddingMemory:
        """Of these tracks, then the other's; windows and lengths of embeddings must agree."""
        added = frozen(other.vectors, (None, self.window, self.dim), np.float32, "vectors of the other memory")
        return EmbeddingMemory(np.concatenate([self.vectors, added]), np.concatenate([self.valid, other.valid]))

    def similarity(self, embeddings: ArrayLike, over: str = "best") -> Floats:
        """Cosine similarity of every track with every detection (eq. 9): (N, M) in [-1, 1].

        It is -inf where the track or the detection has no embedding, so that no threshold lets the pair pass.

        Args:
            embeddings: (M, D).
            over: the window; "best" takes the largest, as in the paper any one of a track's vectors may trigger the
                match; "mean" is steadier where single crops are poor.
        """
        require_choice("over", over, ("best", "mean"))
        unit, present = directions(embeddings, (None, self.dim))
        each = np.clip(self.vectors @ unit.T, -1.0, 1.0)  # (N, W, M)
        if over == "best":
            pooled = np.where(self.valid[:, :, None], each, -np.inf).max(axis=1)
        else:
            # What is not valid is zeros and adds nothing to the sum.
            pooled = each.sum(axis=1) / np.maximum(self.valid.sum(axis=1), 1)[:, None]
        return np.where(np.logical_and.outer(self.known, present), pooled, -np.inf).astype(np.float64)
