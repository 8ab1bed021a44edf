"""Expected LiDAR returns of each actor, without casting rays: for environments without a LiDAR.

A sensor sees an actor's box as a rectangle, `angular width / column step` columns wide and as many beams high as lie
between its bottom and its top. Its visible share is estimated by lines of sight to nine points of that rectangle, which
other actors' boxes and the boxes of scenery block; those of foliage let a share of each line through. In rain and fog,
only the share that a surface of usual brightness returns through that air is counted.
"""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from coopsim.geometry.se3 import Floats
from coopsim.sensors.lidar.patterns import BeamPattern
from coopsim.sensors.scene import is_closed
from coopsim.sensors.weather import Weather
from coopsim.support.kernels import njit
from coopsim.types import Ints
from coopsim.world.snapshot import Actors, StaticPart

_ACROSS = np.array([-0.4, 0.0, 0.4])
"""Ends of the lines of sight, in widths from the middle of the rectangle."""

_UP = np.array([0.15, 0.5, 0.85])
"""Ends of the lines of sight, in heights from the bottom of the rectangle."""

_BOUNCED = 0.24
"""Mean reflectivity times cosine of incidence of LiDARs' hits on actors at the crossing and on the highway."""

_REFERENCE_M, _DROPOUT_ENERGY = 50.0, 0.02  # the defaults of `LidarConfig`

_NOBODY = -1

_SLACK_M = 1e-3  # for rounding, in the preselection of obstacles


class ReturnsEstimator:
    """Estimate of the returns from every actor; one object serves any number of agents.

    Boxes of the scenery hide objects behind them, as far as they are opaque; a part without boxes of its own has the
    upright box around each of its closed components. `columns` are the imagined sensor's firings per revolution.
    """

    def __init__(
        self,
        static: Sequence[StaticPart],
        pattern: BeamPattern,
        columns: int,
        range_m: float,
        weather: Weather | None = None,
    ) -> None:
        boxes = [_boxes_of(part) for part in static]
        self._scenery = np.concatenate([np.zeros((0, 7)), *boxes])
        through = np.repeat([1.0 - part.opacity for part in static], [len(each) for each in boxes])
        tall = self._scenery[:, 2] + self._scenery[:, 5] / 2 > 0.0  # lines end above the ground
        self._scenery, self._through = self._scenery[tall], through[tall]
        self._elevation = np.sort(pattern.elevation_rad)
        self._step_rad, self._range_m = 2 * np.pi / columns, range_m
        self._extinction_per_m = (weather or Weather()).extinction_per_m

    def with_beams(self, pattern: BeamPattern) -> ReturnsEstimator:
        """Return an estimate by other beams, of the same scenery, range and weather."""
        other = copy(self)
        other._elevation = np.sort(pattern.elevation_rad)
        return other

    def expected_returns(self, origins_m: Floats, actors: Actors, own_ids: Sequence[int | None]) -> Ints:
        """Return the expected numbers (A, N) of returns from each of N actors to sensors at `origins_m` (A, 3), world
        frame.

        The carriers `own_ids` (A,) give their own sensors no returns and hide nothing from them.
        """
        boxes = actors.boxes.array
        own_id = np.array([_NOBODY if own is None else own for own in own_ids], np.int64)
        obstacles = np.concatenate([boxes, self._scenery])
        through = np.concatenate([np.zeros(len(boxes)), self._through])
        shares, distance_m = _visible_shares(
            origins_m, actors.id, own_id, self._range_m, obstacles, through, _ACROSS, _UP
        )
        sensor, seen = np.nonzero(shares)
        away, box = boxes[seen, :3] - origins_m[sensor], boxes[seen]
        ground_m = np.sqrt(away[:, 0] * away[:, 0] + away[:, 1] * away[:, 1])
        rays = self._columns_over(away, ground_m, box) * self._beams_over(away, ground_m, box)
        share = shares[sensor, seen] * self._share_returned(distance_m[sensor, seen])
        returns = np.zeros(shares.shape, np.int64)
        returns[sensor, seen] = np.floor(rays * share)
        return returns

    def _share_returned(self, distance_m: Floats) -> Floats | float:
        """Return the share (N,) of rays on surfaces so far away that return; in clear air all do."""
        if self._extinction_per_m == 0:
            return 1.0
        through = np.exp(-2 * self._extinction_per_m * distance_m)
        energy = _BOUNCED * through * (_REFERENCE_M / np.maximum(distance_m, 1.0)) ** 2
        share: Floats = -np.expm1(-energy / _DROPOUT_ENERGY)
        return share

    def _columns_over(self, away_m: Floats, ground_m: Floats, boxes: Floats) -> Floats:
        """Return the number of columns (N,) over boxes (N, 7).

        Their middles are `away_m` (N, 3) from the sensor, and on the ground at the distance `ground_m` (N,).
        """
        distance = np.maximum(ground_m, 1e-6)
        columns: Floats = 2 * np.arctan2(_width_across(away_m, boxes) / 2, distance) / self._step_rad
        return columns

    def _beams_over(self, away_m: Floats, ground_m: Floats, boxes: Floats) -> Ints:
        """Return the number of beams (N,) over the same."""
        middle, half = away_m[:, 2], boxes[:, 5] / 2
        low, high = np.arctan2(middle - half, ground_m), np.arctan2(middle + half, ground_m)
        beams: Ints = np.searchsorted(self._elevation, high, "right") - np.searchsorted(self._elevation, low)
        return beams


