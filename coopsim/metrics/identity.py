"""Identity metrics: each object is assigned at most one track for its whole life (Ristani et al., ECCVW 2016)."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from scipy.optimize import linear_sum_assignment
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from coopsim.metrics.cooccurrence import Cooccurrence
from coopsim.metrics.matching import NumberedSequence
from coopsim.types import Ints


@dataclass(frozen=True, slots=True)
class Identity:
    """Counts over any number of sequences.

    Attributes:
        tp: boxes of objects on which the object's assigned track is.
        truth: number of truth boxes.
        reported: number of reported boxes.
    """

    tp: int
    truth: int
    reported: int

    @property
    def precision(self) -> float:
        """IDP = IDTP / (IDTP + IDFP)."""
        return self.tp / max(self.reported, 1)

    @property
    def recall(self) -> float:
        """IDR = IDTP / (IDTP + IDFN)."""
        return self.tp / max(self.truth, 1)

    @property
    def f1(self) -> float:
        """IDF1 = 2 IDTP / (2 IDTP + IDFP + IDFN)."""
        return 2 * self.tp / max(self.truth + self.reported, 1)


def count_identity(sequences: Iterable[NumberedSequence]) -> Identity:
    """Count over sequences, whose pairs are those of a track on an object."""
    tp = truth = reported = 0
    for sequence in sequences:
        truth, reported = truth + len(sequence.arrays.truth), reported + len(sequence.arrays.track)
        tp += _best_assignment(sequence)
    return Identity(tp, truth, reported)


def _best_assignment(sequence: NumberedSequence) -> int:
    """Assign tracks to objects so that the frames they spend together are most. Return the number of these frames."""
    combinations = Cooccurrence.of(sequence)
    together = np.bincount(combinations.of_pair, minlength=len(combinations))
    # Each connected group on its own: a tracker with a new id in every frame makes one huge assignment otherwise.
    shape = (sequence.objects + len(sequence.mean_score),) * 2
    edges = coo_array((together, (combinations.object, sequence.objects + combinations.track)), shape=shape)
    _, group = connected_components(edges, directed=False)
    group = group[combinations.object]
    order = np.argsort(group, kind="stable")
    borders = np.flatnonzero(np.diff(group[order])) + 1
    return sum(
        _largest_sum(combinations.object[part], combinations.track[part], together[part])
        for part in np.split(order, borders)
    )


def _largest_sum(objects: Ints, tracks: Ints, together: Ints) -> int:
    """Solve the assignment of one connected group of C combinations."""
    _, row = np.unique(objects, return_inverse=True)
    _, column = np.unique(tracks, return_inverse=True)
    if not (row.any() and column.any()):  # one object, or one track: it gets the best
        return int(together.max(initial=0))
    gain = coo_array((together, (row, column))).toarray()
    return int(gain[linear_sum_assignment(gain, maximize=True)].sum())
