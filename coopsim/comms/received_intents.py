"""Planned ways by radio: the newest of each sender that an agent received messages of, and who brakes hard."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from coopsim.comms.codecs.maneuvers import DENM_ID, MCM_ID, decode_denm, decode_mcm, latest_ns
from coopsim.errors import CodecError
from coopsim.geometry.se3 import Floats
from coopsim.types import NS_PER_S, Observation
from coopsim.types.intents import AHEAD_S, STEP_S, HardBrake, Intents, PlannedPath

STALE_NS = NS_PER_S
"""Age from which a planned way is no longer used; ours."""

_VALID_NS = 2 * NS_PER_S  # of a warning of a hard brake, as it says
_TIMES_S = np.arange(round(AHEAD_S / STEP_S) + 1) * STEP_S


class ReceivedIntents:
    """Memory of one agent for what others say of their own motion, for one episode.

    Attributes:
        rejected: number of messages that could not be read.
    """

    def __init__(self) -> None:
        self._ways: dict[int, tuple[int, PlannedPath]] = {}
        self._brakes: dict[int, int] = {}
        self.rejected = 0

    def hear(self, observation: Observation) -> None:
        """Take in the messages in an observation's `signals`; those about lights are passed over."""
        now_ns = observation.time_ns
        for payload in observation.signals:
            if payload[1:2] not in (bytes([MCM_ID]), bytes([DENM_ID])):
                continue
            try:
                self._remember(_decoded(payload), now_ns)
            except CodecError:
                self.rejected += 1
        self._ways = {each: way for each, way in self._ways.items() if now_ns - way[0] <= STALE_NS}
        self._brakes = {each: time_ns for each, time_ns in self._brakes.items() if now_ns - time_ns <= _VALID_NS}

    def now(self, observation: Observation) -> Intents:
        """Return what is known, in the agent's base frame by its estimated pose."""
        if not self._ways:
            return Intents.empty()
        told = list(self._ways.values())
        age_s = np.array([(observation.time_ns - time_ns) / NS_PER_S for time_ns, _ in told])
        ways = [way for _, way in told]
        places = np.stack([_in_world(way) for way in ways])
        base_SE3_world = observation.pose.world_SE3_base.inverse()
        points = np.column_stack([places[..., :2].reshape(-1, 2), np.zeros(places[..., 0].size)])
        moved = base_SE3_world.apply(points)[:, :2].reshape(*places.shape[:2], 2)
        heading = places[..., 2:] - float(observation.pose.xyz_yaw[3])
        return Intents(
            np.array([way.station for way in ways]),
            age_s,
            np.concatenate([moved, heading], axis=-1),
            np.array([_speed_m_s(way, age) for way, age in zip(ways, age_s.tolist(), strict=True)]),
            *(np.array([getattr(way, name) for way in ways]) for name in ("length_m", "width_m")),
            np.array([way.station in self._brakes for way in ways]),
        )

    def _remember(self, content: PlannedPath | HardBrake, now_ns: int) -> None:
        if isinstance(content, HardBrake):
            known_ns = self._brakes.get(content.station, content.time_ns)
            self._brakes[content.station] = min(max(content.time_ns, known_ns), now_ns)
            return
        time_ns, known = latest_ns(content, now_ns), self._ways.get(content.station)
        if known is None or known[0] < time_ns:
            self._ways[content.station] = time_ns, content


@lru_cache(maxsize=256)
def _decoded(payload: bytes) -> PlannedPath | HardBrake:
    """Return the read-only content of a payload, decoded once for all who hear it."""
    return decode_mcm(payload) if payload[1] == MCM_ID else decode_denm(payload)


def _in_world(way: PlannedPath) -> Floats:
    """Return places (K, 3), m and rad, in the world frame at `_TIMES_S`; behind the last point straight on."""
    told_s = way.first_s + way.step_s * np.arange(len(way.points))
    heading = np.unwrap(way.heading_rad)
    columns = [np.interp(_TIMES_S, told_s, each) for each in (*way.points.T, heading)]
    beyond_m = np.maximum(_TIMES_S - told_s[-1], 0.0) * way.speed_m_s[-1]
    east, north = (way.position[k] + columns[k] for k in (0, 1))
    return np.column_stack([east + beyond_m * np.cos(heading[-1]), north + beyond_m * np.sin(heading[-1]), columns[2]])


def _speed_m_s(way: PlannedPath, age_s: float) -> float:
    return float(np.interp(age_s, way.first_s + way.step_s * np.arange(len(way.points)), way.speed_m_s))
