"""CLEAR MOT (Bernardin and Stiefelhagen, EURASIP JIVP 2008), and its averages over recall of AB3DMOT and nuScenes."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from coopsim.geometry.se3 import Floats
from coopsim.metrics.matching import NEAR_M, NumberedSequence

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

    Tracks with a mean score below the threshold are left out. `adjacent_switches` counts a switch only between two
    successive frames of an object, as KITTI's development kit and AB3DMOT do; else also after a gap, as CLEAR and
    TrackEval do.
    """
    total = Clear()
    scores = [np.zeros(0)]
    for sequence in sequences:
        found = sequence.match(sequence.mean_score >= threshold)
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


def _count_by_threshold(
    sequences: Sequence[NumberedSequence], thresholds: Sequence[float], *, adjacent_switches: bool = False
) -> list[Clear]:
    """Count at each threshold; those that leave the same tracks, as of few tracks most do, are counted once."""
    counts: dict[int, Clear] = {}
    found = []
    for threshold in thresholds:
        left = sum(int(np.count_nonzero(sequence.mean_score >= threshold)) for sequence in sequences)
        if left not in counts:
            counts[left], _ = count_clear(sequences, threshold=threshold, adjacent_switches=adjacent_switches)
        found.append(counts[left])
    return found


def _ratio(part: float, whole: float) -> float:
    return part / whole if whole else 0.0


RECALL_POINTS = 40


@dataclass(frozen=True, slots=True)
class OperatingPoint:
    """CLEAR at one level of recall.

    Attributes:
        recall: the level aimed at, in (0, 1].
        threshold: smallest mean score of a reported track.
        clear: the counts.
    """

    recall: float
    threshold: float
    clear: Clear


@dataclass(frozen=True)
class RecallSweep:
    """AB3DMOT's averages over recall (Weng et al., IROS 2020, sec. IV): CLEAR at all levels that a tracker reaches.

    A tracker's score depends on the confidence from which it reports a track. So CLEAR is computed at 40 levels of
    recall, each reached by a threshold of mean track score, and averaged. Identity switches are counted as in AB3DMOT's
    code, which took the rule from KITTI's: only between two successive frames of an object.

    AB3DMOT's code gives each level a match of its own, and drops level 0. So with n <= 40 boxes it reaches n - 1 levels
    at most, and a perfect tracker of 20 boxes would have 47.5. Here one match may reach several levels of so few boxes.

    Attributes:
        all_tracks: plain CLEAR of every track, whatever its score, with switches across gaps.
        points: the reached levels, in order of rising recall; at most 40.
    """

    all_tracks: Clear
    points: tuple[OperatingPoint, ...]

    @property
    def samota(self) -> float:
        """Mean scaled MOTA over 40 levels (eq. 5); an unreached level counts 0."""
        return sum(point.clear.scaled_mota(point.recall) for point in self.points) / RECALL_POINTS

    @property
    def amota(self) -> float:
        """Mean MOTA over 40 levels (eq. 2); an unreached level counts 0."""
        return sum(point.clear.mota for point in self.points) / RECALL_POINTS

    @property
    def amotp(self) -> float:
        """Mean MOTP over 40 levels; an unreached level counts 0."""
        return sum(point.clear.motp for point in self.points) / RECALL_POINTS

    @cached_property
    def best(self) -> Clear:
        """CLEAR at the level with the highest MOTA, as in AB3DMOT's tables; of all tracks without levels."""
        candidates = [point.clear for point in self.points]
        return max(candidates, key=lambda clear: clear.mota, default=self.all_tracks)

    def without_false_positives(self) -> RecallSweep:
        """Return the sweep without false positives; neither the matching nor the levels depend on them."""
        points = (replace(point, clear=replace(point.clear, fp=0)) for point in self.points)
        return RecallSweep(replace(self.all_tracks, fp=0), tuple(points))


def sweep_recall(sequences: Sequence[NumberedSequence]) -> RecallSweep:
    """Compute CLEAR at every level of recall."""
    all_tracks, scores = count_clear(sequences)
    levels = recall_thresholds(scores, all_tracks.gt)
    counts = _count_by_threshold(sequences, [threshold for _, threshold in levels], adjacent_switches=True)
    points = (OperatingPoint(*level, clear) for level, clear in zip(levels, counts, strict=True))
    return RecallSweep(all_tracks, tuple(points))


