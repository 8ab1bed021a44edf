"""What a LiDAR would see of each actor, without casting its rays: for environments that have none.

An actor's box is seen from a sensor as a rectangle, `angular width / column step` columns wide and as many beams high
as lie between its bottom and its top. The share of it that nothing hides is estimated by lines of sight to nine points
of that rectangle, which other actors' boxes and the boxes around solid scenery block. In rain and fog, what is
left is the share that a surface of usual brightness gives back through that air.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numba import njit
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from coopsim.geometry.se3 import Floats
from coopsim.sensors.lidar.patterns import BeamPattern
from coopsim.sensors.scene import is_closed
from coopsim.sensors.weather import Weather
from coopsim.types import Ints, Mask
from coopsim.world.snapshot import Actors, StaticPart

_ACROSS = np.array([-0.4, 0.0, 0.4])
"""Where the lines of sight end, in widths from the middle of the rectangle."""

_UP = np.array([0.15, 0.5, 0.85])
"""The same in heights from its bottom."""

_BOUNCED = 0.24
"""Reflectivity times cosine of incidence: the mean of what LiDARs meet of actors at the crossing and on the highway."""

_REFERENCE_M, _DROPOUT_ENERGY = 50.0, 0.02  # as of a `LidarConfig`, unless told otherwise

_SLACK_M = 1e-3  # for rounding, in deciding which obstacles are worth a closer look


class LineOfSight:
    """Expected returns from every actor; one object serves any number of agents.

    Args:
        static: the scenery. Of each solid piece in it, the upright box around it hides what is behind.
        pattern: the beams of the sensor that there is not.
        columns: its firings per turn.
        range_m: how far it would see.
        weather: around it; None is dry and clear.
    """

    def __init__(
        self,
        static: Sequence[StaticPart],
        pattern: BeamPattern,
        columns: int,
        range_m: float,
        weather: Weather | None = None,
    ) -> None:
        solid = [piece for part in static if is_closed(part.vertices, part.faces) for piece in _pieces(part)]
        self._scenery = np.array(solid).reshape(-1, 7)
        self._elevation = np.sort(pattern.elevation_rad)
        self._step_rad, self._range_m = 2 * np.pi / columns, range_m
        self._extinction_per_m = (weather or Weather()).extinction_per_m

    def expected_returns(self, origin_m: Floats, actors: Actors, own_id: int | None) -> Ints:
        """How many returns a sensor at `origin_m` (3,) in the world may expect of each of N actors, (N,).

        None of the actor that carries it, which hides nothing, either.
        """
        boxes = actors.boxes.array
        others = actors.id != (-1 if own_id is None else own_id)
        obstacles = np.concatenate([boxes, self._scenery])
        blocks = np.concatenate([others, np.ones(len(self._scenery), dtype=np.bool_)])
        distance_m = np.linalg.norm(boxes[:, :3] - origin_m, axis=1)
        near = others & (distance_m <= self._range_m)
        share = _visible_shares(np.asarray(origin_m, dtype=np.float64), boxes, near, obstacles, blocks, _ACROSS, _UP)
        rays = self._columns_over(origin_m, boxes) * self._beams_over(origin_m, boxes)
        returns: Ints = np.floor(rays * share * self._share_returned(distance_m)).astype(np.int64)
        return returns

    def _share_returned(self, distance_m: Floats) -> Floats | float:
        """(N,) of the rays that end on something so far away; in clear air all are taken to be."""
        if self._extinction_per_m == 0:
            return 1.0
        through = np.exp(-2 * self._extinction_per_m * distance_m)
        energy = _BOUNCED * through * (_REFERENCE_M / np.maximum(distance_m, 1.0)) ** 2
        share: Floats = -np.expm1(-energy / _DROPOUT_ENERGY)
        return share

    def _columns_over(self, origin_m: Floats, boxes: Floats) -> Floats:
        toward = boxes[:, :2] - origin_m[:2]
        distance = np.maximum(np.linalg.norm(toward, axis=1), 1e-6)
        columns: Floats = 2 * np.arctan2(_width_across(toward, boxes) / 2, distance) / self._step_rad
        return columns

    def _beams_over(self, origin_m: Floats, boxes: Floats) -> Ints:
        distance = np.linalg.norm(boxes[:, :2] - origin_m[:2], axis=1)
        middle, half = boxes[:, 2] - origin_m[2], boxes[:, 5] / 2
        low, high = np.arctan2(middle - half, distance), np.arctan2(middle + half, distance)
        beams: Ints = np.searchsorted(self._elevation, high, "right") - np.searchsorted(self._elevation, low)
        return beams


def _width_across(toward: Floats, boxes: Floats) -> Floats:
    """(N,) m, how wide boxes (N, 7) look along the directions `toward` (N, 2)."""
    aside = np.arctan2(toward[:, 1], toward[:, 0]) - boxes[:, 6]
    width: Floats = boxes[:, 3] * np.abs(np.sin(aside)) + boxes[:, 4] * np.abs(np.cos(aside))
    return width


def _pieces(part: StaticPart) -> list[Floats]:
    """Upright boxes (7,) around the pieces of a part that do not hang together."""
    ends = part.faces[:, [0, 1, 0, 2]].reshape(-1, 2).T
    count = len(part.vertices)
    pieces, piece = connected_components(
        coo_array((np.ones(ends.shape[1]), ends), shape=(count, count)), directed=False
    )
    corners = [part.vertices[piece == k] for k in range(pieces)]
    spans = [(points.min(axis=0), points.max(axis=0)) for points in corners if len(points) > 1]
    return [np.array([*(low + high) / 2, *(high - low), 0.0]) for low, high in spans]


@njit(cache=True, nogil=True)
def _visible_shares(
    origin: Floats, boxes: Floats, wanted: Mask, obstacles: Floats, blocks: Mask, across: Floats, up: Floats
) -> Floats:
    """(N,) share of lines from `origin` to boxes (N, 7) that no other of the obstacles (M, 7), boxes first, blocks.

    None of boxes that are not `wanted` (N,).
    """
    shares = np.zeros(len(boxes))
    cos, sin = np.cos(obstacles[:, 6]), np.sin(obstacles[:, 6])
    radius, farthest = np.hypot(obstacles[:, 3], obstacles[:, 4]) / 2, np.abs(across).max()
    end, between = np.empty(3), np.empty(len(obstacles), np.int64)
    for n in range(len(boxes)):
        if not wanted[n]:
            continue
        x, y = boxes[n, 0] - origin[0], boxes[n, 1] - origin[1]
        distance = max(np.hypot(x, y), 1e-6)
        x, y = x / distance, y / distance
        width = boxes[n, 3] * abs(y * cos[n] - x * sin[n]) + boxes[n, 4] * abs(x * cos[n] + y * sin[n])
        candidates = 0
        for m in range(len(obstacles)):
            # Most obstacles are beside all lines: farther from the middle one than both are wide.
            reach = radius[m] + farthest * width + _SLACK_M
            if m != n and blocks[m] and _is_near(origin, obstacles[m], (x, y, distance), reach):
                between[candidates] = m
                candidates += 1
        clear = 0
        for i in range(len(across)):
            for j in range(len(up)):
                end[0] = boxes[n, 0] - y * across[i] * width
                end[1] = boxes[n, 1] + x * across[i] * width
                end[2] = boxes[n, 2] + (up[j] - 0.5) * boxes[n, 5]
                hidden = False
                for m in between[:candidates]:
                    if _cuts(origin, end, obstacles[m], cos[m], sin[m]):
                        hidden = True
                        break
                clear += not hidden
        shares[n] = clear / (len(across) * len(up))
    return shares


@njit(cache=True, nogil=True)
def _is_near(start: Floats, box: Floats, line: tuple[float, float, float], reach_m: float) -> bool:
    """Whether the middle of a box is within reach of a horizontal line: unit vector and length from `start`."""
    dx, dy = box[0] - start[0], box[1] - start[1]
    along = min(max(dx * line[0] + dy * line[1], 0.0), line[2])
    aside_x, aside_y = dx - along * line[0], dy - along * line[1]
    return bool(aside_x * aside_x + aside_y * aside_y <= reach_m * reach_m)


@njit(cache=True, nogil=True)
def _cuts(start: Floats, end: Floats, box: Floats, cos: float, sin: float) -> bool:
    """Whether a line between two points meets a box (7,), by its slabs (Kay and Kajiya 1986)."""
    enter, leave = 0.0, 1.0
    for axis in range(3):
        if axis == 0:
            a = (start[0] - box[0]) * cos + (start[1] - box[1]) * sin
            b = (end[0] - box[0]) * cos + (end[1] - box[1]) * sin
        elif axis == 1:
            a = (start[1] - box[1]) * cos - (start[0] - box[0]) * sin
            b = (end[1] - box[1]) * cos - (end[0] - box[0]) * sin
        else:
            a, b = start[2] - box[2], end[2] - box[2]
        half, run = box[3 + axis] / 2, b - a
        if abs(run) < 1e-12:
            if abs(a) > half:
                return False
            continue
        first, last = (-half - a) / run, (half - a) / run
        enter, leave = max(enter, min(first, last)), min(leave, max(first, last))
    return enter <= leave
