"""Association in stages: each works on what the ones before left over."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from coopsim.geometry.assignment import Assigner, Pairs
from coopsim.support.checks import require_finite_number
from coopsim.tracking.affinity.affinity import Affinity
from coopsim.tracking.tracked import Tracked
from coopsim.types import Detections, Ints, Mask

Chooser = Callable[[Any], Mask]
"""Who takes part in a stage: tracks or detections to a mask (N,)."""


def everyone(of: Tracked | Detections) -> Mask:
    """All of them."""
    return np.ones(len(of), dtype=bool)


def nobody(of: Tracked | Detections) -> Mask:
    """None of them."""
    return np.zeros(len(of), dtype=bool)


def missed(tracks: Tracked) -> Mask:
    """Tracks that nothing in this frame has been matched to yet."""
    return tracks.misses > 0


def score_from(threshold: float) -> Chooser:
    """Those with at least this score."""
    return lambda of: of.score >= threshold


def score_below(threshold: float) -> Chooser:
    """Those with less than this score."""
    return lambda of: of.score < threshold


@dataclass(frozen=True, slots=True)
class Stage:
    """One round of matching.

    Attributes:
        affinity: larger is better.
        assigner: picks pairs.
        gate: smallest affinity of a pair.
        tracks: which tracks take part.
        found: which detections take part.
    """

    affinity: Affinity
    assigner: Assigner
    gate: float
    tracks: Chooser = everyone
    found: Chooser = everyone

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

    def match(self, tracks: Tracked, found: Detections) -> Pairs:
        """Return the indices of matched tracks and of their detections, (K,) each."""
        rows, columns = [np.zeros(0, dtype=np.int64)], [np.zeros(0, dtype=np.int64)]
        track_class, found_class = self._class_of(tracks.label), self._class_of(found.label)
        free_row, free_column = np.ones(len(tracks), dtype=bool), np.ones(len(found), dtype=bool)
        for stage in self._stages:
            left = np.flatnonzero(free_row & stage.tracks(tracks))
            right = np.flatnonzero(free_column & stage.found(found))
            if not (len(left) and len(right)):
                continue
            affinity = stage.affinity(tracks[left], found[right])
            affinity = np.where(track_class[left, None] == found_class[right], affinity, -np.inf)
            row, column = stage.assigner(affinity, stage.gate)
            rows.append(left[row])
            columns.append(right[column])
            free_row[left[row]] = free_column[right[column]] = False
        return np.concatenate(rows), np.concatenate(columns)

    def _class_of(self, label: Ints) -> Ints:
        return label if self._class_groups is None else self._class_groups[label]
