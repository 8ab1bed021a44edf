"""CLEAR's matching of objects and tracks over a whole sequence, compiled; all metrics share it.

In each frame truth and tracks are matched one to one so that the sum of similarities is largest; a pair that was
matched in the frame before is kept as long as it stays above the threshold (Bernardin and Stiefelhagen 2008).
TrackEval's CLEAR does the same, with a bonus of 1000 for kept pairs, which is used here too.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from coopsim.geometry.assignment import match_pairs
from coopsim.geometry.iou import overlaps
from coopsim.geometry.se3 import Floats
from coopsim.support.kernels import njit
from coopsim.types import Ints, Mask

KEEP_BONUS = 1000.0


def frame_of(start: Ints) -> Ints:
    """Return the frame (N,) of each row, for frames that begin at the rows `start` (F + 1,)."""
    return np.repeat(np.arange(len(start) - 1), np.diff(start))


class SequenceArrays(NamedTuple):
    """A sequence as flat arrays. Row r of frame f is at `start[f] + r`; ids are numbered from 0 per sequence.

    Attributes:
        truth_start: (F + 1,) offsets into `truth`.
        truth: (G,) number of each truth box's object.
        track_start: (F + 1,) offsets into `track`.
        track: (T,) number of each reported box's track.
        pair_start: (F + 1,) offsets into the pairs.
        pair_truth: (P,) row in the frame.
        pair_track: (P,) row in the frame.
        pair_similarity: (P,) of all pairs at or above the threshold.
    """

    truth_start: Ints
    truth: Ints
    track_start: Ints
    track: Ints
    pair_start: Ints
    pair_truth: Ints
    pair_track: Ints
    pair_similarity: Floats


@dataclass(frozen=True, slots=True, eq=False)
class NumberedSequence:
    """A sequence ready for matching.

    Attributes:
        arrays: the flat arrays.
        objects: number of objects.
        mean_score: (tracks,) mean score of each track over the sequence.
    """

    arrays: SequenceArrays
    objects: int
    mean_score: Floats

    def match(self, active: Mask | None = None) -> SequenceMatches:
        """Match the sequence with its active tracks (tracks,) only; None: with all."""
        track = self.arrays.track
        taking_part = np.ones(len(track), np.bool_) if active is None else active[track]
        memory = np.full((self.objects, 4), -2)
        matches: SequenceMatches = match_sequence(self.arrays, taking_part, memory, 0)
        return matches


class SequenceMatches(NamedTuple):
    """The matches of one sequence.

    Attributes:
        track_of: (G,) number of the track matched to each truth box, or -1.
        similarity: (G,) of the matched pairs, 0 elsewhere.
        switched: (G,) mask of identity switches: matched to another track than at the object's last match.
        adjacent_switches: number of switches between two successive frames of an object, without a gap.
        false_positives: reported boxes without a truth box.
        present: (objects,) frames in which each object is present.
        matched: (objects,) frames in which it is matched.
        fragments: (objects,) runs of consecutive matched frames.
    """

    track_of: Ints
    similarity: Floats
    switched: NDArray[np.bool_]
    adjacent_switches: int
    false_positives: int
    present: Ints
    matched: Ints
    fragments: Ints


@njit(cache=True, nogil=True)
def match_sequence(data: SequenceArrays, active: Mask, memory: Ints, first: int) -> SequenceMatches:
    """Match a sequence, or its next frames.

    Args:
        data: the frames.
        active: (T,) mask of the reported boxes that take part.
        memory: (objects, 4) of each object: number of the last matched track, frame of that match, last frame with the
            object, -2 for none; the last column is the caller's. It is written to.
        first: number of the first frame.
    """
    track_of, similarity = np.full(len(data.truth), -1), np.zeros(len(data.truth))
    switched = np.zeros(len(data.truth), np.bool_)
    present, matched, fragments = np.zeros((3, len(memory)), np.int64)
    adjacent_switches = false_positives = 0
    for number in range(len(data.truth_start) - 1):
        frame, start, start_track = first + number, data.truth_start[number], data.track_start[number]
        pairs = slice(data.pair_start[number], data.pair_start[number + 1])
        rows, columns, value = data.pair_truth[pairs], data.pair_track[pairs], data.pair_similarity[pairs]
        weight = value.copy()
        for p in range(len(weight)):
            before, column = memory[data.truth[start + rows[p]]], start_track + columns[p]
            if not active[column]:
                weight[p] = 0.0
            elif before[1] == frame - 1 and before[0] == data.track[column]:
                weight[p] += KEEP_BONUS
        end, end_track = data.truth_start[number + 1], data.track_start[number + 1]
        chosen = match_pairs(end - start, end_track - start_track, rows, columns, weight)
        false_positives += int(np.count_nonzero(active[start_track:end_track]) - np.count_nonzero(chosen >= 0))
        for row in range(start, end):
            object_, before, pair = data.truth[row], memory[data.truth[row]], chosen[row - start]
            present[object_] += 1
            if pair >= 0:
                track = data.track[start_track + columns[pair]]
                track_of[row], similarity[row] = track, value[pair]
                matched[object_] += 1
                if before[1] >= 0 and before[0] != track:
                    switched[row] = True
                    adjacent_switches += before[1] == before[2]
                fragments[object_] += before[1] != frame - 1
                before[0], before[1] = track, frame
            before[2] = frame
    return SequenceMatches(
        track_of, similarity, switched, adjacent_switches, false_positives, present, matched, fragments
    )


NEAR_M = 2.0
"""Distance of centres on the ground below which a track may be on an object: nuScenes' (Caesar et al. 2020)."""


class CandidatePairs(NamedTuple):
    """Pairs of one kind that overlap in the bird's-eye view (BEV), or whose centres are less than 2 m apart.

    Attributes:
        truth: (P,) rows of the truth.
        track: (P,) rows of the tracks.
        iou_3d: (P,) in [0, 1].
        iou_bev: (P,) in [0, 1].
        distance_m: (P,) between the centres, on the ground.
    """

    truth: Ints
    track: Ints
    iou_3d: Floats
    iou_bev: Floats
    distance_m: Floats


# All arrays are contiguous: one layout, compiled once.
@njit(cache=True, nogil=True)
def find_candidate_pairs(truth: Floats, truth_kind: Ints, tracks: Floats, track_kind: Ints) -> CandidatePairs:
    """Find the pairs of a frame, of boxes (N, 7) and (M, 7) of equal kind: class or superclass (N,) and (M,)."""
    iou_3d, iou_bev = overlaps(truth, tracks, False)
    rows, columns = np.empty(iou_3d.size, np.int64), np.empty(iou_3d.size, np.int64)
    found_3d, found_bev, distance_m = np.empty(iou_3d.size), np.empty(iou_3d.size), np.empty(iou_3d.size)
    found = 0
    for i in range(len(truth)):
        for j in range(len(tracks)):
            dx, dy = truth[i, 0] - tracks[j, 0], truth[i, 1] - tracks[j, 1]
            if truth_kind[i] != track_kind[j] or (dx * dx + dy * dy >= NEAR_M * NEAR_M and iou_bev[i, j] <= 0):
                continue
            rows[found], columns[found] = i, j
            found_3d[found], found_bev[found], distance_m[found] = iou_3d[i, j], iou_bev[i, j], np.hypot(dx, dy)
            found += 1
    return CandidatePairs(rows[:found], columns[:found], found_3d[:found], found_bev[:found], distance_m[:found])
