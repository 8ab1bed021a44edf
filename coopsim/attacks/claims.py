"""Rows of detections and tracks that an attacker makes up, added among the honest ones."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from coopsim.geometry.boxes import Boxes3D
from coopsim.geometry.se3 import Floats
from coopsim.types import Detections, Ints, Tracks
from coopsim.types.track_estimates import TrackEstimates

_SURE_M = 0.1
"""Standard deviation of a claimed place and velocity where no honest row states one: that of a good detector."""

FIRST_ID = 10_000
"""First number of a claimed track: honest on-board trackers count from 0, and do not come so far in an episode."""


@dataclass(frozen=True, slots=True, eq=False)
class Claims:
    """N objects that are not there, in the attacker's base frame.

    Attributes:
        id: (N,) number of each, constant over its life.
        boxes: N boxes.
        velocity: (N, 2) m/s over ground, in the axes of the frame.
        score: (N,) confidence.
        label: (N,) int, an `ObjectClass`.
    """

    id: Ints
    boxes: Boxes3D
    velocity: Floats
    score: Floats
    label: Ints

    def among_detections(self, honest: Detections, rng: np.random.Generator) -> Detections:
        """Return the honest detections and these, in an order of its own, as places in a list would tell."""
        covariance = None
        if honest.covariance is not None:
            usual = np.median(honest.covariance, axis=0) if len(honest) else np.diag(np.full(7, _SURE_M**2))
            covariance = np.tile(usual, (len(self.id), 1, 1))
        claimed = Detections(
            self.boxes,
            self.score,
            self.label,
            covariance,
            velocity=None if honest.velocity is None else self.velocity,
        )
        rows = Detections.concatenate([honest, claimed])
        return rows[rng.permutation(len(rows))]

    def among_tracks(self, honest: TrackEstimates, rng: np.random.Generator) -> TrackEstimates:
        """Return the honest tracks and these, in an order of its own."""
        usual = np.median(honest.covariance, axis=0) if len(honest) else np.diag(np.full(4, _SURE_M**2))
        tracks = Tracks(self.id + FIRST_ID, self.boxes, self.velocity, self.score, self.label)
        claimed = TrackEstimates(tracks, np.tile(usual, (len(self.id), 1, 1)))
        rows = TrackEstimates.concatenate([honest, claimed])
        return rows[rng.permutation(len(rows))]


def with_boxes(tracks: TrackEstimates, boxes: Boxes3D, velocity: Floats | None = None) -> TrackEstimates:
    """Return tracks with other boxes, and with other velocities if given."""
    moved = replace(tracks.tracks, boxes=boxes, velocity=tracks.tracks.velocity if velocity is None else velocity)
    return TrackEstimates(moved, tracks.covariance)
