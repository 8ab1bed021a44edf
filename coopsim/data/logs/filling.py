"""A log from the columns of any file: order, checks, and rules by which what is missing is filled."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from coopsim.data.logs.track_log import GAP_STEPS, TrackLog
from coopsim.errors import LogFileError
from coopsim.geometry import exact
from coopsim.geometry.se3 import Floats, wrap_angle
from coopsim.types import Ints
from coopsim.types.taxonomy import ObjectClass

SIZES_M: Mapping[ObjectClass, tuple[float, float, float]] = {
    ObjectClass.CAR: (4.5, 1.8, 1.5),
    ObjectClass.VAN: (5.3, 2.0, 2.2),
    ObjectClass.TRUCK: (8.0, 2.5, 3.2),
    ObjectClass.BUS: (12.0, 2.5, 3.2),
    ObjectClass.MOTORCYCLE: (2.2, 0.8, 1.5),
    ObjectClass.BICYCLE: (1.8, 0.65, 1.7),
    ObjectClass.SCOOTER: (1.2, 0.6, 1.7),
    ObjectClass.PEDESTRIAN: (0.6, 0.6, 1.7),
    ObjectClass.CHILD: (0.5, 0.5, 1.2),
}
"""Length, width and height by class, of road users whose log does not say."""

MOST_ROWS, MOST_TRACKS = 50_000_000, 200_000
LARGEST_M, LONGEST_M, FASTEST_M_S = 1e8, 40.0, 150.0
"""Greatest accepted coordinate, length of a road user, and speed between two rows."""

_STILL_M = 0.3
"""Way within which a heading is not read off positions, which are noise: that before is kept."""

_LOOK_ROWS = 50
"""Rows ahead in which that way is looked for."""


@dataclass(slots=True, kw_only=True)
class Columns:
    """Columns of a file's N rows; those that are None are filled.

    Attributes:
        where: word for a row in a message, such as "row", and the number of the first.
        time_s: (N,) time.
        id: (N,) track of each row: numbers or texts.
        label: (N,) `ObjectClass`; -1: no road user, its rows are left out.
        xy: (N, 2) m, the middle.
        z_m: (N,) height of the ground.
        heading: (N,) rad; nan: unknown.
        velocity: (N, 2) m/s.
        size: (N, 3) length, width, height, m; nan: unknown. A track has its largest.
        front: `xy` is the middle of the front, not of the footprint.
        left_out: numbers of rows that were not read, by why.
        step_s: time between rows, if the file says it.
        owner: name of the car that recorded.
        names: names in their order, of which `id` then has the numbers; None: `id` has the names.
    """

    where: tuple[str, int] = ("row", 1)
    time_s: Floats
    id: NDArray[Any]
    label: Ints
    xy: Floats
    z_m: Floats | None = None
    heading: Floats | None = None
    velocity: Floats | None = None
    size: Floats | None = None
    front: bool = False
    left_out: dict[str, int] = field(default_factory=dict)
    step_s: float | None = None
    owner: str | None = None
    names: NDArray[Any] | None = None

    def name(self, row: int) -> str:
        """Return the name of a row's road user."""
        return str(self.id[row] if self.names is None else self.names[self.id[row]])