def recall_thresholds(scores: Floats, truth: int) -> list[tuple[float, float]]:
    """Find the levels of recall and the scores at which they are reached, of all matches (TP,) of `truth` boxes.

    As in AB3DMOT's code, each level, in steps of 1/40 from 0, is assigned to the match whose recall is nearest to it;
    level 0 is left out. Of up to 40 boxes a level is assigned to the first match with which recall reaches it; of 41
    both rules are the same.
    """
    ordered = np.sort(scores)[::-1]
    if truth <= RECALL_POINTS:
        reached = len(scores) * RECALL_POINTS // max(truth, 1)
        # The first match from which level k / 40 is reached is number ceil(k / 40 * truth), counted from 1.
        first = [-(-k * truth // RECALL_POINTS) - 1 for k in range(1, reached + 1)]
        return [(k / RECALL_POINTS, float(ordered[match])) for k, match in enumerate(first, start=1)]
    found: list[tuple[float, float]] = []
    level = 0.0
    for k, score in enumerate(ordered.tolist()):
        last = k == len(ordered) - 1
        here = (k + 1) / truth
        following = here if last else (k + 2) / truth
        if not last and following - level < level - here:
            continue
        found.append((level, score))
        level += 1 / RECALL_POINTS
    return found[1:]


RECALLS = np.linspace(0.1, 1.0, 40).round(12)  # rounded as in the development kit


@dataclass(frozen=True, slots=True)
class NearSweep:
    """nuScenes' averages over levels of recall from 0.1 (Caesar et al., CVPR 2020, and its development kit).

    Like AB3DMOT's, tracks are cut by their mean score; unlike there, an object of any size is matched within 2 m,
    thresholds are interpolated between scores, and an unreached level of recall counts as the worst value.

    Attributes:
        amota: mean MOTAR, in [0, 1].
        amotp: mean distance of matched centres, in [0, 2] m; smaller is better.
        best: CLEAR at the level with the highest MOTA, of several the one with the highest recall; None: no level is
            reached.
    """

    amota: float
    amotp: float
    best: Clear | None = None


def sweep_near(sequences: Sequence[NumberedSequence]) -> NearSweep:
    """Count at every level of recall; the pairs' similarity is 1 - distance / 2 m."""
    thresholds = score_thresholds(_match_scores(sequences), sum(len(each.arrays.truth) for each in sequences))
    levels = _count_by_threshold(sequences, thresholds)
    missing = len(RECALLS) - len(levels)
    distances = [NEAR_M * (1.0 - level.motp) for level in levels]
    best = max(reversed(levels), key=lambda level: max(level.mota, 0.0), default=None)
    return NearSweep(sum(map(_motar, levels)) / len(RECALLS), (sum(distances) + missing * NEAR_M) / len(RECALLS), best)


def score_thresholds(scores: Floats, truth: int) -> list[float]:
    """Find the mean track scores, of all matches (TP,), at which levels of recall of `truth` boxes are reached."""
    if not len(scores):
        return []
    recall = np.arange(1, len(scores) + 1) / truth
    found: list[float] = np.interp(RECALLS[recall[-1] >= RECALLS], recall, np.sort(scores)[::-1]).tolist()
    return found


def _match_scores(sequences: Sequence[NumberedSequence]) -> Floats:
    """Return the mean track score (TP,) of every match that is not an identity switch, with all tracks."""
    scores = [np.zeros(0)]
    for sequence in sequences:
        found = sequence.match()
        kept = found.track_of[(found.track_of >= 0) & ~found.switched]
        scores.append(sequence.mean_score[kept])
    return np.concatenate(scores)


def _motar(clear: Clear) -> float:
    """Return 1 - (IDS + FP + FN - (1 - r) GT) / (r GT), at least 0, with the measured recall r.

    The development kit does not count a switch as a match, so r GT = TP - IDS, and only FP stays in the numerator.
    """
    matches = clear.tp - clear.ids
    return max(0.0, 1.0 - clear.fp / matches) if matches else 0.0
