"""A reader of OPV2V's folders by their description, independent of the writer: left-handed axes, poses in degrees."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray

Floats = NDArray[np.float64]

RECORD = np.dtype([("xyz", "<f4", (3,)), ("rgb", "<u4")])

BODY_FROM_CAMERA = np.array([[0, 0, 1], [1, 0, 0], [0, -1, 0]])
"""From a picture's axes (x right, y down, z into it) to a sensor's (x forward, y right, z up)."""


def matrix(pose: list[float]) -> Floats:
    """World from sensor (4, 4), of x, y, z, roll, yaw, pitch; the product of three left-handed turns."""
    x, y, z, *angles = pose
    roll, yaw, pitch = np.radians(angles)
    about_z = [[np.cos(yaw), -np.sin(yaw), 0], [np.sin(yaw), np.cos(yaw), 0], [0, 0, 1]]
    about_y = [[np.cos(pitch), 0, -np.sin(pitch)], [0, 1, 0], [np.sin(pitch), 0, np.cos(pitch)]]
    about_x = [[1, 0, 0], [0, np.cos(roll), np.sin(roll)], [0, -np.sin(roll), np.cos(roll)]]
    result = np.eye(4)
    result[:3, :3] = np.array(about_z) @ about_y @ about_x
    result[:3, 3] = x, y, z
    return result


def load(scenario: Path, agent: str, stem: str) -> tuple[dict[str, Any], Floats, Floats]:
    """The parameters, points (N, 3) in the sensor's frame and intensity (N,) of an agent's frame."""
    parameters = yaml.safe_load((scenario / agent / f"{stem}.yaml").read_text())
    header, _, body = (scenario / agent / f"{stem}.pcd").read_bytes().partition(b"DATA binary\n")
    assert b"FIELDS x y z rgb\n" in header
    rows = np.frombuffer(body, RECORD)
    red = (rows["rgb"] >> 16) & 255
    np.testing.assert_array_equal(rows["rgb"], red * 0x010101)
    return parameters, rows["xyz"].astype(np.float64), red / 255.0


def apply(transform: Floats, points: Floats) -> Floats:
    return points @ transform[:3, :3].T + transform[:3, 3]


def boxes(objects: dict[int, dict[str, Any]]) -> dict[int, Floats]:
    """x, y, z, l, w, h, yaw (rad) of each object, in left-handed world axes."""
    return {
        number: np.array(
            [
                *np.add(each["location"], each["center"]),
                *np.multiply(each["extent"], 2),
                np.radians(each["angle"][1]),
            ]
        )
        for number, each in objects.items()
    }
