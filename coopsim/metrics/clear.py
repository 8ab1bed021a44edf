"""CLEAR MOT: counts, and the ratios made of them (Bernardin and Stiefelhagen, EURASIP JIVP 2008)."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from coopsim.geometry.se3 import Floats
from coopsim.metrics.matching import NumberedSequence, match_sequence

MOSTLY_TRACKED, MOSTLY_LOST = 0.8, 0.2


@dataclass(frozen=True, slots=True)
class Clear:
    """Counts over any number of sequences, and the ratios that follow from them (fractions, not per cent).

    Attributes:
        tp: matched boxes.
        fp: reported boxes without an object (0 where false positives are ignored).
        fn: boxes of objects without a matched track.
        ids: identity switches.
        frag: interruptions of an object's track.
        similarity: sum of the matched pairs' similarity (3D IoU in all but the metrics by distance).
        objects: number of objects.
        mostly_tracked: number of objects matched in more than 80 % of their frames.
        mostly_lost: number of objects matched in less than 20 % of their frames.
    """

    tp: int = 0
    fp: int = 0
    fn: int = 0
    ids: int = 0
    frag: int = 0
    similarity: float = 0.0
    objects: int = 0
    mostly_tracked: int = 0
    mostly_lost: int = 0

    def __add__(self, other: Clear) -> Clear:
        return Clear(*(getattr(self, name) + getattr(other, name) for name in Clear.__slots__))

    @property
    def gt(self) -> int:
        """Number of objects' boxes."""
        return self.tp + self.fn

    @property
    def mota(self) -> float:
        """1 - (FP + FN + IDS) / GT; -FP without truth, as in TrackEval."""
        return (self.tp - self.fp - self.ids) / max(self.gt, 1)

    @property
    def motp(self) -> float:
        """Mean similarity of matched pairs."""
        return _ratio(self.similarity, self.tp)

    @property
    def moda(self) -> float:
        """1 - (FP + FN) / GT: MOTA without identities (Kasturi et al., PAMI 2009)."""
        return (self.tp - self.fp) / max(self.gt, 1)

    @property
    def smota(self) -> float:
        """MOTA in which a match counts its 3D IoU (Voigtlaender et al., "MOTS", CVPR 2019)."""
        return (self.similarity - self.fp - self.ids) / max(self.gt, 1)

    @property
    def partly_tracked(self) -> int:
        """Number of objects that are neither mostly tracked nor mostly lost."""
        return self.objects - self.mostly_tracked - self.mostly_lost

    @property
    def recall(self) -> float:
        """TP / GT."""
        return _ratio(self.tp, self.gt)

    @property
    def precision(self) -> float:
        """TP / (TP + FP)."""
        return _ratio(self.tp, self.tp + self.fp)

    def scaled_mota(self, recall: float) -> float:
        """Scale MOTA by what is possible at a recall; in [0, 1] (Weng et al. 2020, eq. 4)."""
        errors = self.fp + self.fn + self.ids - (1.0 - recall) * self.gt
        return float(np.clip(1.0 - _ratio(errors, recall * self.gt), 0.0, 1.0))


def count_clear(
    sequences: Iterable[NumberedSequence],
    *,
    threshold: float = -np.inf,
    adjacent_switches: bool = False,
) -> tuple[Clear, Floats]:
    """Count over sequences. Return the counts, and the mean track score of every match (TP,).

    Args:
        sequences: pooled.
        threshold: leave out tracks with a smaller mean score.
        adjacent_switches: count a switch only between two successive frames of an object, as KITTI's development
            kit and AB3DMOT do; else also after a gap, as CLEAR and TrackEval do.
    """
    total = Clear()
    scores = [np.zeros(0)]
    for sequence in sequences:
        found = match_sequence(sequence.arrays, sequence.mean_score >= threshold, sequence.objects)
        hit = found.track_of >= 0
        scores.append(sequence.mean_score[found.track_of[hit]])
        share = found.matched / np.maximum(found.present, 1)
        total += Clear(
            tp=int(hit.sum()),
            fp=int(found.false_positives),
            fn=int((~hit).sum()),
            ids=int(found.adjacent_switches if adjacent_switches else found.switched.sum()),
            frag=int(np.maximum(found.fragments - 1, 0).sum()),
            similarity=float(found.similarity.sum()),
            objects=sequence.objects,
            mostly_tracked=int((share > MOSTLY_TRACKED).sum()),
            mostly_lost=int((share < MOSTLY_LOST).sum()),
        )
    return total, np.concatenate(scores)


def _ratio(part: float, whole: float) -> float:
    return part / whole if whole else 0.0
