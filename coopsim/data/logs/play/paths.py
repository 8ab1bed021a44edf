"""Ways of logged road users on the ground, along which they can go at another speed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from coopsim.data.logs.interpolation import States, between
from coopsim.data.logs.track_log import TrackLog
from coopsim.geometry import exact
from coopsim.geometry.se3 import Floats, wrap_angle
from coopsim.support.arrays import numbered
from coopsim.support.kernels import njit
from coopsim.types import Ints, Mask

_STEP_M = 1.0
"""Longest step between points: in a bend of 8 m the chord then stays within 1.6 cm of it."""

_LEAST_M = 0.25
"""Shortest step: road users that stand in a log move by its noise."""

_APART = 1e5
"""More than any way is long, m, and any part lasts, s: ways stand one behind the other on one axis."""


@dataclass(frozen=True, slots=True, eq=False)
class Paths:
    """Ways of R road users, whose P points stand one way after the other.

    Attributes:
        first: (R + 1,) point at which each begins, and P.
        xy: (P, 2) m.
        heading: (P,) rad, of the road user there.
        along: (P,) m, from the way's start.
        time_s: (P,) s from the episode's start, when the log has the road user there first.
        last_s: (R,) s from the episode's start, when the log has it for the last time.
    """

    first: Ints
    xy: Floats
    heading: Floats
    along: Floats
    time_s: Floats
    last_s: Floats

    @property
    def length(self) -> Floats:
        """Lengths (R,) m."""
        return self.along[self.first[1:] - 1]

    @property
    def owner(self) -> Ints:
        """The way (P,) of each point."""
        return np.repeat(np.arange(len(self.first) - 1), np.diff(self.first))

    def at(self, way: Ints, along: Floats) -> tuple[Floats, Floats, Floats]:
        """Return places (M, 2) m, headings (M,) rad and directions of travel (M, 2) at distances (M,) along ways."""
        row, share = self._between(self.along, way, along)
        step = self.xy[row + 1] - self.xy[row]
        turned = wrap_angle(self.heading[row + 1] - self.heading[row])
        heading = wrap_angle(self.heading[row] + share * turned)
        return self.xy[row] + share[:, None] * step, heading, step / exact.norm(step)[:, None]

    def along_at(self, way: Ints, time_s: float) -> Floats:
        """Return how far (M,) m along their ways the log has road users at a time of the episode."""
        row, share = self._between(self.time_s, way, np.full(len(way), time_s))
        along: Floats = self.along[row] + share * (self.along[row + 1] - self.along[row])
        return along

    def _between(self, column: Floats, way: Ints, value: Floats) -> tuple[Ints, Floats]:
        """Return the points (M,) before values, and the shares (M,) of the steps from there; within the ways' ends."""
        axis = column + _APART * self.owner
        row = np.searchsorted(axis, value + _APART * way, side="right") - 1
        row = np.clip(row, self.first[way], self.first[way + 1] - 2)
        share = (value - column[row]) / (column[row + 1] - column[row])
        return row, np.clip(share, 0.0, 1.0)


def paths_of(log: TrackLog, tracks: Ints, start_s: float, until_s: Floats) -> Paths:
    """Return the ways of tracks (R,), rising, each up to a time (R,) of the log; gaps are bridged.

    A way of one point gets a second one, a step ahead.
    """
    rows = np.flatnonzero(np.isin(log.track, tracks))
    way = np.searchsorted(tracks, log.track[rows])
    early = np.concatenate([[True], way[1:] != way[:-1]]) | (log.time_s[rows] <= until_s[way] + 1e-6)
    rows, way = rows[early], way[early]
    points = _dense(log, rows)
    kept = far_apart(points.xy, way[points.row], _LEAST_M)
    xy, heading, time_s, way_of = points.xy[kept], points.heading[kept], points.time_s[kept], way[points.row][kept]
    lonely = np.flatnonzero(np.bincount(way_of, minlength=len(tracks)) == 1)
    at = np.searchsorted(way_of, lonely)
    ahead = np.column_stack([exact.cos(heading[at]), exact.sin(heading[at])])
    xy = np.insert(xy, at + 1, xy[at] + _LEAST_M * ahead, axis=0)
    heading, time_s = np.insert(heading, at + 1, heading[at]), np.insert(time_s, at + 1, time_s[at] + log.step_s)
    way_of = np.insert(way_of, at + 1, lonely)
    step = np.concatenate([[0.0], exact.norm(np.diff(xy, axis=0))])
    first = np.concatenate([[0], np.cumsum(np.bincount(way_of, minlength=len(tracks)))])
    step[first[:-1]] = 0.0
    gone = np.cumsum(step)
    last = np.searchsorted(way, np.arange(len(tracks)), side="right") - 1
    return Paths(first, xy, heading, gone - gone[first[way_of]], time_s - start_s, log.time_s[rows[last]] - start_s)


@dataclass(frozen=True, slots=True, eq=False)
class _Points:
    xy: Floats
    heading: Floats
    time_s: Floats
    row: Ints  # among the rows that were given


def _dense(log: TrackLog, rows: Ints) -> _Points:
    """Return the rows of a log, and points between those of a track that are far apart, on its clothoids."""
    after = np.append(rows[1:], rows[-1])
    after = np.where(log.track[after] == log.track[rows], after, rows)
    parts = np.maximum(np.ceil(exact.norm(log.place[after, :2] - log.place[rows, :2]) / _STEP_M), 1).astype(np.int64)
    row, number = numbered(parts)
    before, behind = rows[row], after[row]
    share, span_s = number / parts[row], log.time_s[behind] - log.time_s[before]
    start, end = (States(log.place[each], log.heading[each], log.velocity[each]) for each in (before, behind))
    found = between(start, end, span_s, share)
    exactly = number == 0
    found.place[exactly], found.heading[exactly] = log.place[before[exactly]], log.heading[before[exactly]]
    return _Points(found.place[:, :2], found.heading, log.time_s[before] + share * span_s, row)


@njit(cache=True, nogil=True)
def far_apart(xy: Floats, way: Ints, least_m: float) -> Mask:
    """Return the mask (P,) of points that are not too near to the last one before them on their way."""
    kept, last = np.ones(len(xy), np.bool_), 0
    for k in range(1, len(xy)):
        dx, dy = xy[k, 0] - xy[last, 0], xy[k, 1] - xy[last, 1]
        kept[k] = way[k] != way[last] or dx * dx + dy * dy >= least_m * least_m
        if kept[k]:
            last = k
    return kept
