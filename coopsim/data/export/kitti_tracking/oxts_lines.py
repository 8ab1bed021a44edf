"""Lines of KITTI's GPS and IMU data, from the agents' true motion.

The world's origin is put at latitude 0 and longitude 0, x to the east and y to the north: there KITTI's Mercator
projection, whose scale depends on a sequence's first latitude, gives x and y back to a micrometre.
"""

from __future__ import annotations

import numpy as np

from coopsim.data.export.export_frame import ExportFrame
from coopsim.data.recordings.gps_poses import EARTH_M
from coopsim.geometry.se3 import Floats, wrap_angle
from coopsim.types import NS_PER_S

GRAVITY = 9.81
"""m/s^2, which an accelerometer at rest feels upwards."""

OXTS_FIELDS = (
    *("lat", "lon", "alt", "roll", "pitch", "yaw", "vn", "ve", "vf", "vl", "vu", "ax", "ay", "az", "af", "al", "au"),
    *("wx", "wy", "wz", "wf", "wl", "wu", "pos_accuracy", "vel_accuracy"),
    *("navstat", "numsats", "posmode", "velmode", "orimode"),
)
"""KITTI's 30 columns."""

_EXACT = 0.0
_MODES = (4, 0, 0, 0, 0)  # "locked"; there are no satellites


class OxtsLines:
    """The lines of one agent's sequence, whose accelerations and turn rates come from successive frames.

    Args:
        column: number of the agent.
    """

    def __init__(self, column: int) -> None:
        self._column = column
        self._last: tuple[int, Floats, Floats, float] | None = None

    def line(self, frame: ExportFrame) -> str:
        """Return the line of the next frame. In the first one accelerations and turn rates are 0."""
        agent = frame.agents[self._column]
        pose = agent.world_SE3_base
        place, yaw = pose.translation, pose.yaw
        velocity, acceleration, rate = np.zeros(3), np.zeros(3), 0.0
        if self._last is not None:
            elapsed_s = (frame.time_ns - self._last[0]) / NS_PER_S
            velocity = (place - self._last[1]) / elapsed_s
            rate = float(wrap_angle(yaw - self._last[3])) / elapsed_s
        own = frame.objects.id == agent.body.actor_id
        if own.any():
            velocity[:2] = frame.velocity[own][0]
        if self._last is not None:
            acceleration = (velocity - self._last[2]) / elapsed_s
        self._last = frame.time_ns, place, velocity, yaw
        ahead, aside = (pose.rotation.T @ velocity)[:2]
        felt = pose.rotation.T @ acceleration
        numbers = [
            *_latitude_longitude(place), place[2], 0.0, 0.0, yaw,
            velocity[1], velocity[0], ahead, aside, velocity[2],
            felt[0], felt[1], felt[2] + GRAVITY, *felt,
            0.0, 0.0, rate, 0.0, 0.0, rate, _EXACT, _EXACT,
        ]  # fmt: skip
        return " ".join([f"{number:.12f}" for number in numbers] + [str(mode) for mode in _MODES])


def _latitude_longitude(place: Floats) -> tuple[float, float]:
    """Return degrees: the inverse of mx = R lon pi / 180, my = R ln(tan(pi (90 + lat) / 360))."""
    latitude = 2 * np.arctan(np.exp(place[1] / EARTH_M)) - np.pi / 2
    return float(np.degrees(latitude)), float(np.degrees(place[0] / EARTH_M))
