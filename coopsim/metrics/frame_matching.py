"""CLEAR's matching of one frame at a time, compiled: what an evaluator does while an episode runs."""

from __future__ import annotations

import numpy as np

from coopsim.geometry.se3 import Floats
from coopsim.metrics.candidate_pairs import CandidatePairs, find_candidate_pairs
from coopsim.metrics.matching import KEEP_BONUS, match_frame
from coopsim.support.kernels import njit
from coopsim.types import Ints, Mask
from coopsim.types.soundness import are_sound
from coopsim.types.taxonomy import CLASS_NAMES, SUPERCLASS_NUMBERS

_CLASSES = len(CLASS_NAMES)
_SUPERCLASS = np.array(SUPERCLASS_NUMBERS)

NO_OBJECTS = np.zeros((0, 3), np.int64)
"""The memory of a sequence before its first frame."""


Objects = tuple[Floats, Ints, Ints, Mask]
"""Objects or tracks of a frame, as contiguous arrays: boxes (N, 7), and read-only ids, classes and whether each counts
(N,). A plain tuple, because numba takes several microseconds to take in or hand out one with names."""

Pairs = tuple[Ints, Ints, Floats, Floats, Floats]
"""`CandidatePairs` as a plain tuple."""


@njit(cache=True, nogil=True)
def match_next_frame(
    memory: Ints, frame: int, truth: Objects, tracks: Objects, least: float
) -> tuple[bool, Mask, Pairs, int, int, Ints]:
    """Match the tracks of a frame, and compare the matches with those of the frames before.

    A track counts if the region holds it, unless it is on an object that does not count rather than on one that does.

    Args:
        memory: (K, 3) of the objects so far, by id: id, track of the last match, frame of the last match (-2: none
            yet). It is written to.
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
        return sound, inside.copy(), (none, none, nothing, nothing, nothing), 0, 0, memory
    pairs = find_candidate_pairs(boxes, _SUPERCLASS[true_label], track_boxes, _SUPERCLASS[all_label])
    counts = inside & _not_on_ignored(pairs, true, true_label, all_label, least)
    pairs = _among(pairs, true, counts)
    flat = (pairs.truth, pairs.track, pairs.iou_3d, pairs.iou_bev, pairs.distance_m)
    truth_id, truth_label = true_id[true], true_label[true]
    track_id, track_label = all_id[counts], all_label[counts]
    if len(track_id) == 0:
        return True, counts, flat, 0, 0, memory
    memory = _with_new_objects(memory, truth_id)
    place = np.searchsorted(memory[:, 0], truth_id)
    weight = np.zeros(len(pairs.iou_3d))
    for p in range(len(weight)):
        row, column = pairs.truth[p], pairs.track[p]
        if truth_label[row] != track_label[column] or pairs.iou_3d[p] < least:
            continue
        _, track, when = memory[place[row]]
        kept = when == frame - 1 and track == track_id[column]
        weight[p] = pairs.iou_3d[p] + KEEP_BONUS if kept else pairs.iou_3d[p]
    chosen = match_frame(len(truth_id), len(track_id), pairs.truth, pairs.track, weight)
    matches = switches = 0
    for row in range(len(truth_id)):
        if chosen[row] < 0:
            continue
        track, before = track_id[pairs.track[chosen[row]]], memory[place[row]]
        matches += 1
        switches += before[2] >= 0 and before[1] != track
        before[1], before[2] = track, frame
    return True, counts, flat, matches, switches, memory


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
    new = np.empty(len(ids), np.int64)
    count = 0
    for number in ids:
        place = np.searchsorted(memory[:, 0], number)
        if place == len(memory) or memory[place, 0] != number:
            new[count] = number
            count += 1
    if count == 0:
        return memory
    grown = np.empty((len(memory) + count, 3), np.int64)
    grown[: len(memory)] = memory
    grown[len(memory) :, 0], grown[len(memory) :, 1], grown[len(memory) :, 2] = new[:count], 0, -2
    return grown[np.argsort(grown[:, 0])]
