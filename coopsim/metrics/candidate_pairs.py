"""Pairs of objects and tracks that a metric could match, found once per frame for all metrics."""

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
"""Distance of centres on the ground from which a track is not on an object: nuScenes' (Caesar et al. 2020)."""


@dataclass(frozen=True, slots=True, eq=False)
class Pairs:
    """Pairs of one kind that overlap in the bird's-eye view (BEV), or whose centres are less than 2 m apart.

    Attributes:
        truth: (P,) rows of the truth.
        track: (P,) rows of the tracks.
        iou_3d: (P,) in [0, 1].
        iou_bev: (P,) in [0, 1].
        distance: (P,) m between the centres, on the ground.
    """

    truth: Ints
    track: Ints
    iou_3d: Floats
    iou_bev: Floats
    distance: Floats

    @classmethod
    def none(cls) -> Pairs:
        """No pairs."""
        rows, values = np.zeros(0, dtype=np.int64), np.zeros(0)
        return cls(rows, rows, values, values, values)

    def __len__(self) -> int:
        return len(self.truth)

    def __getitem__(self, index: NDArray[np.bool_]) -> Pairs:
        return Pairs(
            self.truth[index], self.track[index], self.iou_3d[index], self.iou_bev[index], self.distance[index]
        )


def find_pairs(truth: Boxes3D, truth_kind: Ints, tracks: Boxes3D, track_kind: Ints) -> Pairs:
    """The pairs of a frame: N objects with their (N,) kinds (classes, or superclasses), and M tracks with theirs."""
    rows, columns = truth.array, tracks.array
    same_kind = truth_kind[:, None] == track_kind
    return Pairs(*_select(same_kind, *iou_3d_and_bev(rows, columns), rows, columns))


# Everything that is handed over is fresh, so writeable and contiguous: one layout, compiled once.
@njit(cache=True, nogil=True)
def _select(
    same_kind: NDArray[np.bool_], in_space: Floats, from_above: Floats, truth: Floats, tracks: Floats
) -> tuple[Ints, Ints, Floats, Floats, Floats]:
    most = same_kind.size
    rows, columns = np.empty(most, np.int64), np.empty(most, np.int64)
    volume, area, distance = np.empty(most), np.empty(most), np.empty(most)
    found = 0
    for i in range(len(truth)):
        for j in range(len(tracks)):
            if not same_kind[i, j]:
                continue
            dx, dy = truth[i, 0] - tracks[j, 0], truth[i, 1] - tracks[j, 1]
            if from_above[i, j] <= 0 and dx * dx + dy * dy >= NEAR_M * NEAR_M:
                continue
            rows[found], columns[found] = i, j
            volume[found], area[found], distance[found] = in_space[i, j], from_above[i, j], np.hypot(dx, dy)
            found += 1
    return rows[:found], columns[:found], volume[:found], area[:found], distance[:found]
