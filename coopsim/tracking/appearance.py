"""Re-identification by appearance: the second and third step of DINO-CoDT's association (sec. III-G).

After boxes have been compared, unmatched tracks and detections are matched by their embeddings, within a temporal
window. A detection that is still unmatched is compared with other agents' detections of the same time and the memories
of their tracks; on a match it belongs to that track, whose memory it refreshes. The older id wins: a track that has not
been reported yet gives its detection to a lost track that looks the same. Without embeddings none of this happens.

The paper sets no limit to the distance of two objects that look alike. There is one here, because cars of one model
look alike; infinity removes it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from coopsim.geometry.assignment import greedy
from coopsim.geometry.iou import center_distance_bev
from coopsim.geometry.se3 import Floats
from coopsim.support.checks import require_between, require_count, require_number, require_positive
from coopsim.tracking.affinity import fgam
from coopsim.tracking.cascade import Stage
from coopsim.tracking.track_states import EmbeddingMemory, TrackStates
from coopsim.types import Detections, Ints, Mask
from coopsim.types.valid_detections import normalize_embeddings


@dataclass(frozen=True, slots=True)
class Appearance:
    """Settings of re-identification. The paper gives none of these numbers.

    Attributes:
        window_s: age from which an embedding is forgotten. A reported track is kept while it has one, to be found again
            (see `Remembered`).
        views: most embeddings kept of a track, the latest ones.
        similarity: smallest cosine similarity of a track and a detection, in [-1, 1] (the paper's beta).
        reach_m: largest distance of an object from its predicted place, for each frame without a detection.
        cross_similarity: smallest cosine similarity of two agents' detections of one object, in [-1, 1].
        cross_reach_m: largest distance between two agents' boxes of one object, by errors of poses and by delays.
    """

    window_s: float = 3.0
    views: int = 30
    similarity: float = 0.9
    reach_m: float = 3.0
    cross_similarity: float = 0.9
    cross_reach_m: float = 5.0

    def __post_init__(self) -> None:
        require_positive(window_s=self.window_s)
        require_count(1, views=self.views)
        require_between(-1, 1, similarity=self.similarity, cross_similarity=self.cross_similarity)
        reaches = {"reach_m": self.reach_m, "cross_reach_m": self.cross_reach_m}
        require_number("> 0 (inf: no limit)", lambda reach: reach > 0, **reaches)

    def stage(self) -> Stage:
        """Return the stage of a cascade that matches by embeddings, most similar pairs first (eq. 9)."""
        return Stage(self.affinity, greedy, self.similarity, tracks=_have_embeddings, detections=_show_embeddings)

    def affinity(self, tracks: TrackStates, detections: Detections, /) -> Floats:
        """Return the cosine similarity of N tracks and M detections (N, M): the best over each track's memory (eq. 9).

        It is -inf out of reach, and where either has no embedding. The reach depends on whose box it is: `reach_m` per
        missed frame where the receiver itself saw track and detection; at least `cross_reach_m` where either came
        through another agent's pose.

        Only a tracker that has an `Appearance` keeps embeddings of its tracks.
        """
        similarity = tracks.appearance.similarity(tracks.appearance.readable(detections))
        distance_m = -center_distance_bev(tracks.boxes, detections.boxes.array)
        reach_m = self.reach_m * np.maximum(tracks.misses, 1)[:, None]
        foreign = np.logical_or.outer(tracks.foreign, seen_by_others(detections))
        reach_m = np.where(foreign, np.maximum(reach_m, self.cross_reach_m), reach_m)
        return np.where(distance_m <= reach_m, similarity, -np.inf)

    def older(self, tracks: TrackStates, detections: Detections, rows: Ints, columns: Ints, reported: Mask) -> Ints:
        """Find the lost tracks that the detections of younger tracks look like: the historical id supersedes.

        The younger track must have begun after the older one was last seen, and must not have been reported, so that no
        report takes an id back.

        Tracks at `rows` (K,) were matched to the detections at `columns` (K,); `reported` (N,) masks the tracks that
        have been reported. Return for each pair the row (K,) of the track that its detection belongs to.
        """
        lost = np.setdiff1d(np.flatnonzero(tracks.appearance.known), rows)
        young = np.flatnonzero(~reported[rows])
        if not (len(lost) and len(young)):
            return rows
        old, new = tracks[lost], tracks[rows[young]]
        possible = (new.age < old.misses[:, None]) & (new.label == old.label[:, None])
        affinity = np.where(possible, self.affinity(old, detections[columns[young]]), -np.inf)
        first, second = greedy(affinity, self.similarity)
        rows = rows.copy()
        rows[young[second]] = lost[first]
        return rows

    def repeats(self, found: Detections, matched: Ints, memory: EmbeddingMemory | None = None) -> Ints:
        """Find the detections that repeat another agent's detection of the same object, at one moment.

        An unmatched detection repeats another agent's detection of its class within `cross_reach_m` if it looks like
        it, or like the memory of the track that was matched to it. It then belongs to that track (the historical id
        supersedes) and begins none. Among unmatched detections the best-scored one stands for the others. No agent
        sees an object twice, so two detections of one agent are never taken for one.

        Without `seen_by` none is repeated. Rows `matched` (K,) have a track and repeat none; `memory` is that of those
        K tracks, None to compare detections with each other alone. Return for each detection the row (N,) of the one
        that it repeats, or its own.
        """
        shown = np.arange(len(found))
        if found.embedding is None or found.seen_by is None or len(matched) == len(found):
            return shown
        rest = np.setdiff1d(shown, matched)
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
            else:  # a detection that looks like no better-scored one stands for itself
                surer = np.triu(possible[np.ix_(rest, rest)] >= self.cross_similarity, k=1)
                first = ~surer.any(axis=0)
                standing, rest = np.concatenate([standing, rest[first]]), rest[~first]
        return shown

    def _alike(self, found: Detections, embedding: Floats, matched: Ints, memory: EmbeddingMemory | None) -> Floats:
        """Return the cosine similarity (N, N) of detections of one class within reach, else -inf; symmetric."""
        unit, present = normalize_embeddings(embedding)
        alike = np.where(np.logical_and.outer(present, present), unit @ unit.T, -np.inf).astype(np.float64)
        if memory is not None:
            remembered = memory.similarity(memory.readable(found))
            alike[matched] = np.maximum(alike[matched], remembered)
            alike[:, matched] = np.maximum(alike[:, matched], remembered.T)
        near = center_distance_bev(found.boxes.array, found.boxes.array) >= -self.cross_reach_m
        return np.where(near & (found.label[:, None] == found.label), alike, -np.inf)


def seen_by_others(found: Detections) -> Mask:
    """Return which detections (N,) came from other agents only, not from the first, the receiver."""
    return np.zeros(len(found), dtype=bool) if found.seen_by is None else ~found.seen_by[:, 0]


def _have_embeddings(tracks: TrackStates) -> Mask:
    return tracks.appearance.known


def _show_embeddings(found: Detections) -> Mask:
    return np.full(len(found), found.embedding is not None)


_LONG_S = 1e6


@dataclass(frozen=True, slots=True)
class LastEmbedding(Appearance):
    """Keeps the last embedding of each track, for the association alone: nothing is found again or suppressed by it."""

    window_s: float = _LONG_S
    views: int = 1

    def older(self, tracks: TrackStates, detections: Detections, rows: Ints, columns: Ints, reported: Mask) -> Ints:
        return rows

    def repeats(self, found: Detections, matched: Ints, memory: EmbeddingMemory | None = None) -> Ints:
        return np.arange(len(found))


@dataclass(frozen=True, slots=True)
class YolooAffinity:
    """The affinity 2 - c_p - c_g of N tracks and M detections, in [0, 2]; -inf where c_g exceeds 1.

    c_g is the distance in units of the smaller box, and c_p is 1 less the cosine of the embeddings, at most 1 (the
    source says that it is in [0, 1]). A pair without embeddings is compared by geometry alone: its c_g counts twice, so
    that its cost is of the same size as those of other pairs.

    Attributes:
        count: called with the numbers of possible pairs of one class that were compared with looks, and without.
    """

    count: Callable[[int, int], None]

    def __call__(self, tracks: TrackStates, detections: Detections, /) -> Floats:
        near = fgam(tracks, detections)
        alike = tracks.appearance.similarity(tracks.appearance.readable(detections))
        known = np.isfinite(alike)
        possible = np.isfinite(near) & (tracks.label[:, None] == detections.label)
        self.count(int((possible & known).sum()), int((possible & ~known).sum()))
        return near + np.where(known, np.maximum(alike, 0.0), near)
