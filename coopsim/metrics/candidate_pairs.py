"""Pairs of an object and a track that some metric could match, found once per frame for all metrics."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from coopsim.geometry.iou import corner_room, overlaps_of_pair
from coopsim.geometry.se3 import Floats
from coopsim.support.kernels import njit
from coopsim.types import Ints

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
