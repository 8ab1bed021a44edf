"""Pairs of an object and a track that some metric could match, found once per frame for all metrics."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from coopsim.geometry.boxes import Boxes3D
from coopsim.geometry.iou import iou_3d_and_bev
from coopsim.geometry.se3 import Floats
from coopsim.types import Ints

NEAR_M = 2.0
"""Distance of centres on the ground below which a track may be on an object: nuScenes' (Caesar et al. 2020)."""


@dataclass(frozen=True, slots=True, eq=False)
class CandidatePairs:
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

    @classmethod
    def empty(cls) -> CandidatePairs:
        """Return no pairs."""
        rows, values = np.zeros(0, dtype=np.int64), np.zeros(0)
        return cls(rows, rows, values, values, values)

    def __len__(self) -> int:
        return len(self.truth)

    def __getitem__(self, index: NDArray[np.bool_]) -> CandidatePairs:
        return CandidatePairs(
            self.truth[index], self.track[index], self.iou_3d[index], self.iou_bev[index], self.distance_m[index]
        )


def find_candidate_pairs(truth: Boxes3D, truth_kind: Ints, tracks: Boxes3D, track_kind: Ints) -> CandidatePairs:
    """Find the pairs of a frame.

    Args:
        truth: N objects.
        truth_kind: (N,) their classes or superclasses; only pairs of equal kind are returned.
        tracks: M tracks.
        track_kind: (M,) their classes or superclasses.
    """
    rows, columns = truth.array, tracks.array
    same_kind = truth_kind[:, None] == track_kind
    return CandidatePairs(*_select(same_kind, *iou_3d_and_bev(rows, columns), rows, columns))


# All arrays are fresh, so writeable and contiguous: one layout, compiled once.
@njit(cache=True, nogil=True)
def _select(
    same_kind: NDArray[np.bool_], iou_3d: Floats, iou_bev: Floats, truth: Floats, tracks: Floats
) -> tuple[Ints, Ints, Floats, Floats, Floats]:
    most = same_kind.size
    rows, columns = np.empty(most, np.int64), np.empty(most, np.int64)
    found_3d, found_bev, distance_m = np.empty(most), np.empty(most), np.empty(most)
    found = 0
    for i in range(len(truth)):
        for j in range(len(tracks)):
            if not same_kind[i, j]:
                continue
            dx, dy = truth[i, 0] - tracks[j, 0], truth[i, 1] - tracks[j, 1]
            if iou_bev[i, j] <= 0 and dx * dx + dy * dy >= NEAR_M * NEAR_M:
                continue
            rows[found], columns[found] = i, j
            found_3d[found], found_bev[found], distance_m[found] = iou_3d[i, j], iou_bev[i, j], np.hypot(dx, dy)
            found += 1
    return rows[:found], columns[:found], found_3d[:found], found_bev[:found], distance_m[:found]
