"""The one form that logs of all formats are read into: tracks of road users, and where they are at any time.

x is east, y north and z up, m, in the log's own plane; angles are counter-clockwise from east. Nothing here knows a
format or a simulation.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from coopsim.data.logs.interpolation import States, between
from coopsim.geometry.se3 import Floats
from coopsim.types import Ints, Mask

GAP_STEPS = 1.5
"""A pause between two rows of a track, in steps of the log, above which it is a gap: the road user was not seen."""

_SAME_S = 1e-6
"""Times that differ by less are the same: sums of steps miss those of rows by a last bit."""


@dataclass(frozen=True, slots=True, eq=False)
class Moment:
    """The M road users of a log at one time.

    Attributes:
        track: (M,) their tracks, rising.
        place: (M, 3) m, the middle of each on the ground.
        heading: (M,) rad.
        velocity: (M, 2) m/s.
    """

    track: Ints
    place: Floats
    heading: Floats
    velocity: Floats

    def __len__(self) -> int:
        return len(self.track)

    def __getitem__(self, rows: Mask) -> Moment:
        return Moment(self.track[rows], self.place[rows], self.heading[rows], self.velocity[rows])

    def joined(self, other: Moment) -> Moment:
        """Return the road users of both, none of which is in both."""
        track = np.concatenate([self.track, other.track])
        order = np.argsort(track, kind="stable")
        place, heading = np.concatenate([self.place, other.place]), np.concatenate([self.heading, other.heading])
        velocity = np.concatenate([self.velocity, other.velocity])
        return Moment(track[order], place[order], heading[order], velocity[order])


@dataclass(frozen=True, kw_only=True, eq=False)
class TrackLog:
    """A log: T tracks, whose N rows stand one track after the other, each in order of time.

    Attributes:
        source: path of the file.
        format: its format.
        ids: (T) names in the log.
        label: (T,) an `ObjectClass` each.
        size: (T, 3) length, width and height, m.
        first: (T + 1,) row at which each track begins, and N.
        time_s: (N,) time.
        place: (N, 3) m, the middle of the road user on the ground.
        heading: (N,) rad.
        velocity: (N, 2) m/s.
        step_s: time between two rows of a track, as most are.
        owner: track of the car that recorded the log; None: none did, or the file does not say.
        filled: lines that say each what the file lacks, and by which rule it was filled.
        left_out: numbers of rows or tracks that were not read, by what they are.
    """

    source: str
    format: str
    ids: tuple[str, ...]
    label: Ints
    size: Floats
    first: Ints
    time_s: Floats
    place: Floats
    heading: Floats
    velocity: Floats
    step_s: float
    owner: int | None = None
    filled: tuple[str, ...] = ()
    left_out: dict[str, int]

    @property
    def start_s(self) -> float:
        """Time of the first row."""
        return float(self.time_s.min())

    @property
    def end_s(self) -> float:
        """Time of the last row."""
        return float(self.time_s.max())

    @cached_property
    def track(self) -> Ints:
        """Track (N,) of each row."""
        return np.repeat(np.arange(len(self.ids)), np.diff(self.first))

    @cached_property
    def gap(self) -> NDArray[np.bool_]:
        """Flags (N,) of rows after which the track goes on, but so late that the road user was lost meanwhile."""
        later = np.zeros(len(self.time_s), bool)
        pause = np.diff(self.time_s)
        later[:-1] = (pause > GAP_STEPS * self.step_s) & (self.track[1:] == self.track[:-1])
        return later

    def span_s(self, track: int) -> tuple[float, float]:
        """Return the first and last time of a track."""
        return float(self.time_s[self.first[track]]), float(self.time_s[self.first[track + 1] - 1])

    def played(self, start_s: float, end_s: float) -> TrackLog:
        """Return the part between two times, with a row more at both ends of each track; without tracks of no row."""
        inside = (self.time_s >= start_s) & (self.time_s <= end_s)
        same = self.track[1:] == self.track[:-1]
        kept = inside.copy()
        kept[:-1] |= inside[1:] & same
        kept[1:] |= inside[:-1] & same
        # A track may have no row between, but one before and one after.
        kept[:-1] |= same & (self.time_s[:-1] < start_s) & (self.time_s[1:] > end_s)
        kept[1:] |= same & (self.time_s[:-1] < start_s) & (self.time_s[1:] > end_s)
        rows = np.flatnonzero(kept)
        return self._part(rows)

    def of(self, tracks: Ints) -> TrackLog:
        """Return the part with these tracks (K,), rising."""
        return self._part(np.flatnonzero(np.isin(self.track, tracks)))

    def _part(self, rows: Ints) -> TrackLog:
        tracks, counts = np.unique(self.track[rows], return_counts=True)
        owner = np.flatnonzero(tracks == self.owner)
        return replace(
            self,
            ids=tuple(self.ids[k] for k in tracks),
            label=self.label[tracks],
            size=self.size[tracks],
            first=np.concatenate([[0], np.cumsum(counts)]),
            time_s=self.time_s[rows],
            place=self.place[rows],
            heading=self.heading[rows],
            velocity=self.velocity[rows],
            owner=int(owner[0]) if len(owner) else None,
        )

    def at(self, time_s: float) -> Moment:
        """Return the road users at a time; at times of the log exactly as it has them, in gaps and before or after
        their tracks not at all.
        """
        row = self._row_before(time_s + _SAME_S)
        begun = np.flatnonzero(row >= 0)
        row = row[begun]
        exact = self.time_s[row] >= time_s - _SAME_S
        kept = exact | ((row + 1 < self.first[begun + 1]) & ~self.gap[row])
        begun, row, exact = begun[kept], row[kept], exact[kept]
        after = np.where(exact, row, row + 1)
        span_s = self.time_s[after] - self.time_s[row]
        share = np.divide(time_s - self.time_s[row], span_s, out=np.zeros(len(row)), where=span_s > 0)
        found = between(self._states(row), self._states(after), span_s, share)
        for now, known in zip(found, self._states(row), strict=True):
            now[exact] = known[exact]
        return Moment(begun, *found)

    def _row_before(self, time_s: float) -> Ints:
        """Return the last row (T,) of each track that is not later; -1: there is none."""
        low, high = self.first[:-1].copy(), self.first[1:].copy()
        while (low < high).any():
            middle = (low + high) // 2
            open_ = low < high
            early = open_ & (self.time_s[np.minimum(middle, len(self.time_s) - 1)] <= time_s)
            low, high = np.where(early, middle + 1, low), np.where(open_ & ~early, middle, high)
        return np.where(low > self.first[:-1], low - 1, -1)

    def _states(self, row: Ints) -> States:
        return States(self.place[row], self.heading[row], self.velocity[row])


def most_at_once(first_s: Floats, last_s: Floats) -> int:
    """Return how many spans of time (K,) overlap at most."""
    begun = np.searchsorted(np.sort(first_s), np.sort(first_s), side="right")
    gone = np.searchsorted(np.sort(last_s), np.sort(first_s), side="left")
    return int((begun - gone).max(initial=0))