def make_log(source: str, form: str, columns: Columns) -> TrackLog:
    """Return the log of a file's columns.

    Raises:
        LogFileError: there are no rows, or one is broken; names the row and its id.
    """
    rows = _Rows(source, columns)
    rows.check_numbers()
    kept = np.flatnonzero(columns.label >= 0)
    if not len(kept):
        raise LogFileError(f"{source}: there is no road user in it")
    names, track = np.unique(columns.id[kept], return_inverse=True)
    if len(names) > MOST_TRACKS:
        raise LogFileError(f"{source}: {len(names):,} road users are more than the {MOST_TRACKS:,} that are accepted")
    order = np.lexsort((columns.time_s[kept], track))
    row, track = kept[order], track[order]
    first = np.searchsorted(track, np.arange(len(names) + 1))
    time_s, xy = columns.time_s[row], columns.xy[row].astype(np.float64)
    step_s = rows.check_order(row, track, time_s, columns.step_s)
    label = columns.label[row][first[:-1]]
    filled: list[str] = []
    size = _sizes(columns, row, first, label, filled)
    heading = _headings(columns, row, track, xy, filled)
    if columns.front:
        xy = xy - 0.5 * size[track, :1] * np.column_stack([exact.cos(heading), exact.sin(heading)])
    rows.check_speed(row, track, time_s, xy, step_s)
    left_out = dict(columns.left_out)
    if unread := len(columns.label) - len(kept) - sum(left_out.values()):
        left_out["rows of what is no road user"] = unread
    ids = tuple(str(name) for name in (names if columns.names is None else columns.names[names]))
    z_m = np.zeros(len(row)) if columns.z_m is None else columns.z_m[row]
    return TrackLog(
        source=source,
        format=form,
        ids=ids,
        label=label,
        size=size,
        first=first,
        time_s=time_s,
        place=np.column_stack([xy, z_m]),
        heading=heading,
        velocity=_velocities(columns, row, track, time_s, xy, step_s, filled),
        step_s=step_s,
        owner=ids.index(columns.owner) if columns.owner in ids else None,
        filled=tuple(filled),
        left_out=left_out,
    )


@dataclass(slots=True)
class _Rows:
    """Checks of rows, with messages that name them."""

    source: str
    columns: Columns

    def error(self, row: int, wrong: str) -> LogFileError:
        """Return an error about a row."""
        word, first = self.columns.where
        return LogFileError(f"{self.source}: {word} {row + first} (id {self.columns.name(row)}): {wrong}")

    def check_numbers(self) -> None:
        """Raise an error at the first number that is not finite or out of range."""
        if len(self.columns.time_s) > MOST_ROWS:
            raise LogFileError(f"{self.source}: more than the {MOST_ROWS:,} rows that are accepted")
        self._check("time", self.columns.time_s, 1e12, "s")
        self._check("position", self.columns.xy, LARGEST_M, "m")
        if self.columns.z_m is not None:
            self._check("height", self.columns.z_m, LARGEST_M, "m")
        if self.columns.heading is not None:
            self._check("heading", np.nan_to_num(self.columns.heading, nan=0.0, posinf=np.inf), 1e4, "rad")
        if self.columns.velocity is not None:
            self._check("velocity", self.columns.velocity, FASTEST_M_S, "m/s")
        if self.columns.size is not None:
            known = np.nan_to_num(self.columns.size, nan=1.0, posinf=np.inf)
            self._check("length, width and height", np.where(known > 0, known, np.inf), LONGEST_M, "m, and above 0")

    def _check(self, name: str, values: Floats, most: float, unit: str) -> None:
        wrong = ~(np.abs(values) <= most)
        if wrong.any():
            row = int(np.flatnonzero(wrong.reshape(len(values), -1).any(axis=1))[0])
            given = np.asarray(values[row]).ravel().tolist()
            raise self.error(row, f"{name} must be finite and at most {most:g} {unit}".rstrip() + f", got {given}")

    def check_order(self, row: Ints, track: Ints, time_s: Floats, stated_s: float | None) -> float:
        """Return the usual time between two rows of a track.

        Raises:
            LogFileError: a track has two rows of one time.
        """
        pause = np.diff(time_s)[track[1:] == track[:-1]]
        twice = np.flatnonzero((np.diff(time_s) <= 0) & (track[1:] == track[:-1]))
        if len(twice):
            at = int(row[twice[0] + 1])
            raise self.error(at, f"there is another row of this id at {self.columns.time_s[at]:g} s; accepted: one")
        if stated_s is not None:
            return stated_s
        return float(np.round(np.median(pause), 6)) if len(pause) else 0.1

    def check_speed(self, row: Ints, track: Ints, time_s: Floats, xy: Floats, step_s: float) -> None:
        """Raise an error where a road user leaps."""
        pause = np.maximum(np.diff(time_s), 1e-9)
        leaps = exact.norm(np.diff(xy, axis=0)) > FASTEST_M_S * np.maximum(pause, step_s)
        far = np.flatnonzero(leaps & (track[1:] == track[:-1]) & (pause <= GAP_STEPS * step_s))
        if len(far):
            way_m, at = float(exact.norm(xy[far[0] + 1] - xy[far[0]])), int(row[far[0] + 1])
            raise self.error(
                at,
                f"it leaps {way_m:.0f} m in {pause[far[0]]:g} s; accepted: up to {FASTEST_M_S:g} m/s (x and y in m, "
                "time in s, one id for one road user)",
            )


