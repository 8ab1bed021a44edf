"""Scoring of an agent while it runs: counts of each frame at once, everything else later from the log."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from coopsim.geometry.boxes import Boxes3D
from coopsim.geometry.se3 import Floats
from coopsim.metrics.matching import CandidatePairs, SequenceArrays, find_candidate_pairs, match_sequence
from coopsim.metrics.track_log import TrackLog
from coopsim.support.arrays import frozen, sealed
from coopsim.support.kernels import njit
from coopsim.types import GroundTruth, Ints, Mask, Tracks
from coopsim.types.taxonomy import CLASS_NAMES, SUPERCLASS_NUMBERS, are_sound


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

    Attributes:
        log: everything that scores need, of all frames so far.
    """

    def __init__(self, match_iou: float = 0.25) -> None:
        self.log = TrackLog(match_iou)
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
        self.log.append(truth, objects[-1], tracks, counts, pairs)
        count, made = int(np.count_nonzero(objects[-1])), int(np.count_nonzero(counts))
        return FrameCounts(matches, made - matches, count - matches, switches, count)


def _objects(boxes: Boxes3D, ids: Ints, label: Ints, counts: Mask | None) -> Objects:
    """Return objects or tracks as the matching takes them; `counts` is read-only if it is given."""
    counts = np.ones(len(ids), np.bool_) if counts is None else np.ascontiguousarray(counts)
    return boxes.array, np.ascontiguousarray(ids), np.ascontiguousarray(label), sealed(counts)


_CLASSES = len(CLASS_NAMES)
_SUPERCLASS = np.array(SUPERCLASS_NUMBERS)

NO_OBJECTS = np.zeros((0, 4), np.int64)
"""The memory of a sequence before its first frame."""


Objects = tuple[Floats, Ints, Ints, Mask]
"""Objects or tracks of a frame, as contiguous arrays: boxes (N, 7), and read-only ids, classes and whether each counts
(N,). A plain tuple, because numba takes several microseconds to take in or hand out one with names."""


@njit(cache=True, nogil=True)
def match_next_frame(
    memory: Ints, frame: int, truth: Objects, tracks: Objects, least: float
) -> tuple[bool, Mask, CandidatePairs, int, int, Ints]:
    """Match the tracks of a frame, and compare the matches with those of the frames before.

    A track counts if the region holds it, unless it is on an object that does not count rather than on one that does.

    Args:
        memory: (K, 4) of the objects so far, see `match_sequence`, with their ids in the last column, rising.
        frame: the frame's number, from 0.
        truth: the objects.
        tracks: the reported tracks; they count if the region holds them.
        least: 3D IoU from which a track is on an object.

    Returns:
        Whether objects and tracks are valid (if not, nothing was matched); whether each track counts (M,); candidate
        pairs of one superclass, as rows among the objects and tracks that count; the number of objects with a track;
        the number of these with another track than at their last match; the memory of the objects so far.
    """
    boxes, true_id, true_label, true = truth
    track_boxes, all_id, all_label, inside = tracks
    sound = are_sound(boxes, true_id, true_label, _CLASSES) and are_sound(track_boxes, all_id, all_label, _CLASSES)
    if not sound or len(all_id) == 0:
        none, nothing = np.zeros(0, np.int64), np.zeros(0)
        return sound, inside.copy(), CandidatePairs(none, none, nothing, nothing, nothing), 0, 0, memory
    pairs = find_candidate_pairs(boxes, _SUPERCLASS[true_label], track_boxes, _SUPERCLASS[all_label])
    counts = inside & _not_on_ignored(pairs, true, true_label, all_label, least)
    pairs = _among(pairs, true, counts)
    truth_id, truth_label = true_id[true], true_label[true]
    track_id, track_label = all_id[counts], all_label[counts]
    if len(track_id) == 0:
        return True, counts, pairs, 0, 0, memory
    memory = _with_new_objects(memory, truth_id)
    place = np.searchsorted(memory[:, 3], truth_id)
    alike = (truth_label[pairs.truth] == track_label[pairs.track]) & (pairs.iou_3d >= least)
    ends = np.array([[0, len(truth_id)], [0, len(track_id)], [0, np.count_nonzero(alike)]])
    data = SequenceArrays(
        ends[0], place, ends[1], track_id, ends[2], pairs.truth[alike], pairs.track[alike], pairs.iou_3d[alike]
    )
    found = match_sequence(data, np.ones(len(track_id), np.bool_), memory, frame)
    return True, counts, pairs, found.matched.sum(), int(np.count_nonzero(found.switched)), memory


@njit(cache=True, nogil=True)
def _not_on_ignored(pairs: CandidatePairs, counts: Mask, truth_label: Ints, track_label: Ints, least: float) -> Mask:
    """Return the mask (M,) of tracks that are on no object that does not count, or no less on one that does."""
    ignored, counted = np.zeros(len(track_label)), np.zeros(len(track_label))
    for p in range(len(pairs.truth)):
        row, column = pairs.truth[p], pairs.track[p]
        if truth_label[row] != track_label[column]:
            continue
        best = counted if counts[row] else ignored
        best[column] = max(best[column], pairs.iou_3d[p])
    return (ignored < least) | (counted >= ignored)


@njit(cache=True, nogil=True)
def _among(pairs: CandidatePairs, truth: Mask, tracks: Mask) -> CandidatePairs:
    """Return the pairs of masked objects (N,) and tracks (M,), as rows among these."""
    kept = truth[pairs.truth] & tracks[pairs.track]
    rows, columns = np.cumsum(truth) - 1, np.cumsum(tracks) - 1
    return CandidatePairs(
        rows[pairs.truth[kept]],
        columns[pairs.track[kept]],
        pairs.iou_3d[kept],
        pairs.iou_bev[kept],
        pairs.distance_m[kept],
    )


@njit(cache=True, nogil=True)
def _with_new_objects(memory: Ints, ids: Ints) -> Ints:
    """Return the memory with a row for each id; itself, if there is one for all."""
    fresh = np.ones(len(ids), np.bool_)
    for k, place in enumerate(np.searchsorted(memory[:, 3], ids)):
        fresh[k] = place == len(memory) or memory[place, 3] != ids[k]
    if not fresh.any():
        return memory
    grown = np.full((len(memory) + np.count_nonzero(fresh), 4), -2)
    grown[: len(memory)], grown[len(memory) :, 3] = memory, ids[fresh]
    return grown[np.argsort(grown[:, 3])]
