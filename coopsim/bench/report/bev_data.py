"""Data of the bird's-eye views in pages: frames of a scene as small integers, for JSON."""

from __future__ import annotations

import base64
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from coopsim.geometry.boxes import Boxes3D
from coopsim.geometry.se3 import Floats, wrap_angle
from coopsim.types import Ints, Tracks
from coopsim.viz import palette
from coopsim.viz.bev import BevFrame
from coopsim.world.snapshot import RoadMap

UNIT_M, TURN_RAD = 0.05, 1e-4
"""Units of the integers that store lengths and headings."""
_INT16_MAX, _IDS = 2**15 - 1, 2**31

_COLORS: Mapping[str, palette.RGB] = palette.MAP | {
    "background": palette.BACKGROUND,
    "point": palette.POINT,
    "truth": palette.TRUTH,
    "agent": palette.AGENT,
    "text": palette.TEXT,
}
DRAWING: Mapping[str, Any] = {
    "unit": UNIT_M,
    "turn": TURN_RAD,
    "colors": {name: f"rgb{color}" for name, color in _COLORS.items()},
    "hue_step": palette.HUE_STEP,
    "saturation": palette.SATURATION,
    "lightness": palette.LIGHTNESS,
}
"""Units of the numbers, and colours."""


def thinned(points: Floats, count: int) -> Floats:
    """Return about `count` of the points (N, 3): every n-th in the order of the sweep, which runs around the sensor."""
    stride = max(1, -(-len(points) // count))
    return points[::stride].copy()  # a view would keep all of them in memory


def home_of(frames: Sequence[BevFrame]) -> Floats:
    """Return the origin (2,) m of a scene's coordinates: the middle of the agents at half time."""
    return _middle(frames[len(frames) // 2])


def map_data(road_map: RoadMap, home: Floats) -> dict[str, Any]:
    """Return the outlines of a road map, by field."""
    return {name: [(polygon - home).round(2).tolist() for polygon in getattr(road_map, name)] for name in palette.MAP}


def frame_data(frame: BevFrame, home: Floats) -> dict[str, Any]:
    """Return truth, agents and points of a frame."""
    middle = _middle(frame)
    # Points are most of the file. Two bytes from the agents' current place reach 1.6 km, however far they have driven.
    points = np.round((frame.points[:, :2] - middle) / UNIT_M)
    return {
        "origin": (middle - home).tolist(),
        "truth": _boxes(frame.actors.id, frame.actors.boxes, home),
        "points": _base64(points[(np.abs(points) <= _INT16_MAX).all(axis=1)], "<i2"),
        "agents": [
            [name, *(body.world_SE3_base.translation[:2] - home).round(2).tolist(), body.actor_id is not None]
            for name, body in frame.agents.items()
        ],
    }


def tracks_data(tracks: Mapping[str, Tracks], home: Floats) -> dict[str, str]:
    """Return the tracks of a frame, by reporting agent."""
    return {agent: _boxes(each.id, each.boxes, home) for agent, each in tracks.items()}


def _middle(frame: BevFrame) -> Floats:
    """Return the middle of the frame's agents, (2,) m."""
    places = [body.world_SE3_base.translation[:2] for body in frame.agents.values()]
    middle: Floats = np.mean(places or [np.zeros(2)], axis=0)
    return middle.round()


def _boxes(ids: Ints, boxes: Boxes3D, home: Floats) -> str:
    """Encode id, x, y, length, width, yaw of each box."""
    spots = (boxes.center[:, :2] - home) / UNIT_M
    rows = [ids % _IDS, spots, boxes.size[:, :2] / UNIT_M, wrap_angle(boxes.yaw) / TURN_RAD]
    return _base64(np.round(np.column_stack(rows)), "<i4")


def _base64(values: NDArray[Any], dtype: str) -> str:
    return base64.b64encode(values.astype(dtype).tobytes()).decode()
