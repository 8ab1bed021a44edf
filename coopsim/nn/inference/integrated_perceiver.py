"""Integrated detection and tracking at work: frame after frame, from an agent's fused map to tracks."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from coopsim.geometry.se3 import SE3
from coopsim.nn.inference.backend import PROCESSOR, Backend
from coopsim.nn.inference.integrated_tracks import TrackRules
from coopsim.nn.inference.query_perceiver import peaks_of
from coopsim.nn.inference.quick import folded
from coopsim.nn.integrated.integrated_net import IntegratedNet
from coopsim.nn.integrated.prior_enhancement import PriorMap
from coopsim.nn.queries.instances import Instances
from coopsim.nn.queries.query_net import kept_instances
from coopsim.types import NS_PER_S, BevGrid


@dataclass(frozen=True, slots=True, eq=False)
class IntegratedMemory:
    """What an agent knows after a frame.

    Attributes:
        time_ns: of the frame.
        odom_SE3_compass: the agent's compass frame then, in its odometry frame.
        prior: of the map.
        detected: what the detection branch found, without duplicates.
        tracks: with numbers; none, where another tracker tracks.
        frame: number of the frame, from 1.
        next_number: of the next new track.
    """

    time_ns: int
    odom_SE3_compass: SE3
    prior: PriorMap
    detected: Instances
    tracks: Instances
    frame: int
    next_number: int

    def at(self, time_ns: int, odom_SE3_compass: SE3) -> Instances:
        """Return the tracks in the agent's compass frame at a later time, moved on by their velocities."""
        later = self.tracks.advanced((time_ns - self.time_ns) / NS_PER_S)
        return later.moved(odom_SE3_compass.inverse().compose(self.odom_SE3_compass))


class IntegratedPerceiver:
    """A network of integrated detection and tracking, and the rules of its tracks.

    Args:
        net: the network.
        rules: of tracks; None: nothing is tracked here.
        backend: on which it computes.
    """

    def __init__(self, net: IntegratedNet, rules: TrackRules | None, backend: Backend = PROCESSOR) -> None:
        self._net, self._head = backend.place(net), backend.place(folded(net.cooperative.head))
        self._rules, self._backend = rules, backend

    def step(
        self, before: IntegratedMemory | None, time_ns: int, odom_SE3_compass: SE3, fused: Tensor, grid: BevGrid
    ) -> IntegratedMemory:
        """Return what an agent knows after a frame.

        Args:
            before: after the frame before; None: this is the first.
            time_ns: of the frame.
            odom_SE3_compass: the agent's compass frame now, in its odometry frame.
            fused: features (64, H, W) of all agents.
            grid: their cells, in the agent's compass frame.
        """
        tracks, prior, dt_s, frame, next_number = self._backend.put(self._net.nothing()), None, 0.0, 1, 1
        with self._backend.inference():
            peaks = peaks_of(self._net, self._head, fused[None], grid)
            if before is not None:
                compass_SE3_before = odom_SE3_compass.inverse().compose(before.odom_SE3_compass)
                tracks, prior = before.tracks.moved(compass_SE3_before), before.prior.moved(compass_SE3_before)
                dt_s, frame = (time_ns - before.time_ns) / NS_PER_S, before.frame + 1
                next_number = before.next_number
            with torch.autocast(self._backend.device.type, enabled=False):
                step = self._net(fused.float(), grid, peaks, tracks, prior, dt_s)
            detected, tracks = kept_instances(step.detected), step.predicted
            if self._rules is not None:
                tracks, next_number = self._rules.step(step.predicted, detected, dt_s, next_number)
        return IntegratedMemory(time_ns, odom_SE3_compass, step.prior, detected, tracks, frame, next_number)
