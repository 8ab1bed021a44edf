"""Trackers of one make for many sources of detections, side by side: in arrays of all tracks, or one after another."""

from __future__ import annotations

from collections.abc import Callable, Container, Sequence
from typing import Protocol

import numpy as np

from coopsim.geometry.se3 import Floats
from coopsim.tracking.by_class import TrackersByClass
from coopsim.tracking.cascade import everything
from coopsim.tracking.lifecycle import ByScore, HitsAndAge, VelocityAdaptiveAge
from coopsim.tracking.motion.constant_velocity import Beliefs
from coopsim.tracking.track_states import TrackStates
from coopsim.tracking.tracker import Tracker
from coopsim.types import NS_PER_S, Ints, Mask
from coopsim.types.groups import DetectionGroups

MakeTracker = Callable[[], Tracker | TrackersByClass]


class SourceTrackers(Protocol):
    """A tracker for each of many sources."""

    def step(self, sources: Sequence[str], groups: DetectionGroups, time_ns: int) -> tuple[Floats, Mask]:
        """Take in a frame's detections, a group for each of some sources; trackers of other sources stay as they are.

        Args:
            sources: names, each once.
            groups: valid detections, N in all.
            time_ns: time of the frame, later than the last one of each of these sources.

        Returns:
            What was known of each detection before the frame, as by `Tracker.known`: the velocity (N, 2) m/s of its
            track, and whether that is confirmed (N,).
        """

    def keep(self, sources: Container[str]) -> None:
        """Forget all other sources."""


def source_trackers(make: MakeTracker) -> SourceTrackers:
    """Return the trackers, in arrays of all tracks where those that `make` returns allow it."""
    tracker = make()
    if isinstance(tracker, Tracker) and fits(tracker):
        return TrackersSideBySide(tracker)
    return TrackersInTurn(make)


def fits(tracker: Tracker) -> bool:
    """Return whether all that a tracker does is done track by track, or within the pairs of one matching."""
    rules = tracker.first_round
    by_row = isinstance(tracker.lifecycle, (HitsAndAge, ByScore, VelocityAdaptiveAge))
    return by_row and tracker.appearance is None and rules.initiator is everything and rules.association.by_giou


class TrackersInTurn:
    """A tracker of its own for each source."""

    def __init__(self, make: MakeTracker) -> None:
        self._make = make
        self._trackers: dict[str, Tracker | TrackersByClass] = {}

    def step(self, sources: Sequence[str], groups: DetectionGroups, time_ns: int) -> tuple[Floats, Mask]:
        known = []
        for source, found in zip(sources, groups, strict=True):
            tracker = self._trackers.get(source) or self._make()
            known.append(tracker.known(found, time_ns))
            tracker.step(found, time_ns)
            self._trackers[source] = tracker
        velocities, confirmed = zip(*known, strict=True) if known else ([np.zeros((0, 2))], [np.zeros(0, np.bool_)])
        return np.concatenate(velocities), np.concatenate(confirmed)

    def keep(self, sources: Container[str]) -> None:
        self._trackers = {name: tracker for name, tracker in self._trackers.items() if name in sources}


