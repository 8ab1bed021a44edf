"""Messages of connected cars about their own motion, beside their detections: planned ways, and hard brakes."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from coopsim.comms.codecs.asn1 import station_id
from coopsim.comms.codecs.maneuvers import DENM, MCM, encode_denm, encode_mcm
from coopsim.comms.signal_broadcast import is_due
from coopsim.geometry.se3 import Floats
from coopsim.types import NS_PER_S, Message, PoseEstimate
from coopsim.types.driving import CarState
from coopsim.types.intents import AHEAD_S, STEP_S, HardBrake, PlannedPath

EVERY_NS = NS_PER_S // 10
"""Time between two messages of a car; longer where frames are farther apart."""

HARD_M_S2, OVER_M_S2 = 6.0, 2.5
"""Deceleration from which on a car warns of a hard brake, and below which that is over: as of the emergency stop signal
in UN Regulation 13-H, 5.2.22.4."""

_WITH_EASE_M_S2 = 2.0  # of braking for a lower limit ahead; ours
_BACK_S = 2.0  # in which a car is back in the middle of its lane, as after a lane change; ours


class _Brake(NamedTuple):
    number: int
    began_ns: int
    on: bool


class IntentBroadcast:
    """The messages of one episode.

    Args:
        senders: codecs of what each agent says, by name: "mcm", "denm" or both.
    """

    def __init__(self, senders: Mapping[str, tuple[str, ...]]) -> None:
        self._senders = senders
        self._brakes: dict[str, _Brake] = {}
        self._before_ns: int | None = None

    def messages(
        self, time_ns: int, cars: Mapping[str, CarState], poses: Mapping[str, PoseEstimate]
    ) -> dict[str, list[Message]]:
        """Return the messages that are due, by sender; calls are in order of time.

        Args:
            time_ns: now.
            cars: motion and way ahead of those that drive.
            poses: estimated poses of agents, by which messages are placed.
        """
        due, self._before_ns = is_due(self._before_ns, time_ns, EVERY_NS), time_ns
        found: dict[str, list[Message]] = {}
        for name, codecs in self._senders.items():
            if name not in cars or cars[name].crashed:
                continue
            brake = self._hard_brake(name, time_ns, cars[name], poses[name])
            if not due:
                continue
            payloads = []
            if MCM in codecs:
                payloads.append((encode_mcm(planned_path(name, time_ns, cars[name], poses[name])), MCM))
            if DENM in codecs and brake is not None:
                payloads.append((encode_denm(brake), DENM))
            found[name] = [Message(name, time_ns, poses[name], *each) for each in payloads]
        return found

    def _hard_brake(self, name: str, time_ns: int, car: CarState, pose: PoseEstimate) -> HardBrake | None:
        before = self._brakes.get(name, _Brake(-1, 0, False))
        least = OVER_M_S2 if before.on else HARD_M_S2
        if -car.acceleration_m_s2 < least:
            self._brakes[name] = before._replace(on=False)
            return None
        brake = before if before.on else _Brake((before.number + 1) % 2**16, time_ns, True)
        self._brakes[name] = brake
        heading = float(pose.xyz_yaw[3])
        told = (
            station_id(name),
            brake.number,
            brake.began_ns,
            time_ns,
            pose.xyz_yaw[:3],
            heading,
            max(car.speed_m_s, 0.0),
        )
        return HardBrake(*told)


def planned_path(name: str, time_ns: int, car: CarState, pose: PoseEstimate) -> PlannedPath:
    """Return the way of a car along its route for `AHEAD_S`: it keeps its acceleration, and brakes for lower limits.

    Args:
        name: the agent's name.
        time_ns: now.
        car: its motion and its route.
        pose: its estimated pose.
    """
    route = car.route
    along, aside, _ = (float(each[0]) for each in route.place(np.zeros((1, 2))))
    speed, moved = _motion(car, along)
    place, last = (along + moved) / route.spacing_m, len(route.points) - 1
    k, tangents = np.clip(place.astype(np.int64), 0, last), route.tangents
    tangent = tangents[k]
    off = aside * np.maximum(1.0 - np.arange(len(moved)) * STEP_S / _BACK_S, 0.0)
    left = np.column_stack([-tangent[:, 1], tangent[:, 0]])
    points = route.points[k] + ((place - k) * route.spacing_m)[:, None] * tangent + off[:, None] * left
    yaw = float(pose.xyz_yaw[3])
    cos, sin = math.cos(yaw), math.sin(yaw)
    offsets = np.column_stack([cos * points[:, 0] - sin * points[:, 1], sin * points[:, 0] + cos * points[:, 1]])
    heading = yaw + np.arctan2(tangent[:, 1], tangent[:, 0])
    size = car.length_m, car.width_m
    return PlannedPath(station_id(name), time_ns, pose.xyz_yaw[:3], offsets, heading, speed, 0.0, STEP_S, *size)


def _motion(car: CarState, along_m: float) -> tuple[Floats, Floats]:
    """Return speeds (K,) m/s, and how far (K,) m the car will have come, every `STEP_S` from now."""
    route = car.route
    allowed = np.array(route.speed_limit_m_s)
    for k in range(len(allowed) - 2, -1, -1):
        allowed[k] = min(allowed[k], math.sqrt(allowed[k + 1] ** 2 + 2 * _WITH_EASE_M_S2 * route.spacing_m))
    steps = round(AHEAD_S / STEP_S)
    speeds, moved = np.empty(steps + 1), np.zeros(steps + 1)
    speeds[0] = max(car.speed_m_s, 0.0)
    for k in range(steps):
        speed = float(speeds[k])
        place = min(max(round((along_m + moved[k] + speed * STEP_S) / route.spacing_m), 0), len(allowed) - 1)
        most = max(float(allowed[place]), speed - _WITH_EASE_M_S2 * STEP_S)
        speeds[k + 1] = max(min(speed + car.acceleration_m_s2 * STEP_S, most), 0.0)
        moved[k + 1] = moved[k] + (speed + speeds[k + 1]) / 2 * STEP_S
    return speeds, moved
