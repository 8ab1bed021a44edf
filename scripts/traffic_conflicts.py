"""Conflicts in a log: pairs of road users that used the same ground soon after each other, not one behind the other.

The ground is a lattice of points. A pair is in conflict where both footprints covered a point, with headings at least
`ANGLE_RAD` apart, and one came at most `PET_S` after the other had left (the post-encroachment time). Bounds are those
by which SSAM of the FHWA, version 2, tells crossing and lane changes from rear ends, and leaves out late encroachments.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from coopsim.data.logs.track_log import TrackLog
from coopsim.geometry.se3 import Floats, wrap_angle
from coopsim.types import Ints

LATTICE_M, PET_S, ANGLE_RAD = 0.5, 5.0, np.radians(30.0)

_WIDE = 1 << 24
"""Columns of the lattice: more than any log is wide."""

_LATER = 20
"""Road users after one, at a point, that are looked at: more than can pass within `PET_S`."""


@dataclass(frozen=True)
class Conflict:
    """A conflict of two road users.

    Attributes:
        pair: their tracks, rising.
        time_s: when the first of them reaches the first point that both use.
        place: (x, y) of that point, m.
        pet_s: least post-encroachment time over all points; below 0 where both were there at once.
    """

    pair: tuple[int, int]
    time_s: float
    place: tuple[float, float]
    pet_s: float


class _Visits(NamedTuple):
    """Visits of points by road users, V each: point, track, first and last time, heading at the first."""

    point: Ints
    track: Ints
    first_s: Floats
    last_s: Floats
    heading: Floats


def find_conflicts(log: TrackLog) -> list[Conflict]:
    """Return the conflicts of a log, in order of time."""
    origin = np.floor(log.place[:, :2].min(axis=0) - 20.0)
    tracks = [_visits(log, track, origin) for track in range(len(log.ids))]
    visits = _Visits(*(np.concatenate(column) for column in zip(*tracks, strict=True)))
    order = np.lexsort((visits.first_s, visits.point))
    visits = _Visits(*(column[order] for column in visits))
    shared = np.concatenate([_shared(visits, later) for later in range(1, _LATER)])
    low, high = shared[:, 0].astype(np.int64), shared[:, 1].astype(np.int64)
    pairs, number = np.unique(np.column_stack([low, high]), axis=0, return_inverse=True)
    found = []
    for k, pair in enumerate(pairs.tolist()):
        rows = shared[number.ravel() == k]
        at = rows[np.argmin(rows[:, 2])]
        x, y = (origin + LATTICE_M * np.array(divmod(int(at[4]), _WIDE))).tolist()
        found.append(Conflict((pair[0], pair[1]), float(at[2]), (x, y), float(rows[:, 3].min())))
    return sorted(found, key=lambda each: each.time_s)


def _visits(log: TrackLog, track: int, origin: Floats) -> _Visits:
    """Return the points that a road user's footprint covers."""
    rows = slice(*log.first[track : track + 2])
    half = log.size[track, :2] / 2
    reach = int(np.ceil(np.hypot(*half) / LATTICE_M))
    steps = np.arange(-reach, reach + 1)
    around = np.stack(np.meshgrid(steps, steps, indexing="ij"), axis=-1).reshape(-1, 2)
    near = np.round((log.place[rows, :2] - origin) / LATTICE_M).astype(np.int64)
    cells = near[:, None] + around
    away = origin + LATTICE_M * cells - log.place[rows, None, :2]
    cos, sin = np.cos(log.heading[rows])[:, None], np.sin(log.heading[rows])[:, None]
    along, aside = away[..., 0] * cos + away[..., 1] * sin, away[..., 1] * cos - away[..., 0] * sin
    row, inside = np.nonzero((np.abs(along) <= half[0]) & (np.abs(aside) <= half[1]))
    covered = cells[row, inside]
    point, first, last = _runs(covered[:, 0] * _WIDE + covered[:, 1])
    time_s, heading = log.time_s[rows][row], log.heading[rows][row]
    return _Visits(point, np.full(len(point), track), time_s[first], time_s[last], heading[first])


def _runs(point: Ints) -> tuple[Ints, Ints, Ints]:
    """Return the different points, and the first and last row of each."""
    different, first = np.unique(point, return_index=True)
    return different, first, len(point) - 1 - np.unique(point[::-1], return_index=True)[1]


def _shared(visits: _Visits, later: int) -> Floats:
    """Return the points (K, 5) that the visitor `later` places after used soon enough, from another direction.

    Columns are the lower and the higher track, when the first came, seconds until the other did, and the point.
    """
    one, two = (_Visits(*(column[part] for column in visits)) for part in (slice(-later), slice(later, None)))
    pause_s = two.first_s - one.last_s
    apart = np.abs(wrap_angle(two.heading - one.heading)) >= ANGLE_RAD
    met = (one.point == two.point) & (one.track != two.track) & (pause_s <= PET_S) & apart
    tracks = np.sort(np.column_stack([one.track[met], two.track[met]]), axis=1)
    return np.column_stack([tracks, one.first_s[met], pause_s[met], one.point[met]]).astype(np.float64)
