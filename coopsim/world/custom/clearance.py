"""Clearance in a custom place: nothing may stand on its roads, or in something else."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from coopsim.config.annotated import Line
from coopsim.config.checked_entry import Entry
from coopsim.geometry import exact
from coopsim.geometry.boxes import Boxes3D
from coopsim.geometry.iou import iou_bev
from coopsim.geometry.se3 import Floats
from coopsim.support.kernels import njit
from coopsim.types.taxonomy import ObjectClass
from coopsim.world.custom.conflicts import CHORD_M, middle_line
from coopsim.world.custom.roads import Roads
from coopsim.world.models import make_models
from coopsim.world.places.layout import Bay, StartSlot
from coopsim.world.traffic.rules import PARKED_ASIDE_M

_PASSING_M = 1.7  # from the middle of a lane to the side of a parked vehicle: a bus passes without stopping
_SAMPLE_M = 1.0  # along an outline; no lane is so narrow
_START_M = 14.0  # the longest bus, and the variation of its start
_LANE_APART_M = 2.0  # vehicles are wider, but side by side in two lanes they do not obstruct each other


class MiddleLines:
    """Distances from the middle lines of roads.

    Attributes:
        starts: (S, 2) m, first points of the segments of all middle lines.
        ends: (S, 2) m, their last points.
    """

    def __init__(self, roads: Roads) -> None:
        lines = [(road, roads.lane(piece)) for road, pieces in roads.pieces.items() for piece in pieces]
        corners = [middle_line(lane) for _, lane in lines]
        self.starts, self.ends = (np.vstack([each[part] for each in corners]) for part in (np.s_[:-1], np.s_[1:]))
        counts = [len(each) - 1 for each in corners]
        widths_m = [lane.widths_at(lane.stations(CHORD_M)) for _, lane in lines]
        self._half_m = np.concatenate([np.maximum(each[:-1], each[1:]) for each in widths_m]) / 2
        self._road = np.repeat(np.arange(len(lines)), counts)
        self._roads, self._names = roads, [road for road, _ in lines]

    def are_met(self, points: Floats) -> bool:
        """Return whether one of `points` (N, 2) m is on a road."""
        return _worst(points, self.starts, self.ends, self._half_m)[0] >= 0

    def require_off_roads(self, points: Floats, what: str, *keys: str | int, least_m: float | None = None) -> None:
        """Raise an error if one of `points` (N, 2) m of an object is on a road.

        They must be `least_m` from the middle of every lane; None: half the lane's width. `what` is the object's name
        in the error, and `keys` lead to it in the description.
        """
        least = self._half_m if least_m is None else np.full(len(self._half_m), least_m)
        segment, distance_m = _worst(np.ascontiguousarray(points), self.starts, self.ends, least)
        if segment >= 0:
            accepted_m = least[segment]
            raise self._roads.root.part(*keys).error(
                f"{what} must be at least {accepted_m:g} m from the middle of every lane, got "
                f"{distance_m:.2f} m from that of the road in {self.spot(segment)}: it would stand in the way"
            )

    def spot(self, segment: int) -> str:
        """Return where in the description the road of a segment is."""
        return self._roads.entry(self._names[self._road[segment]]).spot


@njit(cache=True, nogil=True)
def _worst(points: Floats, start: Floats, end: Floats, least_m: Floats) -> tuple[int, float]:
    """Return the segment that points (N, 2) come too near to by most, and their distance from it; -1 if there is none.

    Segments lead from `start` (S, 2) m to `end` (S, 2) m, and `least_m` (S,) are their least distances.
    """
    worst, worst_m, near_m = -1, 0.0, np.inf
    low_x, low_y, high_x, high_y = points[:, 0].min(), points[:, 1].min(), points[:, 0].max(), points[:, 1].max()
    for k in range(len(start)):
        ax, ay, bx, by, reach = start[k, 0], start[k, 1], end[k, 0], end[k, 1], least_m[k]
        left, right, lower, upper = min(ax, bx) - reach, max(ax, bx) + reach, min(ay, by) - reach, max(ay, by) + reach
        if right < low_x or left > high_x or upper < low_y or lower > high_y:
            continue
        rx, ry = bx - ax, by - ay
        length_m2 = max(rx * rx + ry * ry, 1e-12)
        for i in range(len(points)):
            x, y = points[i, 0], points[i, 1]
            if x < left or x > right or y < lower or y > upper:
                continue
            share = min(max(((x - ax) * rx + (y - ay) * ry) / length_m2, 0.0), 1.0)
            distance_m = exact.hypot(x - ax - share * rx, y - ay - share * ry)
            if distance_m - reach < worst_m:
                worst, worst_m, near_m = k, distance_m - reach, distance_m
    return worst, near_m


def along_outline(corners: Floats) -> Floats:
    """Return closely spaced points (N, 2) m on a closed line through corners (K, 2) m."""
    return _spaced(np.ascontiguousarray(corners))


@njit(cache=True, nogil=True)
def _spaced(corners: Floats) -> Floats:
    count, total = len(corners), 0
    steps, along = np.empty(count, np.int64), np.empty((count, 2))
    for k in range(count):
        after = (k + 1) % count
        along[k, 0], along[k, 1] = corners[after, 0] - corners[k, 0], corners[after, 1] - corners[k, 1]
        steps[k] = max(np.ceil(exact.hypot(along[k, 0], along[k, 1]) / _SAMPLE_M), 1.0)
        total += steps[k]
    points, n = np.empty((total, 2)), 0
    for k in range(count):
        for part in range(steps[k]):
            share = part / steps[k]
            points[n, 0], points[n, 1] = corners[k, 0] + share * along[k, 0], corners[k, 1] + share * along[k, 1]
            n += 1
    return points


def require_space_to_park(bays: Sequence[Bay], root: Entry, middles: MiddleLines) -> None:
    """Raise an error for a bay whose vehicle would stand on a road, or in a vehicle in another bay."""
    rows = np.array([_footprint(bay) for bay in bays]).reshape(-1, 7)
    for k, corners in enumerate(Boxes3D.from_array(rows).corners[:, :4, :2]):
        side = "the side of the parked vehicle"
        middles.require_off_roads(along_outline(corners), side, "parked", k, least_m=_PASSING_M)
    rows[:, 3:5] += 2 * PARKED_ASIDE_M
    pair = _overlapping(rows)
    if pair is not None:
        first, second = pair
        raise root.part("parked", second).error(
            f"the vehicle parked here needs {rows[second, 3]:.1f} x {rows[second, 4]:.1f} m, and would overlap with "
            f"the one parked in {root.part('parked', first).spot}"
        )


def require_space_to_start(slots: Sequence[StartSlot], roads: Roads) -> None:
    """Raise an error for a start across another start's lane."""
    rows = np.zeros((len(slots), 7))
    for row, slot in zip(rows, slots, strict=True):
        lane = roads.network.get_lane(slot.lane)
        row[:2], row[6] = lane.position(slot.along_m, 0.0), lane.heading_at(slot.along_m)
    rows[:, 3:6] = _START_M, _LANE_APART_M, 1.0
    pair = _overlapping(rows)
    if pair is not None:
        here, there = (roads.root.part("starts", k) for k in pair[::-1])
        raise here.error(f"a vehicle that starts here would overlap with one that starts in {there.spot}")


