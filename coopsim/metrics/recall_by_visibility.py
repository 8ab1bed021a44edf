"""Recall by who saw an object: what cooperation is for, apart from what an agent could do alone."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from coopsim.metrics.matching import match_sequence
from coopsim.metrics.track_log import FlatLog

SEEN_BY = ("me", "others only", "nobody")
"""Who got LiDAR returns from an object in a frame; `GroundTruth.seen_by` counts into it."""

UNKNOWN = -1
"""Where nothing says who saw an object, as in a replay."""


@dataclass(frozen=True, slots=True)
class GroupRecall:
    """Objects' boxes that the same agents saw.

    Attributes:
        tp: boxes that a track was on, whatever its score.
        gt: boxes.
        all_gt: boxes of all groups together.
    """

    tp: int
    gt: int
    all_gt: int

    @property
    def recall(self) -> float:
        """Per cent of the group's boxes that a track was on; not a number where there are none."""
        return 100 * self.tp / self.gt if self.gt else float("nan")

    @property
    def share(self) -> float:
        """Per cent of all boxes that are in the group; not a number where there are none."""
        return 100 * self.gt / self.all_gt if self.all_gt else float("nan")

    @property
    def gain(self) -> float:
        """What the group adds to the recall of all, in percentage points: share times recall."""
        return 100 * self.tp / self.all_gt if self.all_gt else float("nan")

    def as_dict(self) -> dict[str, float]:
        """By name; without what is not a number."""
        values = {"share": self.share, "recall": self.recall, "gain": self.gain, "TP": self.tp, "GT": self.gt}
        return {name: value for name, value in values.items() if not np.isnan(value)}


def recall_by_visibility(flats: Sequence[FlatLog]) -> dict[str, GroupRecall]:
    """By name in `SEEN_BY`; empty where it is not known who saw what.

    Args:
        flats: with the pairs of one class. Tracks are matched once, to all objects together.
    """
    tp, gt = np.zeros(len(SEEN_BY), dtype=np.int64), np.zeros(len(SEEN_BY), dtype=np.int64)
    for flat in flats:
        sequence = flat.numbered(flat.iou_3d, flat.match_iou)
        active = np.ones(len(sequence.mean_score), dtype=np.bool_)
        hit = match_sequence(sequence.arrays, active, sequence.objects).track_of >= 0
        known = flat.truth_seen_by != UNKNOWN
        gt += np.bincount(flat.truth_seen_by[known], minlength=len(SEEN_BY))
        tp += np.bincount(flat.truth_seen_by[known & hit], minlength=len(SEEN_BY))
    if not gt.any():
        return {}
    return {name: GroupRecall(int(tp[k]), int(gt[k]), int(gt.sum())) for k, name in enumerate(SEEN_BY)}


def pooled(parts: Iterable[Mapping[str, GroupRecall]]) -> dict[str, GroupRecall]:
    """The groups of several agents together."""
    known = [part for part in parts if part]
    return {
        name: GroupRecall(*(sum(getattr(part[name], count) for part in known) for count in ("tp", "gt", "all_gt")))
        for name in (SEEN_BY if known else ())
    }
