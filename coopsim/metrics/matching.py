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

from coopsim.geometry.iou import corner_room, overlaps_of_pair
from coopsim.geometry.se3 import Floats
from coopsim.support.kernels import njit
from coopsim.types import Ints

KEEP_BONUS = 1000.0


def frame_of(start: Ints) -> Ints:
    """Return the frame (N,) of each row, for frames that begin at the rows `start` (F + 1,)."""
    return np.repeat(np.arange(len(start) - 1), np.diff(start))


class SequenceArrays(NamedTuple):
    """One sequence as flat arrays. Row r of frame f is at `start[f] + r`; ids are numbered from 0 per sequence.

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


class SequenceMatches(NamedTuple):
    """The matches of one sequence.

    Attributes:
        track_of: (G,) number of the track matched to each truth box, or -1.
        similarity: (G,) of the matched pairs, 0 elsewhere.
        switched: (G,) whether the box is an identity switch: matched to another track than at the object's last match.
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
def match_sequence(data: SequenceArrays, active: NDArray[np.bool_], objects: int) -> SequenceMatches:
    """Match a sequence with its active tracks only; `active` (tracks,) is a mask."""
    track_of = np.full(len(data.truth), -1)
    similarity = np.zeros(len(data.truth))
    switched = np.zeros(len(data.truth), np.bool_)
    last_track, last_frame, last_seen = np.full(objects, -1), np.full(objects, -2), np.full(objects, -2)
    present, matched, fragments = (
        np.zeros(objects, np.int64),
        np.zeros(objects, np.int64),
        np.zeros(objects, np.int64),
    )
    adjacent_switches = false_positives = 0
    for frame in range(len(data.truth_start) - 1):
        truth = data.truth[data.truth_start[frame] : data.truth_start[frame + 1]]
        track = data.track[data.track_start[frame] : data.track_start[frame + 1]]
        first, end = data.pair_start[frame], data.pair_start[frame + 1]
        weight = data.pair_similarity[first:end].copy()
        rows, columns = data.pair_truth[first:end], data.pair_track[first:end]
        for p in range(len(weight)):
            object_, number = truth[rows[p]], track[columns[p]]
            if not active[number]:
                weight[p] = 0.0
            elif last_frame[object_] == frame - 1 and last_track[object_] == number:
                weight[p] += KEEP_BONUS
        chosen = match_frame(len(truth), len(track), rows, columns, weight)
        hits = 0
        for row in range(len(truth)):
            object_ = truth[row]
            present[object_] += 1
            if chosen[row] < 0:
                continue
            number = track[columns[chosen[row]]]
            hits += 1
            matched[object_] += 1
            if last_track[object_] >= 0 and last_track[object_] != number:
                switched[data.truth_start[frame] + row] = True
                adjacent_switches += last_frame[object_] == last_seen[object_]
            fragments[object_] += last_frame[object_] != frame - 1
            last_track[object_], last_frame[object_] = number, frame
            track_of[data.truth_start[frame] + row] = number
            similarity[data.truth_start[frame] + row] = data.pair_similarity[first + chosen[row]]
        for row in range(len(truth)):
            last_seen[truth[row]] = frame
        for column in range(len(track)):
            false_positives += active[track[column]]
        false_positives -= hits
    return SequenceMatches(
        track_of, similarity, switched, adjacent_switches, false_positives, present, matched, fragments
    )


@njit(cache=True, nogil=True)
def match_frame(rows: int, columns: int, pair_row: Ints, pair_column: Ints, weight: Floats) -> Ints:
    """Match rows and columns one to one for the largest sum of weights.

    Args:
        rows: number of rows.
        columns: number of columns.
        pair_row: (P,) row of each candidate pair; pairs are distinct.
        pair_column: (P,) its column.
        weight: (P,) > 0; pairs with weight 0 are no candidates.

    Returns:
        (rows,) index of the chosen pair, or -1.
    """
    chosen = np.full(rows, -1)
    row_degree, column_degree = np.zeros(rows, np.int64), np.zeros(columns, np.int64)
    for p in range(len(weight)):
        if weight[p] > 0:
            row_degree[pair_row[p]] += 1
            column_degree[pair_column[p]] += 1
    # Most objects have a single candidate that has no other object: only the rest needs an optimisation.
    row_slot, column_slot = np.full(rows, -1), np.full(columns, -1)
    hard_rows, hard_columns = 0, 0
    for p in range(len(weight)):
        row, column = pair_row[p], pair_column[p]
        if weight[p] <= 0:
            continue
        if row_degree[row] == 1 and column_degree[column] == 1:
            chosen[row] = p
            continue
        if row_slot[row] < 0:
            row_slot[row] = hard_rows
            hard_rows += 1
        if column_slot[column] < 0:
            column_slot[column] = hard_columns
            hard_columns += 1
    if hard_rows == 0:
        return chosen
    dense = np.zeros((hard_rows, max(hard_rows, hard_columns)))
    pair_at = np.full(dense.shape, -1)
    for p in range(len(weight)):
        row, column = row_slot[pair_row[p]], column_slot[pair_column[p]]
        if weight[p] > 0 and row >= 0 and column >= 0:
            dense[row, column] = -weight[p]
            pair_at[row, column] = p
    assigned = cheapest_assignment(dense)
    for row in range(rows):
        if row_slot[row] >= 0:
            chosen[row] = pair_at[row_slot[row], assigned[row_slot[row]]]
    return chosen


