"""Ids that last while a tracker tracks the same moments again, and counts its new tracks anew."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from coopsim.geometry.assignment import hungarian
from coopsim.geometry.box_similarity import center_distance_bev
from coopsim.types import NS_PER_S, Ints, Tracks

_SAME_M = 2.0
"""Greatest distance over ground of two tracks of one object at one moment."""

_MEMORY_NS = 60 * NS_PER_S


class LastingIds:
    """The id that each track was first reported under, which count from 1 and are never used twice."""

    def __init__(self) -> None:
        self._next = 1
        self._ids: dict[int, tuple[int, int]] = {}  # by the tracker's id: the reported one, and when last
        self._reported = Tracks.empty()

    def forget(self, ids: Iterable[int]) -> None:
        """Forget tracks, by the tracker's ids, that it may now give to other objects."""
        for each in ids:
            self._ids.pop(each, None)

    def carry_over(self, again: Tracks, time_ns: int) -> None:
        """Give tracks that are new to their tracker the ids of the same objects in the last report.

        Args:
            again: what the tracker, having tracked again, says of the last report's moment.
            time_ns: of that moment.
        """
        new = again[np.array([each not in self._ids for each in again.id.tolist()], dtype=np.bool_)]
        kept = [reported for reported, _ in self._ids.values()]
        lost = self._reported[~np.isin(self._reported.id, kept)]
        near = center_distance_bev(lost.boxes.array, new.boxes.array)
        alike = np.where(np.equal.outer(lost.label, new.label), near, -np.inf)
        for row, column in zip(*hungarian(alike, -_SAME_M), strict=True):
            self._ids[int(new.id[column])] = int(lost.id[row]), time_ns

    def name(self, tracks: Tracks, time_ns: int) -> Tracks:
        """Return tracks under their lasting ids."""
        self._ids = {each: known for each, known in self._ids.items() if known[1] >= time_ns - _MEMORY_NS}
        self._reported = replace(tracks, id=self._named(tracks.id, time_ns))
        return self._reported

    def _named(self, ids: Ints, time_ns: int) -> Ints:
        for each in ids.tolist():
            known = self._ids.get(each)
            self._ids[each] = (self._next if known is None else known[0]), time_ns
            self._next += known is None
        return np.array([self._ids[each][0] for each in ids.tolist()], dtype=np.int64)
