"""Association in stages: each matches the tracks and detections that the stages before left over."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np

from coopsim.geometry import iou
from coopsim.geometry.assignment import Assigner, Pairs, hungarian
from coopsim.geometry.box_matching import Likeness, ScoredBoxes, match_boxes
from coopsim.geometry.se3 import Floats
from coopsim.support.checks import require_finite_number
from coopsim.tracking.affinity import Affinity, BoxAffinity, axial_xiou, half_giou, xiou
from coopsim.tracking.track_states import TrackStates
from coopsim.types import Detections, Ints, Mask

Selector = Callable[[Any], Mask]
"""Selects tracks (`TrackStates`) or detections (`Detections`) that take part in a stage: returns a mask (N,)."""


def everything(of: TrackStates | Detections) -> Mask:
    """Select all."""
    return np.ones(len(of), dtype=bool)


def nothing(of: TrackStates | Detections) -> Mask:
    """Select none."""
    return np.zeros(len(of), dtype=bool)


def missed(tracks: TrackStates) -> Mask:
    """Select tracks that no detection of this frame has been matched to yet."""
    return tracks.misses > 0


def score_from(threshold: float) -> Selector:
    """Return a selector of scores of at least the threshold."""
    return lambda of: of.score >= threshold


def score_below(threshold: float) -> Selector:
    """Return a selector of scores below the threshold."""
    return lambda of: of.score < threshold


@dataclass(frozen=True, slots=True)
class Stage:
    """A stage of matching.

    Attributes:
        affinity: similarity of tracks and detections, larger is better.
        assigner: picks pairs.
        gate: smallest affinity of a pair.
        tracks: selects the tracks that take part.
        detections: selects the detections that take part.
    """

    affinity: Affinity
    assigner: Assigner
    gate: float
    tracks: Selector = everything
    detections: Selector = everything

    def __post_init__(self) -> None:
        require_finite_number(gate=self.gate)

    @property
    def takes_all(self) -> bool:
        """True if all tracks and detections take part."""
        return self.tracks is everything and self.detections is everything

    def pairs(self, affinity: Floats, classes: Pairs) -> Pairs:
        """Return the pairs (K,), (K,) of an affinity (N, M) of tracks and detections, of classes (N,) and (M,)."""
        return self.assigner(np.where(classes[0][:, None] == classes[1], affinity, -np.inf), self.gate)


class Cascade:
    """Association of tracks and detections of the same class, in stages.

    Args:
        stages: tried in order.
        class_groups: a number for each label; labels of one number may match. None: only a class with itself.
    """

    def __init__(self, stages: Sequence[Stage], class_groups: Sequence[int] | None = None) -> None:
        self._stages = tuple(stages)
        self._class_groups = None if class_groups is None else np.array(class_groups, dtype=np.int64)

    def match(self, tracks: TrackStates, detections: Detections) -> Pairs:
        """Return the indices of matched tracks and of their detections, (K,) each."""
        if not (len(tracks) and len(detections)):
            return np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64)
        classes = self._class_of(tracks.label), self._class_of(detections.label)
        if self.by_giou:
            return self._best_giou(tracks, detections, classes)
        if len(self._stages) == 1 and self._stages[0].takes_all:
            return self._stages[0].pairs(self._stages[0].affinity(tracks, detections), classes)
        rows, columns = [np.zeros(0, dtype=np.int64)], [np.zeros(0, dtype=np.int64)]
        known: dict[BoxAffinity, Floats] = {}  # of boxes: pair by pair, so once for all stages
        free_row, free_column = np.ones(len(tracks), dtype=np.bool_), np.ones(len(detections), dtype=np.bool_)
        for stage in self._stages:
            left = np.flatnonzero(free_row & stage.tracks(tracks))
            right = np.flatnonzero(free_column & stage.detections(detections))
            if not (len(left) and len(right)):
                continue
            if isinstance(stage.affinity, BoxAffinity):
                if stage.affinity not in known:
                    known[stage.affinity] = stage.affinity(tracks, detections)
                affinity = known[stage.affinity][np.ix_(left, right)]
            else:
                affinity = stage.affinity(tracks[left], detections[right])
            row, column = stage.pairs(affinity, (classes[0][left], classes[1][right]))
            rows.append(left[row])
            columns.append(right[column])
            free_row[left[row]] = free_column[right[column]] = False
        return np.concatenate(rows), np.concatenate(columns)

    @property
    def by_giou(self) -> bool:
        """True if all is matched in one stage, for the largest sum of GIoU."""
        first, *others = self._stages
        return not others and first.takes_all and first.assigner is hungarian and _likeness(first.affinity) is not None

    def match_within(self, tracks: TrackStates, detections: Detections, parts: Pairs) -> Pairs:
        """Match as `match` does, but only tracks and detections of the same part; `by_giou` must be true.

        The numbers of the parts are given for tracks (N,) and detections (M,).
        """
        classes = self._class_of(tracks.label), self._class_of(detections.label)
        return self._best_giou(tracks, detections, (classes[0] + _parted(parts[0]), classes[1] + _parted(parts[1])))

    def _best_giou(self, tracks: TrackStates, detections: Detections, classes: Pairs) -> Pairs:
        """Match in the one stage that there is, without the affinities of all pairs."""
        (stage,) = self._stages
        likeness = _likeness(stage.affinity)
        assert likeness is not None
        ours = ScoredBoxes(np.ascontiguousarray(tracks.boxes), tracks.latest.copy(), classes[0])
        row_of, value = match_boxes(
            ours, ScoredBoxes(detections.boxes.array, detections.score.copy(), classes[1]), likeness
        )
        columns = np.flatnonzero(value >= stage.gate)
        columns = columns[np.argsort(row_of[columns])]
        return row_of[columns], columns

    def _class_of(self, label: Ints) -> Ints:
        """Return the labels (N,), or the numbers of their groups; a new array."""
        return label.copy() if self._class_groups is None else self._class_groups[label]


def _likeness(affinity: Affinity) -> Likeness | None:
    """Return an affinity as `match_boxes` takes it; None: it is none by GIoU."""
    if not isinstance(affinity, BoxAffinity) or affinity.kernel not in (iou.giou_3d, iou.giou_bev):
        return None
    return (
        Likeness(affinity.kernel is iou.giou_3d, float(affinity.score_weight)) if affinity.score_weight >= 0 else None
    )


def _parted(part: Ints) -> Ints:
    """Return what sets the classes of each part (N,) apart from those of all others."""
    return part << 32


AFFINITIES: dict[str, Affinity] = {"xiou": xiou, "axial_xiou": axial_xiou, "giou": half_giou}
"""By what boxes are matched: XIOU, XIOU for detectors that confuse front and back, and (GIoU + 1) / 2."""


def four_stages(affinity: Affinity, gate: float, track_score: float, detection_score: float) -> Cascade:
    """Return four-stage cascade matching, FSCM (Hu, Wang and Wang, eq. 24-27).

    Sure tracks are matched with sure detections, then with doubtful ones, then doubtful tracks with either; sure ones
    have a score of at least `track_score` (m_t) and `detection_score` (m_d).
    """
    sides = product(
        (score_from(track_score), score_below(track_score)), (score_from(detection_score), score_below(detection_score))
    )
    return Cascade([Stage(affinity, hungarian, gate, tracks, found) for tracks, found in sides])
