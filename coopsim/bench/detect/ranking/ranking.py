"""Ranked hits and misses of detections, and what the protocols make of them: areas, recalls and rates."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from coopsim.geometry.se3 import Floats
from coopsim.metrics.average_precision import area_of_all_points
from coopsim.types import Ints, Mask

SURE = 0.3
"""Score above which a detection is believed, where a recall or a rate of false boxes is counted."""

_RECALLS = np.linspace(0.0, 1.0, 101)


@dataclass(frozen=True, slots=True, eq=False)
class Ranking:
    """The K detections that count in a metric, frame by frame, and within each by falling score.

    Attributes:
        score: (K,).
        hit: (K,) whether the detection is on an object.
        objects: number of objects to be found.
        frames: number of frames of receivers.
    """

    score: Floats
    hit: Mask
    objects: int
    frames: int

    @classmethod
    def of(cls, found_start: Ints, score: Floats, hit: Mask, kept: Mask, objects: int) -> Ranking:
        """Rank the detections `kept` (N,) of frames that begin at the rows `found_start` (R + 1,)."""
        frame = np.repeat(np.arange(len(found_start) - 1), np.diff(found_start))
        order = np.lexsort((-score, frame))
        order = order[kept[order]]
        return cls(score[order], hit[order], objects, len(found_start) - 1)

    @classmethod
    def joined(cls, parts: Sequence[Ranking]) -> Ranking:
        """Join the rankings of several episodes."""
        return cls(
            np.concatenate([np.zeros(0), *(part.score for part in parts)]),
            np.concatenate([np.zeros(0, np.bool_), *(part.hit for part in parts)]),
            sum(part.objects for part in parts),
            sum(part.frames for part in parts),
        )

    @property
    def pooled(self) -> Mask:
        """The hits (K,) by falling score over all frames; equal scores stay in the order in which they are listed."""
        ranked: Mask = self.hit[np.argsort(-self.score, kind="stable")]
        return ranked

    def area(self) -> float:
        """Compute the area of all points under precision over recall, frames ranked together; NaN without objects.

        Equal scores are one step of the curve.
        """
        return area_of_all_points(self.hit, self.objects, self.score) if self.objects else np.nan

    def area_by_frame(self) -> float:
        """Compute the area with frames ranked one after another, each by its own scores: OpenCOOD's default."""
        return area_of_all_points(self.hit, self.objects) if self.objects else np.nan

    def area_without_first_step(self) -> float:
        """Compute the area without the step of the very first detection: DAIR-V2X sums from the second one on.

        Each detection is a step, and equal ones stay in the order in which they are listed, as in its code.
        """
        if not self.objects:
            return np.nan
        ranked = self.pooled
        # A first hit has precision 1, the best that there is, so its step is 1 / objects high.
        return area_of_all_points(ranked, self.objects) - float(ranked[:1].sum()) / self.objects

    def area_of_101_points(self, least_recall: float = 0.1, least_precision: float = 0.1) -> float:
        """Compute nuScenes' area: mean precision at recalls beyond the least, in steps of 0.01.

        Precision above the least is scaled to [0, 1]. Recalls that are not reached have precision 0.
        """
        if not self.objects:
            return np.nan
        true = np.cumsum(self.pooled)
        if not len(true) or not true[-1]:
            return 0.0
        precision, recall = true / np.arange(1, len(true) + 1), true / self.objects
        at_recalls = np.interp(_RECALLS, recall, precision, right=0)[round(100 * least_recall) + 1 :]
        return min(1.0, float(np.mean(np.maximum(at_recalls - least_precision, 0.0)) / (1.0 - least_precision)))

    def recall(self, least_score: float = SURE) -> float:
        """Return the share of the objects with a detection above a score; NaN without objects."""
        return float(np.count_nonzero(self.hit[self.score > least_score])) / self.objects if self.objects else np.nan

    def false_per_frame(self, least_score: float = SURE) -> float:
        """Return the number of detections above a score that are on no object, in a frame of a receiver."""
        return float(np.count_nonzero(~self.hit[self.score > least_score])) / max(self.frames, 1)
