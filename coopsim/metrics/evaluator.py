"""Scoring of an agent while it runs: per-frame counts at once, everything else later from the log."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from coopsim.geometry.boxes import Boxes3D
from coopsim.metrics.candidate_pairs import CandidatePairs
from coopsim.metrics.frame_matching import NO_OBJECTS, Objects, match_next_frame
from coopsim.metrics.growing_columns import Spool
from coopsim.metrics.track_log import TrackLog
from coopsim.support.arrays import frozen, sealed
from coopsim.types import GroundTruth, Ints, Mask, Tracks


@dataclass(frozen=True, slots=True)
class FrameCounts:
    """Counts of one frame.

    Attributes:
        tp: matched boxes.
        fp: reported boxes without an object.
        fn: objects without a track.
        idsw: identity switches.
        gt: objects.
    """

    tp: int
    fp: int
    fn: int
    idsw: int
    gt: int

    def as_dict(self) -> dict[str, int]:
        """Return the counts by name."""
        return {"tp": self.tp, "fp": self.fp, "fn": self.fn, "idsw": self.idsw, "gt": self.gt}


class Evaluator:
    """The running evaluation of one agent over one sequence, with CLEAR's matching (see `matching`).

    Args:
        match_iou: 3D IoU from which a track is on an object, in (0, 1].
        spool: a temporary file for long logs, which several evaluators may share; None: one of its own.

    Attributes:
        log: everything that scores need, of all frames so far.
    """

    def __init__(self, match_iou: float = 0.25, spool: Spool | None = None) -> None:
        self.log = TrackLog(match_iou, spool)
        self._memory = NO_OBJECTS

    def update(self, truth: GroundTruth, tracks: Tracks, in_region: Mask | None = None) -> FrameCounts:
        """Score one frame.

        Objects that do not count (`GroundTruth.counts`) are left out, and so are the tracks that are on them rather
        than on one that counts: a tracker that carries on an object which no agent sees any more is neither rewarded
        nor punished for it.

        Args:
            truth: the objects.
            tracks: the reported tracks, in the same frame of reference.
            in_region: (M,) the tracks that the evaluation region holds; None: all. The others are left out.

        Raises:
            InvalidValueError: boxes are not finite or have no size, ids are not unique, or labels are no classes.
        """
        objects = _objects(truth.boxes, truth.id, truth.label, truth.counts)
        if in_region is not None:
            in_region = frozen(in_region, (len(tracks),), np.bool_, "in_region")
        reported = _objects(tracks.boxes, tracks.id, tracks.label, in_region)
        sound, counts, pairs, matches, switches, memory = match_next_frame(
            self._memory, len(self.log), objects, reported, self.log.match_iou
        )
        if not (sound and np.isfinite(tracks.score).all() and np.isfinite(tracks.velocity).all()):
            truth.validate()  # which say what is wrong
            tracks.validate()
        self._memory = memory
        self.log.append(truth, objects[-1], tracks, counts, CandidatePairs(*pairs))
        count, made = int(np.count_nonzero(objects[-1])), int(np.count_nonzero(counts))
        return FrameCounts(matches, made - matches, count - matches, switches, count)


def _objects(boxes: Boxes3D, ids: Ints, label: Ints, counts: Mask | None) -> Objects:
    """Return objects or tracks as the matching takes them; `counts` is read-only if it is given."""
    counts = np.ones(len(ids), np.bool_) if counts is None else np.ascontiguousarray(counts)
    return boxes.array, np.ascontiguousarray(ids), np.ascontiguousarray(label), sealed(counts)