def _overlapping(rows: Floats) -> tuple[int, int] | None:
    """Return the first two of boxes (N, 7) that overlap."""
    pairs = np.argwhere(np.triu(iou_bev(rows, rows) > 0, 1)) if len(rows) else np.zeros((0, 2), np.int64)
    return (int(pairs[0, 0]), int(pairs[0, 1])) if len(pairs) else None


def _footprint(bay: Bay) -> list[float]:
    length_m, width_m = _largest_m((ObjectClass.CAR, ObjectClass.VAN) if bay.label is None else (bay.label,))
    return [bay.x_m, bay.y_m, 0.5, length_m, width_m, 1.0, bay.heading_rad]


def _largest_m(labels: tuple[ObjectClass, ...]) -> tuple[float, float]:
    """Return the length and width that hold all models of some classes."""
    sizes = np.array([model.size_m for model in make_models(varied=True) if model.label in labels])
    return float(sizes[:, 0].max()), float(sizes[:, 1].max())


_TWICE, _OTHER = 2, 3
_ROUNDING_M = 2e-3  # that a corner may lie inwards of its neighbours: coordinates are often whole millimetres


def convex(outline: Line, entry: Entry, advice: str = "write another shape as several") -> Floats:
    """Return the corners (K, 2) m of a convex outline, counter-clockwise, from those in either direction.

    The entry's error about another shape ends with `advice`.
    """
    corners = np.array(outline, dtype=np.float64)
    way = _way_round(corners)
    if way == _TWICE:
        raise entry.error("outline must have every corner once; the last is joined to the first anyway")
    if way == _OTHER:
        raise entry.error(f"outline must be convex: {advice}")
    return corners if way > 0 else np.ascontiguousarray(corners[::-1])


@njit(cache=True, nogil=True)
def _way_round(corners: Floats) -> int:
    """Return the way round of a convex outline (K, 2) m: 1 counter-clockwise, -1 clockwise, else `_TWICE`, `_OTHER`."""
    count = len(corners)
    turns, inwards_m, turned_rad = np.empty(count), np.empty(count), 0.0
    for k in range(count):
        here, there, beyond = corners[k], corners[(k + 1) % count], corners[(k + 2) % count]
        ax, ay, bx, by = there[0] - here[0], there[1] - here[1], beyond[0] - there[0], beyond[1] - there[1]
        if (ax == 0 and ay == 0) or (bx == 0 and by == 0):
            return _TWICE
        turns[k] = ax * by - ay * bx
        inwards_m[k] = -turns[k] / max(exact.hypot(ax + bx, ay + by), exact.hypot(ax, ay))
        turned_rad += exact.arctan2(turns[k], ax * bx + ay * by)
    way = 1 if turns.sum() > 0 else -1
    once_round = abs(turned_rad - way * 2 * np.pi) < 1e-6
    if not once_round or (way * inwards_m).max() > _ROUNDING_M or (way * turns).max() <= 0:
        return _OTHER
    return way
