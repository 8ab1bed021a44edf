"""Association in stages: each matches the tracks and detections that the stages before left over."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from coopsim.geometry.assignment import Assigner, Pairs
from coopsim.support.checks import require_finite_number
from coopsim.tracking.affinity import Affinity
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
        rows, columns = [np.zeros(0, dtype=np.int64)], [np.zeros(0, dtype=np.int64)]
        track_class, detected_class = self._class_of(tracks.label), self._class_of(detections.label)
        free_row, free_column = np.ones(len(tracks), dtype=bool), np.ones(len(detections), dtype=bool)
        for stage in self._stages:
            left = np.flatnonzero(free_row & stage.tracks(tracks))
            right = np.flatnonzero(free_column & stage.detections(detections))
            if not (len(left) and len(right)):
                continue
            affinity = stage.affinity(tracks[left], detections[right])
            affinity = np.where(track_class[left, None] == detected_class[right], affinity, -np.inf)
            row, column = stage.assigner(affinity, stage.gate)
            rows.append(left[row])
            columns.append(right[column])
            free_row[left[row]] = free_column[right[column]] = False
        return np.concatenate(rows), np.concatenate(columns)

    def _class_of(self, label: Ints) -> Ints:
        """Return the labels (N,), or the numbers of their groups."""
        return label if self._class_groups is None else self._class_groups[label]
