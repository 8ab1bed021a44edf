"""Checks that a sensor can see from its mounting."""

from __future__ import annotations

import numpy as np

from coopsim.errors import InvalidValueError
from coopsim.geometry.se3 import SE3
from coopsim.sensors.lidar.cast.ray_grid import RayGrid
from coopsim.sensors.lidar.lidar import LidarConfig
from coopsim.sensors.scene import STATIC_ID, Triangles
from coopsim.world.models.model import Model

_ALL_AROUND = RayGrid(np.radians([-75.0, -40.0, -10.0, 10.0, 40.0, 75.0]), np.zeros(6), 16)


def require_free_mount(sensor: str, config: LidarConfig, height_m: float, body: Model | None) -> None:
    """Require a LiDAR above the ground and outside the body that carries it.

    Args:
        sensor: its name, for the message.
        config: its mounting.
        height_m: of the agent's body.
        body: of the carrier; None for a mast, which is as thin as a line.

    Raises:
        InvalidValueError: it is under the ground, or inside the body.
    """
    require_above_ground(f"lidar {sensor!r}", config.above_m, height_m)
    at = config.base_SE3_sensor(height_m).translation
    if body is not None and _is_inside(body, at - [0.0, 0.0, height_m / 2]):
        where, sides = (", ".join(f"{value:g}" for value in values) for values in (at, body.size_m))
        raise InvalidValueError(
            f"lidar {sensor!r} at x, y, z = {where} m is inside the body of a {body.name!r} (length, width and height "
            f"{sides} m)"
        )


def require_above_ground(sensor: str, above_m: float, height_m: float) -> None:
    """Raise `InvalidValueError` unless a sensor `above_m` over a body of this height is above the ground."""
    if height_m + above_m <= 0:
        raise InvalidValueError(
            f"{sensor} is {-height_m - above_m:g} m under the ground: above_m = {above_m:g} counts from the top of a "
            f"body that is {height_m:g} m high"
        )


def _is_inside(body: Model, point_m: np.ndarray[tuple[int], np.dtype[np.float64]]) -> bool:
    """Return whether a point in the body's axes sees the body on all sides."""
    count = len(body.faces)
    alone = Triangles(
        body.vertices, body.faces, np.full(count, STATIC_ID), body.reflectivity, np.zeros((count, 3), dtype=np.uint8)
    )
    return bool((_ALL_AROUND.cast(alone, SE3(np.eye(3), point_m)).face >= 0).all())
