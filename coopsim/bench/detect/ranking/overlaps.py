"""Pairs of detections and objects that lie on each other, and the matchings of the protocols, one rule each."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from coopsim.bench.detect.perceived.perceived import Perceived
from coopsim.geometry.iou import iou_3d_and_bev
from coopsim.geometry.se3 import Floats
from coopsim.metrics.average_precision import match_by_score, order_by_score
from coopsim.metrics.matching import SequenceArrays, frame_of
from coopsim.support.kernels import njit
from coopsim.types import Ints, Mask

FARTHEST_PAIR_M = 4.0
"""Largest distance of centres over ground at which a pair is kept: nuScenes' largest threshold."""

View = Literal["3D", "BEV"]


@dataclass(frozen=True, slots=True, eq=False)
class Overlaps:
    """The P pairs of an episode whose boxes overlap or whose centres are near, frame by frame.

    Attributes:
        perceived: the episode.
        frame: (P,).
        truth: (P,) row among all objects.
        found: (P,) row among all detections.
        similarity: by view, (P,) IoU; under "distance" the negative distance of the centres over ground, m.
    """

    perceived: Perceived
    frame: Ints
    truth: Ints
    found: Ints
    similarity: dict[str, Floats]

    @classmethod
    def of(cls, perceived: Perceived) -> Overlaps:
        """Compute all pairs of an episode."""
        parts = [_pairs_of_frame(perceived, frame) for frame in range(perceived.receiver_frames)]
        none, nothing = np.zeros(0, np.int64), np.zeros(0)
        frame, truth, found, solid, flat, away_m = (
            np.concatenate([empty, *(part[k] for part in parts)])
            for k, empty in enumerate((none, none, none, nothing, nothing, nothing))
        )
        return cls(perceived, frame, truth, found, {"3D": solid, "BEV": flat, "distance": -away_m})

    def matched_by_score(self, found: Mask, truth: Mask, by: str, least: float, *, listed: bool = True) -> Ints:
        """Match detections by falling score within each frame, each to the free object of largest similarity.

        Args:
            found: (N,) the detections that take part.
            truth: (M,) the objects that take part.
            by: "3D", "BEV" or "distance", see `similarity`.
            least: smallest similarity of a match.
            listed: take equal scores in the order of the list, as the code of other benchmarks does; else by their IoU.

        Returns:
            (N,) row of each detection's object, or -1.
        """
        score, sequence = self.perceived.found_score, self._sequence(self._kept(found, truth, by, least), by)
        in_list = np.lexsort((-score, frame_of(sequence.track_start)))
        return match_by_score(sequence, in_list if listed else order_by_score(sequence, score))

    def matched_by_object(self, found: Mask, truth: Mask, by: str, least: float) -> Ints:
        """Match objects in order, each with the free detection of largest similarity, whatever its score.

        Of equal similarities the lowest score wins, as in DAIR-V2X's code. Arguments and result as of
        `matched_by_score`.
        """
        there, kept = self.perceived, self._kept(found, truth, by, least)
        pairs = np.flatnonzero(kept)
        ordered = pairs[
            np.lexsort((there.found_score[self.found[pairs]], -self.similarity[by][pairs], self.truth[pairs]))
        ]
        return _match_objects(self.truth[ordered], self.found[ordered], len(there.found_score))

    def best_on(self, truth: Mask, by: str) -> Floats:
        """Return (N,) the largest similarity that each detection has with any of the objects (M,); 0 with none."""
        best = np.zeros(len(self.perceived.found_score))
        kept = truth[self.truth]
        np.maximum.at(best, self.found[kept], self.similarity[by][kept])
        return best

    def _kept(self, found: Mask, truth: Mask, by: str, least: float) -> Mask:
        return found[self.found] & truth[self.truth] & (self.similarity[by] >= least)

    def _sequence(self, kept: Mask, by: str) -> SequenceArrays:
        there, frame = self.perceived, self.frame[kept]
        return SequenceArrays(
            there.true_start,
            np.arange(len(there.true_label)),
            there.found_start,
            np.arange(len(there.found_label)),
            np.searchsorted(frame, np.arange(there.receiver_frames + 1)),
            self.truth[kept] - there.true_start[frame],
            self.found[kept] - there.found_start[frame],
            self.similarity[by][kept],
        )


def _pairs_of_frame(there: Perceived, frame: int) -> tuple[Ints, Ints, Ints, Floats, Floats, Floats]:
    first_truth, end_truth = there.true_start[frame], there.true_start[frame + 1]
    first_found, end_found = there.found_start[frame], there.found_start[frame + 1]
    truth, found = there.true_box[first_truth:end_truth], there.found_box[first_found:end_found]
    solid, flat = iou_3d_and_bev(truth, found)
    away_m = np.hypot(truth[:, None, 0] - found[None, :, 0], truth[:, None, 1] - found[None, :, 1])
    rows, columns = np.nonzero((flat > 0) | (away_m <= FARTHEST_PAIR_M))
    of_pairs = solid[rows, columns], flat[rows, columns], away_m[rows, columns]
    return np.full(len(rows), frame), first_truth + rows, first_found + columns, *of_pairs


@njit(cache=True, nogil=True)
def _match_objects(truth: Ints, found: Ints, count: int) -> Ints:
    """Take pairs (P,) in order, each if both of its sides are free. Return the object (N,) of each detection, or -1."""
    object_of = np.full(count, -1)
    last = -1
    for p in range(len(truth)):
        if truth[p] != last and object_of[found[p]] < 0:
            object_of[found[p]] = last = truth[p]
    return object_of