def _width_across(toward: Floats, boxes: Floats) -> Floats:
    """Return the widths (N,) m of boxes (N, 7) across the directions `toward` (N, 2 or 3)."""
    aside = np.arctan2(toward[:, 1], toward[:, 0]) - boxes[:, 6]
    width: Floats = boxes[:, 3] * np.abs(np.sin(aside)) + boxes[:, 4] * np.abs(np.cos(aside))
    return width


def _boxes_of(part: StaticPart) -> Floats:
    """Return the boxes (K, 7) that stand for a part; none for an open surface without boxes of its own."""
    if part.boxes is not None:
        return part.boxes
    closed = is_closed(part.vertices, part.faces) if part.closed is None else part.closed
    return np.array(_component_boxes(part)).reshape(-1, 7) if closed else np.zeros((0, 7))


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
    origins: Floats,
    ids: Ints,
    own_id: Ints,
    range_m: float,
    obstacles: Floats,
    through: Floats,
    across: Floats,
    up: Floats,
) -> tuple[Floats, Floats]:
    """Return the shares (A, N) of lines from each of `origins` that reach each actor, and the distances (A, N).

    Obstacles (M, 7) begin with the boxes of the actors `ids` (N,); the actor `own_id` (A,) blocks none of its sensor's
    lines. An obstacle lets the share `through` (M,) of a line pass. Lines end at all pairs of `across` and `up`. Shares
    are 0 for `own_id` and beyond `range_m`.
    """
    shares, distance_m = np.zeros((len(origins), len(ids))), np.zeros((len(origins), len(ids)))
    cos, sin = np.cos(obstacles[:, 6]), np.sin(obstacles[:, 6])
    radius, farthest = np.hypot(obstacles[:, 3], obstacles[:, 4]) / 2, np.abs(across).max()
    widest_m = 2 * radius[: len(ids)].max() if len(ids) else 0.0
    x, y, gap, reach = (
        np.empty(len(obstacles)),
        np.empty(len(obstacles)),
        np.empty(len(obstacles)),
        np.empty(len(obstacles)),
    )
    which, between = np.empty(len(obstacles), np.int64), np.empty(len(obstacles), np.int64)
    end, start = np.empty(3), np.empty((len(obstacles), 3))
    for a in range(len(origins)):
        origin = origins[a]
        count = _near(which, x, y, reach, obstacles, radius, origin, len(ids), range_m + 2 * widest_m)
        for k in range(count):
            m = which[k]
            _turn(start[m], origin, obstacles[m], cos[m], sin[m])
        for n in range(len(ids)):
            z = obstacles[n, 2] - origin[2]
            distance_m[a, n] = np.sqrt(x[n] * x[n] + y[n] * y[n] + z * z)
            if ids[n] == own_id[a]:
                distance_m[a, n] = x[n] = np.inf  # in nobody's way
        for n in range(len(ids)):
            if distance_m[a, n] > range_m:
                continue
            distance = max(np.hypot(x[n], y[n]), 1e-6)
            ux, uy = x[n] / distance, y[n] / distance
            width = obstacles[n, 3] * abs(uy * cos[n] - ux * sin[n]) + obstacles[n, 4] * abs(ux * cos[n] + uy * sin[n])
            # Most obstacles are farther from the middle line than both are wide, so they block no line.
            _measure_gaps(gap[:count], x, y, reach, (ux, uy, distance), farthest * width + _SLACK_M)
            gap[n] = np.inf
            candidates = 0
            for k in range(count):
                if gap[k] <= 0:
                    between[candidates] = which[k]
                    candidates += 1
            clear = 0.0
            for i in range(len(across)):
                for j in range(len(up)):
                    end[0] = obstacles[n, 0] - uy * across[i] * width
                    end[1] = obstacles[n, 1] + ux * across[i] * width
                    end[2] = obstacles[n, 2] + (up[j] - 0.5) * obstacles[n, 5]
                    share = 1.0
                    for k in range(candidates):
                        m = between[k]
                        if _cuts(start[m], end, obstacles[m], cos[m], sin[m]):
                            share *= through[m]
                            if share == 0.0:
                                between[k], between[0] = between[0], m  # it probably hides the next line's end, too
                                break
                    clear += share
            shares[a, n] = clear / (len(across) * len(up))
    return shares, distance_m


