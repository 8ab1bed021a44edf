"""Association in stages: each matches the tracks and detections that the stages before left over."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from coopsim.geometry.assignment import Assigner, Pairs, hungarian
from coopsim.support.checks import require_finite_number
from coopsim.tracking.affinity import Affinity, RowAffinity
from coopsim.tracking.certain_pairs import hungarian_by_rows, of_one_class
from coopsim.tracking.tracked import Tracked
from coopsim.types import Detections, Ints, Mask

Selector = Callable[[Any], Mask]
"""Selects tracks (`Tracked`) or detections (`Detections`) that take part in a stage: returns a mask (N,)."""


def everything(of: Tracked | Detections) -> Mask:
    """Select all."""
    return np.ones(len(of), dtype=bool)


def nothing(of: Tracked | Detections) -> Mask:
    """Select none."""
    return np.zeros(len(of), dtype=bool)


def missed(tracks: Tracked) -> Mask:
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
    """One stage of matching.

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


class Cascade:
    """Association of tracks and detections of the same class, in stages.

    Args:
        stages: tried in order.
        class_groups: a number for each label; labels of one number may match. None: only a class with itself.
    """

    def __init__(self, stages: Sequence[Stage], class_groups: Sequence[int] | None = None) -> None:
        self._stages = tuple(stages)
        self._class_groups = None if class_groups is None else np.array(class_groups, dtype=np.int64)

    def match(self, tracks: Tracked, detections: Detections) -> Pairs:
        """Return the indices of matched tracks and of their detections, (K,) each."""
        none = np.zeros(0, dtype=np.int64)
        rows, columns = [none], [none]
        classes = self._class_of(tracks.label), self._class_of(detections.label)
        free_row, free_column = np.ones(len(tracks), dtype=np.bool_), np.ones(len(detections), dtype=np.bool_)
        for stage in self._stages:
            left, right = (
                _taking_part(free_row, stage.tracks, tracks),
                _taking_part(free_column, stage.detections, detections),
            )
            if not (len(left) and len(right)):
                continue
            row, column = _pairs(stage, tracks, detections, (left, right), classes)
            rows.append(left[row])
            columns.append(right[column])
            free_row[left[row]] = free_column[right[column]] = False
        return np.concatenate(rows), np.concatenate(columns)

    def _class_of(self, label: Ints) -> Ints:
        """Return the labels (N,), or the numbers of their groups; a new array."""
        return label.copy() if self._class_groups is None else self._class_groups[label]


def _taking_part(free: Mask, selector: Selector, of: Tracked | Detections) -> Ints:
    """Return which tracks or detections take part in a stage, (K,)."""
    return np.flatnonzero(free if selector is everything else free & selector(of))


def _pairs(stage: Stage, tracks: Tracked, detections: Detections, taking_part: Pairs, classes: Pairs) -> Pairs:
    """Return the pairs of one stage, as numbers of the tracks (K,) and detections (L,) that take part."""
    left, right = taking_part
    first, second = classes[0][left], classes[1][right]
    affinity = stage.affinity
    if not isinstance(affinity, RowAffinity):
        whole = len(left) == len(tracks), len(right) == len(detections)
        compared = affinity(tracks if whole[0] else tracks[left], detections if whole[1] else detections[right])
        return stage.assigner(of_one_class(compared, first, second), stage.gate)
    own, other = affinity.of_tracks(tracks)[left], affinity.of_detections(detections)[right]
    if stage.assigner is hungarian:
        return hungarian_by_rows(affinity, own, other, (first, second), stage.gate)
    return stage.assigner(of_one_class(affinity.kernel(own, other), first, second), stage.gate)
