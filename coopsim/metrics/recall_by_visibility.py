"""Recall by which agents saw an object: separates the gain of cooperation from what an agent could do alone."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from coopsim.metrics.track_log import FlatLog

SEEN_BY = ("me", "others only", "nobody")
"""Which agents got LiDAR returns from an object in a frame; `GroundTruth.visible_to` holds indices into it."""

UNKNOWN = -1
"""Stands where it is not known which agents saw an object, as in a replay."""


@dataclass(frozen=True, slots=True)
class GroupRecall:
    """Recall of the objects' boxes that the same agents saw.

    Attributes:
        tp: boxes with a matched track, whatever its score.
        gt: boxes.
        all_gt: boxes of all groups together.
    """

    tp: int
    gt: int
    all_gt: int

    @property
    def recall(self) -> float:
        """Per cent of the group's boxes with a matched track; NaN without boxes."""
        return 100 * self.tp / self.gt if self.gt else float("nan")

    @property
    def share(self) -> float:
        """Per cent of all boxes that are in the group; NaN without boxes."""
        return 100 * self.gt / self.all_gt if self.all_gt else float("nan")

    @property
    def gain(self) -> float:
        """Percentage points that the group adds to the recall of all boxes: share times recall."""
        return 100 * self.tp / self.all_gt if self.all_gt else float("nan")

    def as_dict(self) -> dict[str, float]:
        """Return the values by name, without those that are NaN."""
        values = {"share": self.share, "recall": self.recall, "gain": self.gain, "TP": self.tp, "GT": self.gt}
        return {name: value for name, value in values.items() if not np.isnan(value)}


def recall_by_visibility(logs: Sequence[FlatLog]) -> dict[str, GroupRecall]:
    """Compute the recall of each group in `SEEN_BY`; empty where it is not known which agents saw what.

    Args:
        logs: with the pairs of one class. Tracks are matched once, to all objects together.
    """
    tp, gt = np.zeros(len(SEEN_BY), dtype=np.int64), np.zeros(len(SEEN_BY), dtype=np.int64)
    for log in logs:
        hit = log.matches.track_of >= 0
        known = log.truth_seen_by != UNKNOWN
        gt += np.bincount(log.truth_seen_by[known], minlength=len(SEEN_BY))
        tp += np.bincount(log.truth_seen_by[known & hit], minlength=len(SEEN_BY))
    if not gt.any():
        return {}
    return {name: GroupRecall(int(tp[k]), int(gt[k]), int(gt.sum())) for k, name in enumerate(SEEN_BY)}


def pooled(parts: Iterable[Mapping[str, GroupRecall]]) -> dict[str, GroupRecall]:
    """Add up the groups of several agents."""
    known = [part for part in parts if part]
    return {
        name: GroupRecall(*(sum(getattr(part[name], count) for part in known) for count in ("tp", "gt", "all_gt")))
        for name in (SEEN_BY if known else ())
    }