@njit(cache=True, nogil=True)
def _near(
    which: Ints,
    x: Floats,
    y: Floats,
    reach: Floats,
    obstacles: Floats,
    radius: Floats,
    origin: Floats,
    actors: int,
    range_m: float,
) -> int:
    """Fill in the first `actors` of `obstacles` (M, 7), and of the others those within `range_m` of `origin`; count
    them.

    `which` becomes their numbers, `x` and `y` their offsets from `origin` (3,), `reach` their radii, (M,) each.
    """
    count = 0
    for m in range(len(obstacles)):
        dx, dy, far = obstacles[m, 0] - origin[0], obstacles[m, 1] - origin[1], range_m + radius[m]
        which[count], x[count], y[count], reach[count] = m, dx, dy, radius[m]
        count += m < actors or dx * dx + dy * dy <= far * far
    return count


@njit(cache=True, nogil=True)
def _measure_gaps(
    gap: Floats, x: Floats, y: Floats, radius: Floats, line: tuple[float, float, float], reach_m: float
) -> None:
    """Fill `gap` (M,): not above 0 where a place (`x`, `y`) is within `radius` + `reach_m` of a line from the origin.

    The line is horizontal: unit vector and length. There are no branches, so this is compiled to vector instructions.
    """
    for m in range(len(gap)):
        along = min(max(x[m] * line[0] + y[m] * line[1], 0.0), line[2])
        aside_x, aside_y = x[m] - along * line[0], y[m] - along * line[1]
        reach = radius[m] + reach_m
        gap[m] = aside_x * aside_x + aside_y * aside_y - reach * reach


@njit(cache=True, nogil=True)
def _turn(turned: Floats, point: Floats, box: Floats, cos: float, sin: float) -> None:
    """Fill `turned` (3,): a point (3,) in the axes of a box (7,)."""
    turned[0] = (point[0] - box[0]) * cos + (point[1] - box[1]) * sin
    turned[1] = (point[1] - box[1]) * cos - (point[0] - box[0]) * sin
    turned[2] = point[2] - box[2]


@njit(cache=True, nogil=True)
def _cuts(start: Floats, end: Floats, box: Floats, cos: float, sin: float) -> bool:
    """Return whether a line meets a box (7,), by its slabs (Kay and Kajiya 1986).

    `start` (3,) is in the axes of the box, `end` (3,) in those of the world; `cos` and `sin` are those of the box's
    yaw.
    """
    enter, leave = 0.0, 1.0
    for axis in range(3):
        a = start[axis]
        if axis == 0:
            b = (end[0] - box[0]) * cos + (end[1] - box[1]) * sin
        elif axis == 1:
            b = (end[1] - box[1]) * cos - (end[0] - box[0]) * sin
        else:
            b = end[2] - box[2]
        half, run = box[3 + axis] / 2, b - a
        if abs(run) < 1e-12:
            if abs(a) > half:
                return False
            continue
        first, last = (-half - a) / run, (half - a) / run
        enter, leave = max(enter, min(first, last)), min(leave, max(first, last))
        if enter > leave:
            return False
    return True
