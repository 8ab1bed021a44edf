"""Moments of a drive: when the car saw, heard of and tracked what it must not touch, braked, and crashed."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from coopsim.metrics.drive_events import find_events, has_track
from coopsim.metrics.drive_log import Drive
from coopsim.metrics.score import SEEN_BY
from coopsim.types import Mask

BY_ITSELF = SEEN_BY.index("me")

_GAP_FRAMES = 3
"""Frames without sight, or without a track, that end neither: a corner or a mirror flickers for less."""

_TOLD_SHARE = 0.5
"""Share of the frames out of sight with a track from which on messages keep it: an own track goes on for a moment."""


class Events(NamedTuple):
    """Moments of a drive, s since the episode's start; None: it did not happen.

    Attributes:
        seen_s: moment from which the car's own sensors saw what it must not touch, the last time before the two were
            nearest.
        again: it had been in sight before, and was hidden since.
        tracked_s: beginning of the track there by which the car braked; without a brake, of the last one before the two
            were nearest.
        braked_s: moment of the first hard brake with a track there; else of the first one after a track, or of all.
        crash_s: moment of its crash.
        impact_m_s: speed relative to what it crashed into; 0 without a crash.
        closest: number of the frame in which the two were nearest.
        told_by: agent that saw it first, if messages gave that track: it lasts while the car itself sees nothing there.
    """

    seen_s: float | None
    again: bool
    tracked_s: float | None
    braked_s: float | None
    crash_s: float | None
    impact_m_s: float
    closest: int
    told_by: str | None

    def words(self) -> list[tuple[float, str, str]]:
        """Return time, kind and words of all that happened, in order: "sight", "told", "track", "brake", "crash"."""
        known = ("told", f"heard of it from {self.told_by}") if self.told_by is not None else ("track", "has a track")
        crash = f"crash at {3.6 * self.impact_m_s:.0f} km/h"
        happened = [
            (self.seen_s, "sight", "in sight again" if self.again else "in sight"),
            (self.tracked_s, *known),
            (self.braked_s, "brake", "brakes hard"),
            (self.crash_s, "crash", crash),
        ]
        shown = [(at_s, kind, text) for at_s, kind, text in happened if at_s is not None]
        return sorted(shown, key=lambda each: each[0])  # stable: what is seen can be tracked in the same frame


def in_view(drive: Drive) -> Mask:
    """Return the mask (F,) of frames in which the car itself sees what it must not touch; short gaps are closed."""
    return closed(np.any((drive.seen_by == BY_ITSELF)[:, drive.in_conflict], axis=1))


def tracked(drive: Drive) -> Mask:
    """Return the mask (F, A) of the objects in conflict that have a reported track; short gaps are closed."""
    found = np.zeros(drive.boxes.shape[:2], dtype=np.bool_)
    for column in np.flatnonzero(drive.in_conflict).tolist():
        found[:, column] = closed(np.array([has_track(drive, frame, column) for frame in range(len(drive))]))
    return found


def find_moments(drive: Drive, watchers: Mapping[str, int], arrived: Sequence[frozenset[str]]) -> Events:
    """Find the moments of a drive.

    Args:
        drive: the drive.
        watchers: the other agents that saw the conflict, with their first frame.
        arrived: senders of messages that reached the car, by frame.
    """
    events, times = find_events(drive), drive.time_s
    closest = _closest(drive)
    itself, known = in_view(drive), np.any(tracked(drive), axis=1)
    hard = [int(np.searchsorted(times, at_s - 1e-9)) for at_s in events.hard_s]
    seen, hidden = last_view(itself, closest)
    track, braked = relied_on(known, hard, closest)
    told_by = None
    if track is not None and kept_unseen(known, track, seen, hidden, closest):
        heard = frozenset[str]().union(*arrived[: track + 1])
        early = {name: frame for name, frame in watchers.items() if frame <= track and name in heard}
        told_by = min(early, key=lambda name: (early[name], name), default=None)
    at_s = [None if frame is None else float(times[frame]) for frame in (seen, track, braked)]
    return Events(
        at_s[0],
        hidden > 0,
        at_s[1],
        at_s[2],
        None if events.crash is None else events.crash.time_s,
        0.0 if events.crash is None else events.crash.speed_m_s,
        closest,
        told_by,
    )


def _closest(drive: Drive) -> int:
    apart = np.hypot(*np.moveaxis(drive.boxes[:, drive.in_conflict, :2] - drive.car[:, None, :2], -1, 0))
    known = np.isfinite(apart).any(axis=1)
    return int(np.nanmin(apart, axis=1).argmin()) if known.all() else len(drive) - 1


def last_view(itself: Mask, until: int) -> tuple[int | None, int]:
    """Return the first frame of the last stretch of sight (F,) that begins before a frame, and where sight was lost.

    That is the frame after the stretch before, 0 if there was none; None: it was never in sight.
    """
    begun = [stretch for stretch in stretches(itself) if stretch[0] <= until]
    if not begun:
        return None, 0
    return begun[-1][0], begun[-2][1] if len(begun) > 1 else 0


def relied_on(known: Mask, hard: Sequence[int], until: int) -> tuple[int | None, int | None]:
    """Return the first frame of the track by which the car braked, and the frame of that brake; None: there is none.

    Args:
        known: (F,) frames with a track.
        hard: frames of hard brakes, rising.
        until: frame in which the two were nearest.
    """
    found = list(stretches(known))
    for brake in hard:
        by = next((first for first, end in found if first <= brake < end), None)
        if by is not None:
            return by, brake
    first = found[0][0] if found else 0
    brake_after = next((brake for brake in hard if brake >= first), None)
    begun = [start for start, _ in found if start <= until]
    return (begun[-1] if begun else first if found else None), brake_after


def kept_unseen(known: Mask, track: int, seen: int | None, hidden: int, closest: int) -> bool:
    """Return whether a track from a frame on is there while the object is out of sight, from `hidden` to `seen`."""
    until = closest + 1 if seen is None else seen
    unseen = known[max(hidden, track) : until]
    return track < until and len(unseen) > 0 and float(unseen.mean()) > _TOLD_SHARE


def closed(mask: Mask) -> Mask:
    """Return a mask (F,) in which gaps of a few frames are filled."""
    filled = np.array(mask, dtype=np.bool_)
    found = list(stretches(filled))
    for (_, end), (start, _) in pairwise(found):
        filled[end:start] |= start - end <= _GAP_FRAMES
    return filled


def stretches(mask: Mask) -> Iterator[tuple[int, int]]:
    """Yield the first frame of every stretch of a mask (F,), and the frame after its last."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], mask, [False]]).astype(np.int8)))
    yield from zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True)
