"""Trajectory management of integrated tracking (Hu, Wang and Wang, section III-D): which detection is which track."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import torch

from coopsim.nn.inference.query_perceiver import detections_of
from coopsim.nn.integrated.track_update import updated_tracks
from coopsim.nn.queries.instances import UNNUMBERED, Instances
from coopsim.tracking.cascade import Cascade
from coopsim.tracking.lifecycle import Lifecycle
from coopsim.tracking.motion.constant_velocity import Beliefs
from coopsim.tracking.track_states import EmbeddingMemory, TrackStates
from coopsim.types import Mask


@dataclass(frozen=True, slots=True)
class TrackRules:
    """The rules of tracks.

    Attributes:
        association: pairs predicted tracks with detections; the score of a track is s_t, that of a detection s_d.
        lifecycle: reports and drops tracks.
        born: smallest score of a detection that begins a track.
        most: tracks that an agent keeps; the surest stay.
    """

    association: Cascade
    lifecycle: Lifecycle
    born: float
    most: int

    def step(self, predicted: Instances, detected: Instances, dt_s: float, next_number: int) -> tuple[Instances, int]:
        """Return the tracks after a frame, and the number of the next new one.

        Args:
            predicted: the tracks, where they are predicted to be.
            detected: what is detected.
            dt_s: time since the frame before.
            next_number: of the first new track.
        """
        pairs = self.association.match(as_tracked(predicted), detections_of(detected))
        born = detected.score >= self.born
        born[torch.from_numpy(pairs[1]).to(born.device)] = False
        tracks = updated_tracks(predicted, detected, pairs, born, dt_s)
        alive = torch.from_numpy(self.lifecycle.alive(as_tracked(tracks))).to(born.device)
        tracks = tracks[alive].surest(self.most)
        new = tracks.number == UNNUMBERED
        number = torch.where(new, next_number + torch.cumsum(new, 0) - 1, tracks.number)
        return replace(tracks, number=number), next_number + int(new.sum())

    def reported(self, tracks: Instances, frame: int) -> Mask:
        """Return which tracks to report (N,); `frame` is the number of this frame, from 1."""
        return self.lifecycle.reported(as_tracked(tracks), frame)


def as_tracked(tracks: Instances) -> TrackStates:
    """Return tracks as associations and lifecycles know them, without beliefs and looks."""
    count = len(tracks)
    none = np.zeros(count, dtype=np.int64)
    boxes, score, velocity = (each.double().numpy(force=True) for each in (tracks.box, tracks.score, tracks.velocity))
    whole = (tracks.number, tracks.label, tracks.hits, tracks.missed)
    number, label, hits, missed = (each.numpy(force=True) for each in whole)
    return TrackStates(
        Beliefs(np.zeros((count, 0)), np.zeros((count, 0, 0))), boxes, velocity, number, label, score, score, score,
        hits, missed, none, none.astype(np.bool_), EmbeddingMemory.blank(count, dim=0, window=1),
    )  # fmt: skip
