"""BevImage: a square picture around the agent, seen from above, with the agent's heading up.

The agent is in the middle. Row 0 is farthest ahead (x), column 0 farthest to the left (y).

| channels | planes | meaning |
|---|---|---|
| `detections` | occupied, score, cos, sin | the agent's own detections; the surest is on top |
| `points` | density, height | of its LiDARs: logarithm of the number, 1 from 64 on; the highest, from -1 m to 5 m |
| `messages` | occupied, score, cos, sin, fresh | boxes of messages, or points (score 0); fresh: 1 / (1 + age in s) |
| `velocity` | vx, vy | of the boxes in messages that have any ("tracks"), from -40 to 40 m/s |
| `map` | lanes, crosswalks, pavements, buildings, markings | the road map, placed by the agent's estimated pose |

Brightness is 0 to 1 for float32 and 0 to 255 for uint8. Scores are taken into [0, 1]. cos and sin of a heading,
and velocities, are shifted: 0.5 is zero. Where there is nothing, all planes are 0.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from coopsim.envs.wrappers.bev_kernels import paint_boxes, paint_map, paint_points
from coopsim.envs.wrappers.map_raster import LAYERS, MapRaster
from coopsim.envs.wrappers.received import BOX, SCORE, VELOCITY, Received, as_rows
from coopsim.envs.wrappers.view import Arrays, Scene, View
from coopsim.errors import InvalidValueError
from coopsim.geometry.se3 import Floats
from coopsim.support.checks import require_choice, require_count, require_positive
from coopsim.types import Observation
from coopsim.world.snapshot import RoadMap

PLANES: dict[str, tuple[str, ...]] = {
    "detections": ("occupied", "score", "cos", "sin"),
    "points": ("density", "height"),
    "messages": ("occupied", "score", "cos", "sin", "fresh"),
    "velocity": ("vx", "vy"),
    "map": LAYERS,
}
"""Planes of each channel, in order."""

DTYPES = ("uint8", "float32")

FASTEST_M_S = 40.0

Planes = NDArray[np.uint8]


@dataclass(kw_only=True, eq=False)
class BevImageView(View):
    """A square picture around the agent, heading up. See the module for its planes.

    Attributes:
        size: height and width in pixels.
        metres: height and width of what it shows.
        channels: what it shows, in this order: names in `PLANES`.
        dtype: "uint8" (0 to 255) or "float32" (0 to 1).
    """

    size: int = 128
    metres: float = 96.0
    channels: Sequence[str] = ("detections", "points", "messages", "map")
    dtype: str = "uint8"
    alone: ClassVar[str | None] = "picture"

    def __post_init__(self) -> None:
        require_count(8, 4096, size=self.size)
        require_positive(metres=self.metres)
        require_choice("dtype", self.dtype, DTYPES)
        if isinstance(self.channels, str) or not self.channels:
            accepted = ", ".join(PLANES)
            raise InvalidValueError(f"channels must be a sequence of {accepted}, got {self.channels!r}")
        for name in self.channels:
            require_choice("channel", name, PLANES)
        if len(set(self.channels)) < len(self.channels):
            raise InvalidValueError(f"channels must be distinct, got {self.channels!r}")
        self._road_map: RoadMap | None = None
        self._raster: MapRaster

    @property
    def planes(self) -> tuple[str, ...]:
        """Names of all planes in order, as "detections.score"."""
        return tuple(f"{name}.{plane}" for name in self.channels for plane in PLANES[name])

    def spaces(self) -> dict[str, spaces.Box]:
        shape = (len(self.planes), self.size, self.size)
        if self.dtype == "uint8":
            return {"picture": spaces.Box(0, 255, shape, np.uint8)}
        return {"picture": spaces.Box(0.0, 1.0, shape, np.float32)}

    def begin(self, road_map: RoadMap) -> None:
        """Draw the map, unless it is the same as in the last episode."""
        if "map" in self.channels and road_map is not self._road_map:
            self._road_map, self._raster = road_map, MapRaster.of(road_map, self.metres / self.size / 2)

    def show(self, scene: Scene) -> Arrays:
        picture = np.zeros((len(self.planes), self.size, self.size), np.uint8)
        first = 0
        for name in self.channels:
            count = len(PLANES[name])
            self._paint(name, picture[first : first + count], scene)
            first += count
        return {"picture": picture if self.dtype == "uint8" else picture.astype(np.float32) / np.float32(255)}

    def _paint(self, channel: str, planes: Planes, scene: Scene) -> None:
        pixel_m = self.metres / self.size
        if channel == "detections":
            rows = as_rows(scene.observation.detections)
            _paint_rows(planes, rows, _appearance(rows), pixel_m)
        elif channel == "points":
            paint_points(planes, _points(scene.observation), pixel_m)
        elif channel == "messages":
            _paint_messages(planes, scene.received, pixel_m)
        elif channel == "velocity":
            rows = scene.received.rows
            _paint_rows(planes, rows, 0.5 + rows[:, VELOCITY] / FASTEST_M_S / 2, pixel_m)
        else:
            raster = self._raster
            pose = scene.observation.pose.xyz_yaw
            paint_map(planes, raster.cells, raster.origin_m, raster.cell_m, pose, pixel_m)


def _paint_rows(planes: Planes, rows: Floats, values: Floats, pixel_m: float) -> None:
    """Paint boxes (N, 11) with values (N, C) in [0, 1], the surest last."""
    order = np.argsort(rows[:, SCORE], kind="stable")
    shades = np.rint(255 * np.clip(values[order], 0.0, 1.0)).astype(np.uint8)
    paint_boxes(planes, np.ascontiguousarray(rows[order, BOX]), shades, pixel_m)


def _appearance(rows: Floats) -> Floats:
    """Return the values of occupied, score, cos and sin, (N, 4)."""
    yaw = rows[:, 6]
    return np.column_stack([np.ones(len(rows)), rows[:, SCORE], 0.5 + np.cos(yaw) / 2, 0.5 + np.sin(yaw) / 2])


def _paint_messages(planes: Planes, received: Received, pixel_m: float) -> None:
    fresh = 1 / (1 + received.age_s)
    points = np.zeros((len(received.points), 7))
    points[:, :3] = received.points
    shades = np.zeros((len(points), len(planes)), np.uint8)
    shades[:, 0], shades[:, 4] = 255, np.rint(255 * fresh[received.of_point])
    paint_boxes(planes, points, shades, pixel_m)
    values = np.column_stack([_appearance(received.rows), fresh[received.of_box]])
    _paint_rows(planes, received.rows, values, pixel_m)


def _points(observation: Observation) -> Floats:
    parts = [sweep.points for sweep in observation.sweeps.values()]
    return np.concatenate([np.zeros((0, 3)), *parts])
