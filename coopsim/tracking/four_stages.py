"""Four-stage cascade matching, FSCM (Hu, Wang and Wang, eq. 24-27)."""

from __future__ import annotations

from itertools import product

from coopsim.geometry.assignment import hungarian
from coopsim.tracking.affinity import Affinity, axial_xiou, half_giou, xiou
from coopsim.tracking.cascade import Cascade, Stage, score_below, score_from

AFFINITIES: dict[str, Affinity] = {"xiou": xiou, "axial_xiou": axial_xiou, "giou": half_giou}
"""By what boxes are matched: XIOU, XIOU for detectors that confuse front and back, and (GIoU + 1) / 2."""


def four_stages(affinity: Affinity, gate: float, track_score: float, detection_score: float) -> Cascade:
    """Return the cascade: sure tracks with sure detections, with doubtful ones, then doubtful tracks with either.

    Args:
        affinity: of tracks and detections.
        gate: smallest affinity of a pair.
        track_score: score from which a track is sure (m_t).
        detection_score: score from which a detection is sure (m_d).
    """
    sides = product(
        (score_from(track_score), score_below(track_score)), (score_from(detection_score), score_below(detection_score))
    )
    return Cascade([Stage(affinity, hungarian, gate, tracks, found) for tracks, found in sides])