def _sizes(columns: Columns, row: Ints, first: Ints, label: Ints, filled: list[str]) -> Floats:
    """Return each track's size (T, 3): the largest that its rows have, else its class's."""
    usual = np.array([SIZES_M[ObjectClass(k)] for k in range(len(ObjectClass))])[label]
    if columns.size is None:
        filled.append("no sizes: those of the classes")
        return usual
    largest = np.fmax.reduceat(columns.size[row], first[:-1])
    unknown = ~np.isfinite(largest)
    for name, missing in zip(("lengths", "widths", "heights"), unknown.sum(axis=0).tolist(), strict=True):
        if missing:
            filled.append(f"{name} of {missing} road users: those of their classes")
    return np.where(unknown, usual, largest)


def _headings(columns: Columns, row: Ints, track: Ints, xy: Floats, filled: list[str]) -> Floats:
    """Return the headings (N,): the file's, else along the way, read where it is long enough to be no noise."""
    given = None if columns.heading is None else columns.heading[row]
    if given is not None and np.isfinite(given).all():
        return np.asarray(wrap_angle(given))
    some = "no headings" if given is None else f"headings of {int(np.isnan(given).sum())} rows"
    filled.append(f"{some}: along the way, kept where a road user stands")
    heading, known = np.zeros(len(xy)), np.zeros(len(xy), bool)
    last = np.concatenate([np.flatnonzero(np.diff(track)), [len(track) - 1]])
    end = last[track]
    reach = np.arange(len(xy))
    open_ = np.ones(len(xy), bool)
    for _ in range(_LOOK_ROWS):  # to the first later row that is far enough away
        reach[open_] += 1
        open_ &= reach <= end
        at = np.flatnonzero(open_)
        way = xy[reach[at]] - xy[at]
        far = exact.norm(way) >= _STILL_M
        heading[at[far]], known[at[far]] = exact.arctan2(way[far, 1], way[far, 0]), True
        open_[at[far]] = False
    along = np.asarray(exact.settled(_carried(heading, known, track)))
    return along if given is None else np.where(np.isfinite(given), wrap_angle(given), along)


def _carried(heading: Floats, known: NDArray[np.bool_], track: Ints) -> Floats:
    """Return headings where unknown ones are the last known before, or the first after, in their track."""
    number = np.arange(len(track))
    before = np.maximum.accumulate(np.where(known, number, -1))
    after = np.minimum.accumulate(np.where(known, number, len(track))[::-1])[::-1]
    good = (before >= 0) & (track[before] == track)
    late = ~good & (after < len(track))
    late[late] = track[after[late]] == track[late]
    return np.where(good, heading[before], np.where(late, heading[np.minimum(after, len(track) - 1)], 0.0))


def _velocities(
    columns: Columns, row: Ints, track: Ints, time_s: Floats, xy: Floats, step_s: float, filled: list[str]
) -> Floats:
    """Return velocities (N, 2): the file's, else from the rows before and after, but not over gaps."""
    if columns.velocity is not None:
        return columns.velocity[row].astype(np.float64)
    filled.append("no velocities: from the positions before and after")
    joined = (track[1:] == track[:-1]) & (np.diff(time_s) <= GAP_STEPS * step_s)
    before, after = np.arange(len(xy)), np.arange(len(xy))
    before[1:] -= joined
    after[:-1] += joined
    span_s = time_s[after] - time_s[before]
    way = xy[after] - xy[before]
    return np.divide(way, span_s[:, None], out=np.zeros_like(way), where=span_s[:, None] > 0)
