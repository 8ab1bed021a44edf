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
        """Cosine similarity of N tracks and M detections, (N, M); -inf out of reach, and where either has no embedding.

        Only a tracker that has an `Appearance` keeps embeddings of its tracks.
        """
        similarity = tracks.appearance.similarity(tracks.appearance.readable(found))
        distance_m = -center_distance_bev(tracks.boxes, found.boxes.array)
        return np.where(distance_m <= self.reach_m * np.maximum(tracks.misses, 1)[:, None], similarity, -np.inf)

    def repeated(self, found: Detections, matched: Ints) -> Mask:
        """Which of one moment's N detections show what another agent's shows already: (N,); they begin no track.

        Whatever a track is matched to stays as it is. Of the others, those are repeated that look like another agent's
        detection which has a track or, failing that, a better score. No agent sees an object twice, so two detections
        of one agent are never taken for one.

        Args:
            found: with `seen_by`; without it, none is repeated.
            matched: (K,) those that a track is matched to.
        """
        repeated, unmatched = np.zeros(len(found), dtype=bool), np.setdiff1d(np.arange(len(found)), matched)
        if found.embedding is None or found.seen_by is None or not len(unmatched):
            return repeated
        alike = self._alike_across_agents(found, found.embedding, found.seen_by)
        _, again = greedy(alike[np.ix_(matched, unmatched)], self.cross_similarity)
        repeated[unmatched[again]] = True
        rest = unmatched[~repeated[unmatched]]
        rest = rest[np.argsort(-found.score[rest], kind="stable")]
        surer = np.triu(np.ones((len(rest), len(rest)), dtype=bool), k=1)
        shown, again = greedy(np.where(surer, alike[np.ix_(rest, rest)], -np.inf), self.cross_similarity)
        # What is itself repeated shows nothing: by way of it, two detections of one agent could become one.
        repeated[rest[again[~np.isin(shown, again)]]] = True
        return repeated

    def _alike_across_agents(self, found: Detections, embedding: Floats, seen_by: Mask) -> Floats:
        """Cosine similarity (N, N) of detections of one class, within reach, that no agent saw both of; else -inf."""
        unit, present = directions(embedding)
        possible = np.logical_and.outer(present, present) & (found.label[:, None] == found.label)
        possible &= ~(seen_by @ seen_by.T)
        possible &= center_distance_bev(found.boxes.array, found.boxes.array) >= -self.cross_reach_m
        return np.where(possible, unit @ unit.T, -np.inf).astype(np.float64)
