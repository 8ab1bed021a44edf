"""Expected LiDAR returns of each actor, without casting rays: for environments without a LiDAR.

A sensor sees an actor's box as a rectangle, `angular width / column step` columns wide and as many beams high as lie
between its bottom and its top. Its visible share is estimated by lines of sight to nine points of that rectangle, which
other actors' boxes and the boxes around solid scenery block. In rain and fog, only the share that a surface of usual
brightness returns through that air is counted.
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
"""Ends of the lines of sight, in widths from the middle of the rectangle."""

_UP = np.array([0.15, 0.5, 0.85])
"""Ends of the lines of sight, in heights from the bottom of the rectangle."""

_BOUNCED = 0.24
"""Mean reflectivity times cosine of incidence of LiDARs' hits on actors at the crossing and on the highway."""

_REFERENCE_M, _DROPOUT_ENERGY = 50.0, 0.02  # the defaults of `LidarConfig`

_SLACK_M = 1e-3  # for rounding, in the preselection of obstacles


class LineOfSight:
    """Estimates the returns from every actor; one object serves any number of agents.

    Args:
        static: the scenery. The upright box around each solid component of it hides what is behind.
        pattern: beams of the imagined sensor.
        columns: its firings per revolution.
        range_m: its range.
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
        solid = [box for part in static if is_closed(part.vertices, part.faces) for box in _component_boxes(part)]
        self._scenery = np.array(solid).reshape(-1, 7)
        self._elevation = np.sort(pattern.elevation_rad)
        self._step_rad, self._range_m = 2 * np.pi / columns, range_m
        self._extinction_per_m = (weather or Weather()).extinction_per_m

    def expected_returns(self, origin_m: Floats, actors: Actors, own_id: int | None) -> Ints:
        """Return the expected number (N,) of returns from each of N actors.

        Args:
            origin_m: (3,) the sensor's position in the world frame.
            actors: N of them.
            own_id: the actor that carries the sensor: it gives no returns and hides nothing.
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
        """Return the share (N,) of rays on surfaces so far away that return; in clear air all do."""
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
    """Return the widths (N,) m of boxes (N, 7) across the directions `toward` (N, 2)."""
    aside = np.arctan2(toward[:, 1], toward[:, 0]) - boxes[:, 6]
    width: Floats = boxes[:, 3] * np.abs(np.sin(aside)) + boxes[:, 4] * np.abs(np.cos(aside))
    return width


def _component_boxes(part: StaticPart) -> list[Floats]:
    """Return upright boxes (7,) around the connected components of a part."""
    edges = part.faces[:, [0, 1, 0, 2]].reshape(-1, 2).T
    vertices = len(part.vertices)
    adjacency = coo_array((np.ones(edges.shape[1]), edges), shape=(vertices, vertices))
    components, component = connected_components(adjacency, directed=False)
    corners = [part.vertices[component == k] for k in range(components)]
    spans = [(points.min(axis=0), points.max(axis=0)) for points in corners if len(points) > 1]
    return [np.array([*(low + high) / 2, *(high - low), 0.0]) for low, high in spans]


@njit(cache=True, nogil=True)
def _visible_shares(
    origin: Floats, boxes: Floats, wanted: Mask, obstacles: Floats, blocks: Mask, across: Floats, up: Floats
) -> Floats:
    """Return the share (N,) of unblocked lines from `origin` to each box (N, 7); 0 for boxes not `wanted` (N,).

    Obstacles (M, 7) begin with the boxes; those in the mask `blocks` (M,) block lines to other boxes. Lines end at all
    pairs of `across` and `up`.
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
            # Most obstacles are farther from the middle line than both are wide, so they block no line.
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
    """Return whether a box's middle is within `reach_m` of a horizontal line from `start` (unit vector, length)."""
    dx, dy = box[0] - start[0], box[1] - start[1]
    along = min(max(dx * line[0] + dy * line[1], 0.0), line[2])
    aside_x, aside_y = dx - along * line[0], dy - along * line[1]
    return bool(aside_x * aside_x + aside_y * aside_y <= reach_m * reach_m)


@njit(cache=True, nogil=True)
def _cuts(start: Floats, end: Floats, box: Floats, cos: float, sin: float) -> bool:
    """Return whether a line between two points meets a box (7,), by its slabs (Kay and Kajiya 1986)."""
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
