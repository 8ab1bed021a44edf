"""AB3DMOT's averages over recall (Weng, Wang, Held and Kitani, "3D Multi-Object Tracking: A Baseline and New
Evaluation Metrics", IROS 2020, sec. IV).

A tracker's score depends on the confidence from which it reports a track. So CLEAR is computed at 40 levels of recall,
each reached by a threshold of mean track score, and averaged. Identity switches are counted as in AB3DMOT's code,
which took the rule from KITTI's: only between two successive frames of an object.

AB3DMOT's code gives each level a match of its own, and drops level 0. So with n <= 40 boxes it reaches n - 1 levels at
most, and a perfect tracker of 20 boxes would have 47.5. Here one match may reach several levels of so few boxes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from coopsim.geometry.se3 import Floats
from coopsim.metrics.clear import Clear, count_clear
from coopsim.metrics.matching import NumberedSequence

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


@dataclass(frozen=True, slots=True)
class RecallSweep:
    """CLEAR at all levels of recall that a tracker reaches.

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

    @property
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
    points = []
    for recall, threshold in recall_thresholds(scores, all_tracks.gt):
        clear, _ = count_clear(sequences, threshold=threshold, adjacent_switches=True)
        points.append(OperatingPoint(recall, threshold, clear))
    return RecallSweep(all_tracks, tuple(points))


def recall_thresholds(scores: Floats, truth: int) -> list[tuple[float, float]]:
    """Find the levels of recall and the scores at which they are reached.

    As in AB3DMOT's code, each level, in steps of 1/40 from 0, is assigned to the match whose recall is nearest to it;
    level 0 is left out. Of up to 40 boxes a level is assigned to the first match with which recall reaches it; of 41
    both rules are the same.

    Args:
        scores: (TP,) mean track score of every match.
        truth: number of truth boxes.
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
