"""Tracks with their uncertainty, as agents send them to each other."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from coopsim.geometry.boxes import Boxes3D
from coopsim.geometry.se3 import SE3, Floats, SE3Batch
from coopsim.support.arrays import freeze, unchecked
from coopsim.types.estimates import Tracks
from coopsim.types.units import Ints

PLANAR = 4
"""Size of the planar state x, y (m), vx, vy (m/s), which is fused by its covariance."""


@dataclass(frozen=True, slots=True, eq=False)
class TrackEstimates:
    """N tracks and the uncertainty of their planar states, in one frame of reference.

    Attributes:
        tracks: N tracks.
        covariance: (N, 4, 4) of x, y (m) and vx, vy (m/s), symmetric and positive definite.
    """

    tracks: Tracks
    covariance: Floats

    def __post_init__(self) -> None:
        freeze(self, covariance=((len(self.tracks), PLANAR, PLANAR), np.float64))

    @classmethod
    def trusted(cls, tracks: Tracks, covariance: Floats) -> TrackEstimates:
        """Make estimates without a check, of a new or read-only covariance that is known to fit."""
        return unchecked(cls, tracks=tracks, covariance=covariance)

    @classmethod
    def concatenate(cls, parts: Iterable[TrackEstimates]) -> TrackEstimates:
        """Join the estimates of all parts, in order; at least one part."""
        whole = list(parts)
        return cls.trusted(
            Tracks.trusted(
                np.concatenate([part.tracks.id for part in whole]),
                Boxes3D.concatenate(part.tracks.boxes for part in whole),
                np.concatenate([part.tracks.velocity for part in whole]),
                np.concatenate([part.tracks.score for part in whole]),
                np.concatenate([part.tracks.label for part in whole]),
            ),
            np.concatenate([part.covariance for part in whole]),
        )

    def __len__(self) -> int:
        return len(self.tracks)

    def __getitem__(self, index: slice | NDArray[Any]) -> TrackEstimates:
        return TrackEstimates.trusted(self.tracks[index], self.covariance[index])

    @property
    def mean(self) -> Floats:
        """Planar states (N, 4): x, y (m), vx, vy (m/s)."""
        return np.concatenate([self.tracks.boxes.center[:, :2], self.tracks.velocity], axis=1)

    def transform(self, dst_SE3_src: SE3) -> TrackEstimates:
        """Return the estimates in dst (gravity-aligned); the transform is taken to be exact."""
        turn = np.kron(np.eye(2), dst_SE3_src.rotation[:2, :2])
        return TrackEstimates.trusted(self.tracks.transform(dst_SE3_src), _symmetric(turn @ self.covariance @ turn.T))

    def transform_each(self, transforms: SE3Batch, number: Ints) -> TrackEstimates:
        """Move each estimate by the transform of its number (N,), as `transform` does."""
        turn, tracks = np.zeros((len(transforms), PLANAR, PLANAR)), self.tracks
        turn[:, :2, :2] = turn[:, 2:, 2:] = transforms.rotation[:, :2, :2]
        turn = turn[number]
        moved = Tracks.trusted(
            tracks.id,
            tracks.boxes.transform_each(transforms, number),
            transforms.rotate_planar(tracks.velocity, number),
            tracks.score,
            tracks.label,
        )
        return TrackEstimates.trusted(moved, _symmetric(turn @ self.covariance @ turn.swapaxes(1, 2)))

    def split(self, counts: Ints) -> list[TrackEstimates]:
        """Cut the estimates into parts of these sizes (G,), in order."""
        ends = np.cumsum(counts).tolist()
        return [self[first:last] for first, last in zip([0, *ends], ends, strict=False)]

    def with_pose_noise(self, origin_m: Floats, position_noise_m: float, heading_noise_rad: float) -> TrackEstimates:
        """Add the uncertainty of the pose by which the estimates were moved to their covariances.

        To first order an object at the offset d from the pose's `origin_m`, (2,) or (N, 2), is off by the pose's own
        error and, across d, by its heading's error times the distance: s^2 I + h^2 t t^T, where t is d turned by a
        right angle, and s and h are the standard deviations of position and heading. The turn of velocities is left
        out: at 20 m/s and 0.2 degrees it is 0.07 m/s.
        """
        x, y = (self.tracks.boxes.center[:, :2] - origin_m).T
        across = np.column_stack([-y, x]) * heading_noise_rad
        covariance = self.covariance.copy()
        covariance[:, :2, :2] += position_noise_m**2 * np.eye(2) + across[:, :, None] * across[:, None, :]
        return TrackEstimates.trusted(self.tracks, covariance)

    def with_planar_states(self, mean: Floats, covariance: Floats) -> TrackEstimates:
        """Return the same objects with other planar states (N, 4) and covariances (N, 4, 4)."""
        boxes = self.tracks.boxes
        center = np.column_stack([mean[:, :2], boxes.center[:, 2]])
        moved = replace(self.tracks, boxes=Boxes3D(center, boxes.size, boxes.yaw), velocity=mean[:, 2:])
        return TrackEstimates(moved, _symmetric(covariance))


def _symmetric(covariance: Floats) -> Floats:
    """Remove what rounding did to the symmetry."""
    return (covariance + covariance.transpose(0, 2, 1)) / 2
