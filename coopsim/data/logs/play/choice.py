"""Choice of the part of a log that an episode plays, and of the cars that are connected."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from coopsim.data.logs.track_log import TrackLog
from coopsim.errors import InvalidValueError, UnknownNameError
from coopsim.geometry import exact
from coopsim.geometry.se3 import Floats
from coopsim.support.rng import stream
from coopsim.types import Ints, Mask
from coopsim.types.taxonomy import ObjectClass

_STARTS = 20
"""Times that are drawn for an episode before it is given up."""

LONGEST_S = 300.0
"""Longest episode of cars that have left their log."""

_MIDDLES = 8
"""Cars around which the place is tried at each of them."""


@dataclass(frozen=True, slots=True, eq=False)
class Choice:
    """A part of a log.

    Attributes:
        log: the part, with the middle of its place as the origin.
        start_s: time in the log at which it begins.
        end_s: time at which the first connected car leaves.
        connected: tracks (C,) of the connected cars.
        left_s: (C,) time in the log at which each leaves the place or is lost.
        middle: (2,) m, the middle of the place in the log's plane.
        whole: the log that it is a part of.
        radius_m: radius of the place.
    """

    log: TrackLog
    start_s: float
    end_s: float
    connected: Ints
    left_s: Floats
    middle: Floats
    whole: TrackLog
    radius_m: float

    def going_on(self) -> Choice:
        """Return the same part, but for as long as an episode of driven cars can last: they may be slower."""
        end_s = min(self.whole.end_s, self.start_s + LONGEST_S)
        names = [self.log.ids[k] for k in self.connected]
        log, connected = _part(self.whole, self.start_s, end_s, self.middle, self.radius_m, names)
        return replace(self, log=log, end_s=end_s, connected=connected)


@dataclass(frozen=True, slots=True, kw_only=True)
class Wish:
    """Needs of an episode.

    Attributes:
        connected: number of connected cars.
        ids: names of the connected cars, in the agents' order; empty: drawn.
        start_s: time in the log; None: drawn.
        around: (2,) middle of the place; None: the first connected car's place, half-way through `least_s`.
        radius_m: road users beyond are left out.
        least_s: time for which all connected cars are there.
    """

    connected: int
    ids: tuple[str, ...] = ()
    start_s: float | None = None
    around: tuple[float, float] | None = None
    radius_m: float = 250.0
    least_s: float = 10.0


def choose(log: TrackLog, wish: Wish, seed: int) -> Choice:
    """Return the part that an episode plays: the same for the same seed.

    Raises:
        InvalidValueError: there is no time at which so many cars are there for so long; says what there is.
        UnknownNameError: there is no car of a name.
    """
    rng = stream(seed, "log")
    named = _named(log, wish.ids)
    latest_s = log.end_s - wish.least_s
    if latest_s < log.start_s:
        raise InvalidValueError(
            f"least_s must be at most {log.end_s - log.start_s:.1f}, the length of {log.source}, got {wish.least_s:g}"
        )
    starts = np.unique(log.time_s[log.time_s <= latest_s])
    most = most_near = 0
    for _ in range(_STARTS if wish.start_s is None else 1):
        start_s = float(starts[rng.integers(len(starts))]) if wish.start_s is None else wish.start_s
        steady = _steady(log, start_s, start_s + wish.least_s)
        cars = np.flatnonzero(steady & (log.label == ObjectClass.CAR)) if named is None else named[steady[named]]
        most = max(most, len(cars))
        if len(cars) < wish.connected:
            continue
        if named is None:
            cars = rng.permutation(cars)
        for middle in _middles(log, wish, cars, start_s):
            near = [car for car in cars.tolist() if _stays_near(log, car, start_s, middle, wish)]
            if len(near) >= wish.connected:
                return _cut(log, wish, start_s, np.array(near[: wish.connected], np.int64), middle)
            most_near = max(most_near, len(near))
    when = "at some time" if wish.start_s is None else f"at start_s={wish.start_s:g}"
    asked = f"{wish.connected} connected cars" if named is None else f"the cars {', '.join(wish.ids)}"
    raise InvalidValueError(
        f"{log.source} has no {wish.least_s:g} s {when} (least_s) in which {asked} are there, within "
        f"{wish.radius_m:g} m (radius_m): at most {most} are there, {most_near} of them so near. It lasts from "
        f"{log.start_s:g} to {log.end_s:g} s"
    )


def _named(log: TrackLog, ids: tuple[str, ...]) -> Ints | None:
    if not ids:
        return None
    known = {name: k for k, name in enumerate(log.ids)}
    for name in ids:
        if name not in known:
            raise UnknownNameError(f"road user of {log.source}", name, log.ids)
    return np.array([known[name] for name in ids], np.int64)


def _steady(log: TrackLog, start_s: float, end_s: float) -> Mask:
    """Return which tracks (T,) are there from one time to another, without a gap."""
    first, last = log.time_s[log.first[:-1]], log.time_s[log.first[1:] - 1]
    gaps = np.flatnonzero(log.gap)
    broken = gaps[(log.time_s[gaps] < end_s) & (log.time_s[gaps + 1] > start_s)]
    steady: Mask = (first <= start_s) & (last >= end_s)
    steady[log.track[broken]] = False
    return steady


def _middles(log: TrackLog, wish: Wish, cars: Ints, start_s: float) -> list[Floats]:
    """Return middles (2,) of the place to try: that which is asked for, or where the first cars are."""
    if wish.around is not None or not len(cars):
        return [np.array(wish.around or (0.0, 0.0))]
    now = log.at(start_s + wish.least_s / 2)
    first = cars[: 1 if wish.ids else _MIDDLES]
    return list(np.round(now.place[np.searchsorted(now.track, first), :2]))


def _stays_near(log: TrackLog, track: int, start_s: float, middle: Floats, wish: Wish) -> bool:
    rows = slice(*log.first[track : track + 2])
    time_s = log.time_s[rows]
    inside = (time_s >= start_s) & (time_s <= start_s + wish.least_s)
    return bool((exact.norm(log.place[rows][inside, :2] - middle) <= wish.radius_m).all())


def _cut(log: TrackLog, wish: Wish, start_s: float, cars: Ints, middle: Floats) -> Choice:
    """Return the part from a time on around a point: until a connected car leaves the place or is lost."""
    names = [log.ids[k] for k in cars]
    left_s = np.array([_last_s(log, int(car), start_s, middle, wish.radius_m) for car in cars])
    end_s = float(left_s.min()) if len(cars) else log.end_s
    part, connected = _part(log, start_s, end_s, middle, wish.radius_m, names)
    return Choice(part, start_s, end_s, connected, left_s, middle, log, wish.radius_m)


def _part(
    log: TrackLog, start_s: float, end_s: float, middle: Floats, radius_m: float, names: list[str]
) -> tuple[TrackLog, Ints]:
    """Return the part of a log between two times around a point, and the tracks there of some names."""
    part = log.played(start_s, end_s)
    place = part.place - [*middle, 0.0]
    near = exact.norm(place[:, :2]) <= radius_m
    kept = np.zeros(len(part.ids), bool)
    kept[part.track[near]] = True
    moved = replace(part, place=place).of(np.flatnonzero(kept))
    known = {name: k for k, name in enumerate(moved.ids)}
    return moved, np.array([known[name] for name in names], np.int64)


def _last_s(log: TrackLog, track: int, start_s: float, middle: Floats, radius_m: float) -> float:
    """Return the last time until which a track stays within a circle, without a gap."""
    rows = np.arange(log.first[track], log.first[track + 1])
    rows = rows[log.time_s[rows] >= start_s]
    leaves = (exact.norm(log.place[rows, :2] - middle) > radius_m) | np.concatenate([[False], log.gap[rows[:-1]]])
    gone = np.flatnonzero(leaves)
    return float(log.time_s[rows[gone[0] - 1] if len(gone) else rows[-1]])
