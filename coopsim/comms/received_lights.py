"""Lights by radio: the newest phases and geometry of each junction that an agent received messages of."""

from __future__ import annotations

from collections.abc import Iterable
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from coopsim.comms.codecs.dsrc import decode_mapem, decode_spatem
from coopsim.comms.codecs.maneuvers import DENM_ID, MCM_ID
from coopsim.errors import CodecError
from coopsim.geometry.se3 import Floats
from coopsim.types import NS_PER_S, Observation
from coopsim.types.intersections import IntersectionMap, MovementPhase, SignalPhases

STALE_NS = 2 * NS_PER_S
"""Age from which phases are no longer used."""

_WIDTH_M, _ALIGNED = 3.5, 0.5  # of a lane without a stated width; cosine of the largest angle between car and lane
_SPATEM_ID = 4


class LightAhead(NamedTuple):
    """Light for one way over the junction ahead."""

    intersection: int
    """The junction's id."""
    to_lane: int
    """The lane that the way leads to, among those of its `IntersectionMap`."""
    stop_m: float
    """Distance to the stop line."""
    phase: MovementPhase
    """What it shows."""
    left_s: float
    """Time until that changes; NaN: unknown."""


class ReceivedLights:
    """Memory of one agent for messages about lights, for one episode.

    Attributes:
        phases: newest phases by the junction's id.
        maps: newest geometry by the junction's id.
        rejected: number of messages that could not be read.
    """

    def __init__(self) -> None:
        self.phases: dict[int, SignalPhases] = {}
        self.maps: dict[int, IntersectionMap] = {}
        self.rejected = 0

    def hear(self, observation: Observation) -> None:
        """Take in the messages in an observation's `signals`; those about the senders' own motion are passed over."""
        for payload in observation.signals:
            if payload[1:2] in (bytes([MCM_ID]), bytes([DENM_ID])):
                continue
            try:
                for each in _decoded(payload):
                    if isinstance(each, IntersectionMap):
                        self.maps[each.intersection] = each
                    elif (known := self.phases.get(each.intersection)) is None or known.time_ns < each.time_ns:
                        self.phases[each.intersection] = each
            except CodecError:
                self.rejected += 1

    def ahead(self, observation: Observation) -> tuple[LightAhead, ...]:
        """Return the lights of the lane that the agent is on by its estimated pose, the nearest first.

        There is one for each way that its lane leads to. Without geometry, or phases of the last 2 s, there is none.
        """
        found = []
        for identity, geometry in self.maps.items():
            phases = self.phases.get(identity)
            fresh = phases is not None and observation.time_ns - phases.time_ns <= STALE_NS
            if phases is not None and fresh and phases.revision == geometry.revision:
                found += _lights(geometry, phases, observation)
        return tuple(sorted(found, key=lambda light: light.stop_m))


@lru_cache(maxsize=256)
def _decoded(payload: bytes) -> Iterable[SignalPhases | IntersectionMap]:
    """Return the read-only content of a payload, decoded once for all who hear it."""
    return decode_spatem(payload) if payload[1:2] == bytes([_SPATEM_ID]) else decode_mapem(payload)


def _lights(geometry: IntersectionMap, phases: SignalPhases, observation: Observation) -> list[LightAhead]:
    x, y, _, heading = observation.pose.xyz_yaw.tolist()
    place = np.array([x, y]) - geometry.reference[:2]
    forward, half_m = np.array([np.cos(heading), np.sin(heading)]), (geometry.lane_width_m or _WIDTH_M) / 2
    row, left_s = {group: k for k, group in enumerate(phases.group.tolist())}, phases.left_s(observation.time_ns)
    found = []
    for lane in geometry.lanes:
        stop_m = _stop_m(lane.points, place, forward, half_m) if lane.kind == "vehicle" and lane.approaches else None
        if stop_m is None:
            continue
        for to_lane, group in lane.connections:
            if group in row:
                k = row[group]
                light = MovementPhase(int(phases.phase[k])), float(left_s[k])
                found.append(LightAhead(geometry.intersection, to_lane, stop_m, *light))
    return found


def _stop_m(points: Floats, place: Floats, forward: Floats, half_m: float) -> float | None:
    """Return the distance along a lane (K, 2) from a place (2,) on it to its first point; None: it is not on it.

    `forward` is the direction (2,) of the agent there, `half_m` half of the lane's width.
    """
    steps = np.diff(points, axis=0)
    long = np.maximum(np.hypot(*steps.T), 1e-9)
    along = np.clip(np.einsum("kd,kd->k", place - points[:-1], steps) / long, 0.0, long)
    aside = np.hypot(*(place - points[:-1] - (along / long)[:, None] * steps).T)
    nearest = int(np.argmin(aside))
    if aside[nearest] > half_m or -steps[nearest] @ forward < _ALIGNED * long[nearest]:
        return None
    return float(long[:nearest].sum() + along[nearest])
