"""Inference of integrated detection and tracking: an agent's fused map, frame after frame, to tracks (Hu et al.,
III-D).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import torch
from torch import Tensor

from coopsim.geometry.assignment import Pairs
from coopsim.geometry.se3 import SE3
from coopsim.nn.inference.backend import PROCESSOR, Backend
from coopsim.nn.inference.encoders import folded
from coopsim.nn.integrated.encoder import PriorMap
from coopsim.nn.integrated.integrated_net import IntegratedNet, turned_around
from coopsim.nn.queries.instances import Instances, corrected_velocity
from coopsim.nn.queries.perceiver import QueryState, detections_of, peaks_of
from coopsim.nn.queries.query_net import kept_instances
from coopsim.tracking.cascade import Cascade
from coopsim.tracking.lifecycle import Lifecycle
from coopsim.tracking.motion.constant_velocity import Beliefs
from coopsim.tracking.motion.turning import MOVING_M_S
from coopsim.tracking.track_states import EmbeddingMemory, TrackStates
from coopsim.types import NS_PER_S, BevGrid, Mask


def updated_tracks(predicted: Instances, detected: Instances, pairs: Pairs, born: Tensor, dt_s: float) -> Instances:
    """Return the tracks of a frame: first those with a detection, then those without, then new ones, unnumbered.

    A pair is at the detection's box, and has its score, class and features, which ask for it in the next frame (eq.
    17). Its velocity is the predicted one, corrected by how far the detection lies beside the prediction. Detections
    confuse front and back, so a pair that moves faces forwards, and one that stands faces as the prediction does.
    Tracks without a detection stay as predicted.

    Args:
        predicted: tracks at their predicted places.
        detected: detections in the same frame.
        pairs: P rows of `predicted`, and of `detected`.
        born: (K,) rows of `detected` that begin tracks.
        dt_s: time since the frame before.
    """
    rows, columns = (torch.from_numpy(each).to(predicted.box.device) for each in pairs)
    known, now = predicted[rows], detected[columns]
    velocity = corrected_velocity(known, now, dt_s)
    box, missed = _faced(now.box, known.box, velocity), torch.zeros_like(known.missed)
    paired = replace(now, box=box, velocity=velocity, hits=known.hits + 1, missed=missed, number=known.number)
    left = torch.ones(len(predicted), dtype=torch.bool, device=rows.device)
    left[rows] = False
    alone = predicted[left]
    return Instances.joined([paired, replace(alone, missed=alone.missed + 1), detected[born]])


def _faced(box: Tensor, known: Tensor, velocity: Tensor) -> Tensor:
    """Return boxes (P, 7), turned by half a turn where they face neither forwards nor as those known (P, 7)."""
    forwards = torch.atan2(velocity[:, 1], velocity[:, 0])
    facing = torch.where(velocity.norm(dim=1) > MOVING_M_S, forwards, known[:, 6])
    return turned_around(box, torch.cos(box[:, 6] - facing) < 0)


@dataclass(frozen=True, slots=True)
class TrackRules:
    """Rules of tracks.

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
        """Return the tracks after a frame, and the number of the next new one; `next_number` is that of the first new
        track.
        """
        pairs = self.association.match(for_association(predicted), detections_of(detected))
        born = detected.score >= self.born
        born[torch.from_numpy(pairs[1]).to(born.device)] = False
        tracks = updated_tracks(predicted, detected, pairs, born, dt_s)
        alive = torch.from_numpy(self.lifecycle.alive(for_association(tracks))).to(born.device)
        return tracks[alive].surest(self.most).numbered(next_number)

    def reported(self, tracks: Instances, frame: int) -> Mask:
        """Return which tracks to report (N,); `frame` is the number of this frame, from 1."""
        return self.lifecycle.reported(for_association(tracks), frame)


def for_association(tracks: Instances) -> TrackStates:
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


@dataclass(frozen=True, slots=True, eq=False)
class IntegratedState(QueryState):
    """State of an agent after a frame; its instances are tracks, without numbers where another tracker tracks.

    Attributes:
        prior: downsampled map.
        detected: objects of the detection branch, without duplicates.
        frame: number of the frame, from 1.
    """

    prior: PriorMap
    detected: Instances
    frame: int


class IntegratedPerceiver:
    """Run a network of integrated detection and tracking, with the rules of its tracks.

    Args:
        net: the network.
        rules: rules of tracks; None: another tracker tracks.
        backend: device and arithmetic.
    """

    def __init__(self, net: IntegratedNet, rules: TrackRules | None, backend: Backend = PROCESSOR) -> None:
        self._net, self._head = backend.place(net), backend.place(folded(net.cooperative.head))
        self._rules, self._backend = rules, backend

    def step(
        self, before: IntegratedState | None, time_ns: int, odom_SE3_compass: SE3, fused: Tensor, grid: BevGrid
    ) -> IntegratedState:
        """Return an agent's state after a frame.

        Args:
            before: state after the frame before; None: this is the first.
            time_ns: time of the frame.
            odom_SE3_compass: the agent's compass frame now, in its odometry frame.
            fused: features (64, H, W) of all agents.
            grid: their cells, in the agent's compass frame.
        """
        tracks, prior, dt_s, frame, next_number = self._net.nothing(), None, 0.0, 1, 1
        with self._backend.inference():
            peaks = peaks_of(self._net, self._head, fused[None], grid)
            if before is not None:
                compass_SE3_before = odom_SE3_compass.inverse().compose(before.odom_SE3_compass)
                tracks, prior = before.instances.moved(compass_SE3_before), before.prior.moved(compass_SE3_before)
                dt_s, frame = (time_ns - before.time_ns) / NS_PER_S, before.frame + 1
                next_number = before.next_number
            with torch.autocast(self._backend.device.type, enabled=False):
                step = self._net(fused.float(), grid, peaks, tracks, prior, dt_s)
            detected, tracks = kept_instances(step.detected), step.predicted
            if self._rules is not None:
                tracks, next_number = self._rules.step(step.predicted, detected, dt_s, next_number)
        return IntegratedState(time_ns, odom_SE3_compass, tracks, next_number, step.prior, detected, frame)
