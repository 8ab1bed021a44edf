"""BevImage: a square picture around the agent, seen from above, with the agent's heading up.

The agent is in the middle. Row 0 is farthest ahead (x), column 0 farthest to the left (y). With
`uplink="action(form=cells)"` the cells of a message divide the same square.

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

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray
from PIL import Image, ImageDraw

from coopsim.envs.wrappers.base_wrappers import cooperative_env
from coopsim.envs.wrappers.received import BOX, SCORE, VELOCITY, Arrays, Received, Scene, View, as_rows
from coopsim.errors import InvalidValueError
from coopsim.geometry.se3 import Floats
from coopsim.support.checks import require_choice, require_count, require_positive
from coopsim.support.kernels import njit
from coopsim.types import Observation
from coopsim.world.snapshot import RoadMap

LAYERS = ("lanes", "crosswalks", "pavements", "buildings", "markings")
"""Fields of a `RoadMap`; layer k is bit k of a cell."""

_MOST_CELLS = 64_000_000

LOWEST_M, HIGHEST_M = -1.0, 5.0
"""Heights of points that are shown as the least and the largest brightness."""

MANY_POINTS = 64
"""Number of points of a pixel from which it is as bright as can be."""

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
        channels: channels in this order: names in `PLANES`.
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

    def require(self, env: Any) -> None:
        """Require cells of messages, where there are any, on the same square as the picture."""
        part = next(iter(cooperative_env(env).agent_specs.values())).message
        if part is not None and part.form == "cells" and part.metres != self.metres:
            raise InvalidValueError(
                f"metres must be those of the cells of messages, {part.metres:g}, got {self.metres:g}"
            )

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


@dataclass(frozen=True, slots=True, eq=False)
class MapRaster:
    """A bitmap of a road map in the world frame.

    Attributes:
        cells: (H, W) uint8, a bit for each of `LAYERS`; row and column grow with y and x.
        origin_m: (2,) x, y of the outer corner of the first cell.
        cell_m: size of a cell.
    """

    cells: NDArray[np.uint8]
    origin_m: Floats
    cell_m: float

    @classmethod
    def of(cls, road_map: RoadMap, cell_m: float) -> MapRaster:
        """Draw a map in cells of this size, or larger ones where the map would have too many."""
        outlines = [outline for layer in LAYERS for outline in getattr(road_map, layer)]
        if not outlines:
            return cls(np.zeros((1, 1), np.uint8), np.zeros(2), cell_m)
        corners = np.concatenate(outlines)
        origin, extent = corners.min(axis=0), np.maximum(np.ptp(corners, axis=0), cell_m)
        cell_m = max(cell_m, math.sqrt(float(extent.prod()) / _MOST_CELLS))
        width, height = (np.floor(extent / cell_m).astype(int) + 1).tolist()
        cells = np.zeros((height, width), np.uint8)
        for bit, layer in enumerate(LAYERS):
            picture = Image.new("1", (width, height))
            draw = ImageDraw.Draw(picture)
            for outline in getattr(road_map, layer):
                draw.polygon([(x, y) for x, y in ((outline - origin) / cell_m).tolist()], fill=1)
            cells |= np.asarray(picture, np.uint8) << bit
        return cls(cells, origin, cell_m)


@njit(cache=True, nogil=True)
def paint_boxes(planes: Planes, boxes: Floats, values: Planes, pixel_m: float) -> None:
    """Fill the footprints of boxes (N, 7), one after another, each with its values (N, C), a plane each.

    The pixel under a box's centre is filled, however small the box.
    """
    size = planes.shape[1]
    for n in range(len(boxes)):
        x, y, half_l, half_w = boxes[n, 0], boxes[n, 1], boxes[n, 3] / 2, boxes[n, 4] / 2
        cos, sin = np.cos(boxes[n, 6]), np.sin(boxes[n, 6])
        reach_x, reach_y = abs(cos) * half_l + abs(sin) * half_w, abs(sin) * half_l + abs(cos) * half_w
        middle_row, middle_column = size / 2 - x / pixel_m, size / 2 - y / pixel_m
        for row in _span(middle_row, reach_x / pixel_m, size):
            for column in _span(middle_column, reach_y / pixel_m, size):
                ahead, left = (middle_row - row - 0.5) * pixel_m, (middle_column - column - 0.5) * pixel_m
                inside = abs(ahead * cos + left * sin) <= half_l and abs(left * cos - ahead * sin) <= half_w
                if inside or (row == np.floor(middle_row) and column == np.floor(middle_column)):
                    for plane in range(len(planes)):
                        planes[plane, row, column] = values[n, plane]


@njit(cache=True, nogil=True)
def paint_points(planes: Planes, points: Floats, pixel_m: float) -> None:
    """Paint points (N, 3): the logarithm of their number in the first plane, the highest one's height in the second."""
    size = planes.shape[1]
    counts, highest = np.zeros((size, size), np.int64), np.full((size, size), LOWEST_M)
    for n in range(len(points)):
        row, column = np.floor(size / 2 - points[n, 0] / pixel_m), np.floor(size / 2 - points[n, 1] / pixel_m)
        if 0 <= row < size and 0 <= column < size:
            counts[int(row), int(column)] += 1
            highest[int(row), int(column)] = max(highest[int(row), int(column)], points[n, 2])
    for row in range(size):
        for column in range(size):
            if counts[row, column]:
                density = min(1.0, np.log1p(counts[row, column]) / np.log1p(MANY_POINTS))
                height = (highest[row, column] - LOWEST_M) / (HIGHEST_M - LOWEST_M)
                planes[0, row, column] = np.uint8(255 * density)
                planes[1, row, column] = np.uint8(255 * min(1.0, height))


@njit(cache=True, nogil=True)
def paint_map(planes: Planes, cells: Planes, origin_m: Floats, cell_m: float, pose: Floats, pixel_m: float) -> None:
    """Look the map up under each pixel: bit k of its cell is plane k.

    The bitmap (H, W) is in the world frame, and `origin_m` (2,) the corner of its first cell; `pose` (4,) is the
    agent's x, y, z m and heading rad.
    """
    size = planes.shape[1]
    cos, sin = np.cos(pose[3]), np.sin(pose[3])
    for row in range(size):
        ahead = (size / 2 - row - 0.5) * pixel_m
        for column in range(size):
            left = (size / 2 - column - 0.5) * pixel_m
            x = np.floor((pose[0] + ahead * cos - left * sin - origin_m[0]) / cell_m)
            y = np.floor((pose[1] + ahead * sin + left * cos - origin_m[1]) / cell_m)
            if 0 <= x < cells.shape[1] and 0 <= y < cells.shape[0]:
                cell = cells[int(y), int(x)]
                for plane in range(len(planes)):
                    planes[plane, row, column] = 255 * ((cell >> plane) & 1)


@njit(cache=True, nogil=True)
def _span(middle: float, reach: float, size: int) -> range:
    """Return the pixels of an axis that a box may touch."""
    first, last = np.floor(middle - reach), np.floor(middle + reach)
    return range(int(max(first, 0.0)), int(min(last, size - 1.0)) + 1)
