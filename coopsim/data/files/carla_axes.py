"""CARLA's axes, those of OPV2V and V2XSet: left-handed, x forward, y right, z up; angles in degrees.

With ours, only y differs in sign. A transform T of ours becomes S T S there, with S = diag(1, -1, 1). A pose is
[x, y, z, roll, yaw, pitch] (m, degrees); its rotation is

    | cp cy   cy sp sr - sy cr   -cy sp cr - sy sr |
    | sy cp   sy sp sr + cy cr   -sy sp cr + cy sr |
    | sp      -cp sr             cp cr             |

with c and s the cosine and sine of roll (r), yaw (y, clockwise seen from above) and pitch (p, nose up).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from coopsim.geometry.se3 import SE3, Floats

_MIRROR = np.array([1.0, -1.0, 1.0])

CAMERA_SE3_BODY = SE3(np.array([[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]]), np.zeros(3))
"""From a camera's body (x forward, y left, z up) to its own axes (OpenCV's: x right, y down, z forward)."""


def mirror(points: NDArray[Any]) -> NDArray[Any]:
    """Return points or vectors (..., 3) of ours in CARLA's axes, or those of CARLA in ours."""
    mirrored: NDArray[Any] = points * _MIRROR.astype(points.dtype)
    return mirrored


def mirror_transform(transform: SE3) -> SE3:
    """Return a transform between frames of ours as one between CARLA's, or the other way round."""
    return SE3(_MIRROR[:, None] * transform.rotation * _MIRROR, _MIRROR * transform.translation)


def to_carla_pose(pose: SE3) -> Floats:
    """Return a pose of ours as CARLA's (6,): x, y, z (m), roll, yaw, pitch (degrees)."""
    there = mirror_transform(pose)
    turn = there.rotation
    level = np.hypot(turn[0, 0], turn[1, 0])  # the cosine of pitch
    pitch = np.arctan2(turn[2, 0], level)
    if level > 1e-9:
        roll, yaw = np.arctan2(-turn[2, 1], turn[2, 2]), np.arctan2(turn[1, 0], turn[0, 0])
    else:  # looks straight up or down: roll and yaw turn about one axis
        roll, yaw = 0.0, np.arctan2(-turn[0, 1], turn[1, 1])
    return np.array([*there.translation, *np.degrees([roll, yaw, pitch])])


def from_carla_pose(pose: Sequence[float] | Floats) -> SE3:
    """Return CARLA's pose (6,) as one of ours."""
    x, y, z, *angles_deg = (float(value) for value in pose)
    (cr, cy, cp), (sr, sy, sp) = np.cos(np.radians(angles_deg)), np.sin(np.radians(angles_deg))
    turn = np.array(
        [
            [cp * cy, cy * sp * sr - sy * cr, -cy * sp * cr - sy * sr],
            [sy * cp, sy * sp * sr + cy * cr, -sy * sp * cr + cy * sr],
            [sp, -cp * sr, cp * cr],
        ]
    )
    return mirror_transform(SE3(turn, np.array([x, y, z])))