class TrackersSideBySide:
    """The tracks of all sources in one struct, of which each frame predicts, matches and updates many at once.

    Only tracks and detections of one source are compared, so the cost is that of the tracks, whatever their sources.

    Args:
        tracker: a tracker that `fits`; its rules are taken, its state is not.
    """

    def __init__(self, tracker: Tracker) -> None:
        self._rules, self._tracked = tracker, tracker.blank()
        self._source = np.zeros(0, dtype=np.int64)  # number (T,) of each track's source
        self._numbers: dict[str, int] = {}
        self._frames, self._last_ns = np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64)

    def step(self, sources: Sequence[str], groups: DetectionGroups, time_ns: int) -> tuple[Floats, Mask]:
        numbers = self._number(sources, time_ns)
        tracked, source, rest = self._part_with(numbers)
        tracked, found, source_of_found = self._predict(tracked, source, time_ns), groups.joined, numbers[groups.group]
        rows, columns = self._rules.first_round.association.match_within(tracked, found, (source, source_of_found))
        velocity, confirmed = np.zeros((len(found), 2)), np.zeros(len(found), dtype=np.bool_)
        reported = self._rules.confirmed(tracked, self._frames[source] + 1)
        velocity[columns], confirmed[columns] = tracked.velocity[rows], reported[rows]
        tracked, new = self._rules.take_in(tracked, found, (rows, columns), 0, time_ns)
        tracked, alive = self._rules.finish(tracked)
        source = np.concatenate([source, source_of_found[new]])[alive]
        self._tracked = rest.join(tracked) if len(rest) else tracked
        self._source = np.concatenate([self._source[: len(rest)], source])
        self._frames[numbers] += 1
        self._last_ns[numbers] = time_ns
        return velocity, confirmed

    def keep(self, sources: Container[str]) -> None:
        kept = [name for name in self._numbers if name in sources]
        if len(kept) == len(self._numbers):
            return
        numbers = np.array([self._numbers[name] for name in kept], dtype=np.int64)
        renumbered = np.full(len(self._frames), -1)
        renumbered[numbers] = np.arange(len(kept))
        rows = renumbered[self._source] >= 0
        self._tracked, self._source = self._tracked[rows], renumbered[self._source[rows]]
        self._frames, self._last_ns = self._frames[numbers], self._last_ns[numbers]
        self._numbers = {name: number for number, name in enumerate(kept)}

    def _number(self, sources: Sequence[str], time_ns: int) -> Ints:
        """Return the number of each source; those that are new have no track and no frame."""
        for name in sources:
            self._numbers.setdefault(name, len(self._numbers))
        new = len(self._numbers) - len(self._frames)
        self._frames = np.concatenate([self._frames, np.zeros(new, dtype=np.int64)])
        self._last_ns = np.concatenate([self._last_ns, np.full(new, time_ns)])
        return np.array([self._numbers[name] for name in sources], dtype=np.int64)

    def _part_with(self, numbers: Ints) -> tuple[TrackStates, Ints, TrackStates]:
        """Return the tracks of some sources, their sources, and the tracks of all others, which alone stay."""
        chosen = np.zeros(len(self._frames), dtype=np.bool_)
        chosen[numbers] = True
        own = chosen[self._source]
        if own.all():
            return self._tracked, self._source, self._tracked[:0]
        source, tracked, rest = self._source[own], self._tracked[own], self._tracked[~own]
        self._source = self._source[~own]
        return tracked, source, rest

    def _predict(self, tracked: TrackStates, source: Ints, time_ns: int) -> TrackStates:
        """Return tracks of some sources (T,), predicted to a time from each source's last frame."""
        elapsed_ns = time_ns - self._last_ns[source]
        beliefs, predict = tracked.beliefs, self._rules.motion.predict
        groups = _alike(elapsed_ns, np.bincount(source)[source] == 1)
        if len(groups) == 1:
            return self._rules.age(tracked, predict(beliefs, float(elapsed_ns[0]) / NS_PER_S), time_ns)
        mean, covariance = np.empty_like(beliefs.mean), np.empty_like(beliefs.covariance)
        for rows in groups:
            before = Beliefs(beliefs.mean[rows], beliefs.covariance[rows])
            after = predict(before, float(elapsed_ns[rows[0]]) / NS_PER_S)
            mean[rows], covariance[rows] = after.mean, after.covariance
        return self._rules.age(tracked, Beliefs(mean, covariance), time_ns)


def _alike(elapsed_ns: Ints, alone: Mask) -> list[Ints]:
    """Return the rows of tracks that are predicted together: over one time, and none of those that are alone.

    A product of matrices may be rounded otherwise for one row than for more, and a source's only track shall have the
    bits that it has by itself.
    """
    together = [np.flatnonzero((elapsed_ns == each) & ~alone) for each in np.unique(elapsed_ns)]
    return [rows for rows in together if len(rows)] + [np.array([row]) for row in np.flatnonzero(alone)]
