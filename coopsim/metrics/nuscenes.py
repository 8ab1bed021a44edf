"""AMOTA and AMOTP in the manner of nuScenes: matched by distance on the ground, averaged over recall from 0.1.

Caesar et al., "nuScenes", CVPR 2020, and the development kit of its tracking task. Like AB3DMOT's, tracks are cut by
their mean score; unlike there, an object of any size is matched within 2 m, thresholds are interpolated between
scores, and an unreached level of recall counts as the worst value.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from coopsim.geometry.se3 import Floats
from coopsim.metrics.candidate_pairs import NEAR_M
from coopsim.metrics.clear import Clear, count_clear
from coopsim.metrics.matching import NumberedSequence, match_sequence

RECALLS = np.linspace(0.1, 1.0, 40).round(12)  # rounded as in the development kit


@dataclass(frozen=True, slots=True)
class NearSweep:
    """nuScenes' averages over levels of recall.

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
    levels = [count_clear(sequences, threshold=threshold)[0] for threshold in thresholds]
    missing = len(RECALLS) - len(levels)
    distances = [NEAR_M * (1.0 - level.motp) for level in levels]
    best = max(reversed(levels), key=lambda level: max(level.mota, 0.0), default=None)
    return NearSweep(sum(map(_motar, levels)) / len(RECALLS), (sum(distances) + missing * NEAR_M) / len(RECALLS), best)


def score_thresholds(scores: Floats, truth: int) -> list[float]:
    """Find the mean track scores at which the levels of recall are reached; unreached levels are left out.

    Args:
        scores: (TP,) mean track score of every match.
        truth: number of truth boxes.
    """
    if not len(scores):
        return []
    recall = np.arange(1, len(scores) + 1) / truth
    found: list[float] = np.interp(RECALLS[recall[-1] >= RECALLS], recall, np.sort(scores)[::-1]).tolist()
    return found


def _match_scores(sequences: Sequence[NumberedSequence]) -> Floats:
    """Return the mean track score (TP,) of every match that is not an identity switch, with all tracks."""
    scores = [np.zeros(0)]
    for sequence in sequences:
        found = match_sequence(sequence.arrays, np.ones(len(sequence.mean_score), np.bool_), sequence.objects)
        kept = found.track_of[(found.track_of >= 0) & ~found.switched]
        scores.append(sequence.mean_score[kept])
    return np.concatenate(scores)


def _motar(clear: Clear) -> float:
    """Return 1 - (IDS + FP + FN - (1 - r) GT) / (r GT), at least 0, with the measured recall r.

    The development kit does not count a switch as a match, so r GT = TP - IDS, and only FP stays in the numerator.
    """
    matches = clear.tp - clear.ids
    return max(0.0, 1.0 - clear.fp / matches) if matches else 0.0
