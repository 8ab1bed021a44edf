"""Finding objects again by what they look like: the second and third step of DINO-CoDT's association (sec. III-G).

After the boxes have been compared, tracks and detections that are left over are matched by their embeddings, within a
temporal window; a detection that is left over even then is compared with those of other agents at the same
time. Without embeddings nothing of this happens.

The paper puts no limit to how far apart two things may be that look alike. There is one here, because cars of one model
do look alike; infinity takes it away.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from coopsim.geometry.assignment import greedy
from coopsim.geometry.se3 import Floats
from coopsim.support.checks import require_between, require_count, require_number
from coopsim.tracking.affinity.overlap import center_distance_bev
from coopsim.tracking.affinity.reid import EmbeddingMemory
from coopsim.tracking.cascade import Stage
from coopsim.tracking.tracked import Tracked
from coopsim.types import Detections, Ints, Mask
from coopsim.types.embedding import directions


@dataclass(frozen=True, slots=True)
class Appearance:
    """What is kept of embeddings, and when two of them are one object. The paper gives none of these numbers.

    Attributes:
        views: how many embeddings of a track are kept, the latest.
        frames: without a detection, for which a track that was reported is kept to be found again (see `Remembered`).
        similarity: smallest cosine similarity of a track and a detection, in [-1, 1] (the paper's beta).
        reach_m: how far an object may be from where it is expected, for each frame without a detection.
        cross_similarity: smallest cosine similarity of two agents' detections of one object, in [-1, 1].
        cross_reach_m: how far they may be apart, by errors of poses and by delays.
    """

    views: int = 10
    frames: int = 30
    similarity: float = 0.9
    reach_m: float = 3.0
    cross_similarity: float = 0.9
    cross_reach_m: float = 5.0

    def __post_init__(self) -> None:
        require_count(1, views=self.views, frames=self.frames)
        require_between(-1, 1, similarity=self.similarity, cross_similarity=self.cross_similarity)
        reaches = {"reach_m": self.reach_m, "cross_reach_m": self.cross_reach_m}
        require_number("> 0 (inf: no limit)", lambda reach: reach > 0, **reaches)

    def stage(self) -> Stage:
        """The stage of a cascade that matches by embeddings: whoever is most alike first (eq. 9)."""
        return Stage(self.affinity, greedy, self.similarity)

    def affinity(self, tracks: Tracked, found: Detections, /) -> Floats:
        """Return the cosine similarity of N tracks and M detections (N, M): the best over each track's memory (eq. 9).

        It is -inf out of reach, and where either has no embedding. How far a box may lie from its predicted track
        depends on whose box it is: one that the receiver saw itself, on a track that it saw itself, `reach_m` per
        missed frame; one that reached either through another agent's pose at least `cross_reach_m`.

        Only a tracker that has an `Appearance` keeps embeddings of its tracks.
        """
        similarity = tracks.appearance.similarity(tracks.appearance.readable(found))
        distance_m = -center_distance_bev(tracks.boxes, found.boxes.array)
        reach_m = self.reach_m * np.maximum(tracks.misses, 1)[:, None]
        foreign = np.logical_or.outer(tracks.foreign, seen_by_others(found))
        reach_m = np.where(foreign, np.maximum(reach_m, self.cross_reach_m), reach_m)
        return np.where(distance_m <= reach_m, similarity, -np.inf)

    def repeats(self, found: Detections, matched: Ints, memory: EmbeddingMemory | None = None) -> Ints:
        """Return for each of one moment's N detections the row (N,) of the one that shows its object already.

        A detection that no track was matched to repeats another agent's detection of its class, within
        `cross_reach_m`, if it looks like it, or like the memory of the track that this one was matched to. It then
        belongs to that track (the historical id supersedes) and begins none. Among detections without a track the one
        with the best score stands for the others. No agent sees an object twice, so two detections of one agent are
        never taken for one.

        Args:
            found: with `seen_by`; without it, none is repeated.
            matched: (K,) rows that a track was matched to; they stand for themselves.
            memory: of those K tracks, in that order; None: detections are only compared with each other.

        Returns:
            The row of the detection itself where it repeats none.
        """
        shown = np.arange(len(found))
        rest = np.setdiff1d(shown, matched)
        if found.embedding is None or found.seen_by is None or not len(rest):
            return shown
        alike, seen_by = self._alike(found, found.embedding, matched, memory), found.seen_by.copy()
        standing, rest = matched, rest[np.argsort(-found.score[rest], kind="stable")]
        while len(rest):
            apart = seen_by @ seen_by.T
            possible = np.where(apart, -np.inf, alike)
            rows, columns = greedy(possible[np.ix_(standing, rest)], self.cross_similarity)
            if len(rows):
                shown[rest[columns]] = standing[rows]
                seen_by[standing[rows]] |= seen_by[rest[columns]]
                rest = np.delete(rest, columns)
            else:  # whatever looks like no surer one stands for itself
                surer = np.triu(possible[np.ix_(rest, rest)] >= self.cross_similarity, k=1)
                first = ~surer.any(axis=0)
                standing, rest = np.concatenate([standing, rest[first]]), rest[~first]
        return shown

    def _alike(self, found: Detections, embedding: Floats, matched: Ints, memory: EmbeddingMemory | None) -> Floats:
        """Return the cosine similarity (N, N) of detections of one class within reach, else -inf; symmetric."""
        unit, present = directions(embedding)
        alike = np.where(np.logical_and.outer(present, present), unit @ unit.T, -np.inf).astype(np.float64)
        if memory is not None:
            remembered = memory.similarity(memory.readable(found))
            alike[matched] = np.maximum(alike[matched], remembered)
            alike[:, matched] = np.maximum(alike[:, matched], remembered.T)
        near = center_distance_bev(found.boxes.array, found.boxes.array) >= -self.cross_reach_m
        return np.where(near & (found.label[:, None] == found.label), alike, -np.inf)


def seen_by_others(found: Detections) -> Mask:
    """Return which detections (N,) the first agent, the receiver, did not see itself."""
    return np.zeros(len(found), dtype=bool) if found.seen_by is None else ~found.seen_by[:, 0]
