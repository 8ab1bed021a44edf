"""Association in stages: each works on what the ones before left over."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from coopsim.errors import InvalidValueError
from coopsim.geometry.se3 import Floats
from coopsim.tracking.affinity import Affinity
from coopsim.tracking.assignment import Assigner, Pairs
from coopsim.types import Ints


@dataclass(frozen=True, slots=True)
class Stage:
    """One round of matching.

    Attributes:
        affinity: of boxes, larger is better.
        assigner: picks pairs.
        gate: smallest affinity of a pair.
    """

    affinity: Affinity
    assigner: Assigner
    gate: float

    def __post_init__(self) -> None:
        if not np.isfinite(self.gate):
            raise InvalidValueError(f"gate must be a finite number, got {self.gate!r}")


class Cascade:
    """Matches tracks to detections, class by class, in stages.

    Args:
        stages: tried in order.
    """

    def __init__(self, stages: Sequence[Stage]) -> None:
        self._stages = tuple(stages)

    def match(self, tracks: Floats, track_label: Ints, found: Floats, found_label: Ints) -> Pairs:
        """Indices of matched tracks and of their detections, (K,) each.

        Args:
            tracks: boxes (N, 7).
            track_label: (N,).
            found: boxes (M, 7), in the same frame.
            found_label: (M,).
        """
        rows, columns = [], []
        left, right = np.arange(len(tracks)), np.arange(len(found))
        for stage in self._stages:
            if not (len(left) and len(right)):
                break
            affinity = stage.affinity(tracks[left], found[right])
            affinity[track_label[left, None] != found_label[right]] = -np.inf
            row, column = stage.assigner(affinity, stage.gate)
            rows.append(left[row])
            columns.append(right[column])
            left, right = np.delete(left, row), np.delete(right, column)
        if not rows:
            return np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64)
        return np.concatenate(rows), np.concatenate(columns)