@njit(cache=True, nogil=True)
def cheapest_assignment(cost: Floats) -> Ints:
    """Return the column (n,) of each row in the assignment of least total cost (n, m), n <= m.

    Shortest augmenting paths with potentials (Jonker and Volgenant 1987), compiled so that it can be called once per
    frame and recall point without the overhead of a call from Python.
    """
    rows, columns = cost.shape
    u, v = np.zeros(rows + 1), np.zeros(columns + 1)
    row_of, way = np.zeros(columns + 1, np.int64), np.zeros(columns + 1, np.int64)
    for row in range(1, rows + 1):
        row_of[0] = row
        column = 0
        shortest, done = np.full(columns + 1, np.inf), np.zeros(columns + 1, np.bool_)
        while row_of[column] != 0:
            done[column] = True
            here, step, following = row_of[column], np.inf, 0
            for j in range(1, columns + 1):
                if done[j]:
                    continue
                reduced = cost[here - 1, j - 1] - u[here] - v[j]
                if reduced < shortest[j]:
                    shortest[j], way[j] = reduced, column
                if shortest[j] < step:
                    step, following = shortest[j], j
            for j in range(columns + 1):
                if done[j]:
                    u[row_of[j]] += step
                    v[j] -= step
                else:
                    shortest[j] -= step
            column = following
        while column != 0:
            row_of[column] = row_of[way[column]]
            column = way[column]
    assigned = np.full(rows, -1)
    for j in range(1, columns + 1):
        if row_of[j] > 0:
            assigned[row_of[j] - 1] = j - 1
    return assigned


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
    """Find the pairs of a frame.

    Args:
        truth: (N, 7) boxes of the objects.
        truth_kind: (N,) their classes or superclasses; only pairs of equal kind are returned.
        tracks: (M, 7) boxes of the tracks.
        track_kind: (M,) their classes or superclasses.
    """
    reach, track_reach = np.hypot(truth[:, 3], truth[:, 4]) / 2, np.hypot(tracks[:, 3], tracks[:, 4]) / 2
    cos, sin, track_cos, track_sin = (
        np.cos(truth[:, 6]),
        np.sin(truth[:, 6]),
        np.cos(tracks[:, 6]),
        np.sin(tracks[:, 6]),
    )
    room = corner_room()
    most = len(truth) * len(tracks)
    rows, columns = np.empty(most, np.int64), np.empty(most, np.int64)
    found_3d, found_bev, distance_m = np.empty(most), np.empty(most), np.empty(most)
    found = 0
    for i in range(len(truth)):
        for j in range(len(tracks)):
            dx, dy = truth[i, 0] - tracks[j, 0], truth[i, 1] - tracks[j, 1]
            square, both = dx * dx + dy * dy, reach[i] + track_reach[j]
            near, touching = square < NEAR_M * NEAR_M, square < both * both
            if truth_kind[i] != track_kind[j] or not (near or touching):
                continue
            iou_3d = iou_bev = 0.0
            if touching:
                angles = (cos[i], sin[i], track_cos[j], track_sin[j])
                iou_3d, iou_bev = overlaps_of_pair(truth[i], tracks[j], angles, room)
            if not near and iou_bev <= 0:
                continue
            rows[found], columns[found] = i, j
            found_3d[found], found_bev[found], distance_m[found] = iou_3d, iou_bev, np.hypot(dx, dy)
            found += 1
    return CandidatePairs(rows[:found], columns[:found], found_3d[:found], found_bev[:found], distance_m[:found])
