"""Tracking by detection: predict, associate, update, begin, end. All tracks at once."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from coopsim.errors import InvalidValueError
from coopsim.geometry.boxes import Boxes3D
from coopsim.geometry.se3 import Floats
from coopsim.tracking.affinity.appearance import Appearance, seen_by_others
from coopsim.tracking.affinity.reid import EmbeddingMemory
from coopsim.tracking.cascade import Cascade, Chooser, everyone
from coopsim.tracking.lifecycle import Lifecycle
from coopsim.tracking.motion.constant_velocity import Beliefs, Motion
from coopsim.tracking.track_scoring import Latest, Scoring
from coopsim.tracking.tracked import Tracked
from coopsim.types import NS_PER_S, Detections, Ints, Tracks
from coopsim.types.taxonomy import CLASS_NAMES


@dataclass(frozen=True, slots=True)
class Turn:
    """How one group of detections is taken in.

    Attributes:
        association: matches tracks to its detections.
        born: which of the detections that no track matches begin a track.
    """

    association: Cascade
    born: Chooser = everyone


@dataclass(frozen=True, slots=True, eq=False)
class TrackerState:
    """All that a tracker knows. It is never changed, so keeping one is free; see `Tracker.state`.

    Attributes:
        tracked: the tracks, reported or not.
        next_id: the id of the next track.
        frame: number of frames so far.
        time_ns: of the last frame; None before the first.
    """

    tracked: Tracked
    next_id: int
    frame: int
    time_ns: int | None


class Tracker:
    """A tracker, composed of how objects move, how they are recognised, and when they come and go.

    All boxes are in one frame that does not move with the observer (world or odometry). Ids count from 1
    and are never used twice. Memory is that of the tracks alive.

    Args:
        motion: the motion model and its filter.
        association: matches predicted tracks to detections.
        lifecycle: what is reported and what is dropped.
        scoring: how a track's score follows its detections'; None: the latest.
        born: which of the detections that no track matches begin a track.
        later: how the groups after the first are taken, see `step_in_turn`; None: as the first.
        appearance: what is kept of embeddings, and which detections begin no track because of them; None: nothing is.
    """

    def __init__(
        self,
        motion: Motion,
        association: Cascade,
        lifecycle: Lifecycle,
        *,
        scoring: Scoring | None = None,
        born: Chooser = everyone,
        later: Turn | None = None,
        appearance: Appearance | None = None,
    ) -> None:
        self._motion, self._lifecycle, self._scoring = motion, lifecycle, scoring or Latest()
        self._appearance = appearance
        self._first = Turn(association, born)
        self._later = later or self._first
        self.reset()

    def reset(self) -> None:
        """Forget everything."""
        memory = EmbeddingMemory.blank(0, dim=0, window=1 if self._appearance is None else self._appearance.views)
        self.state = TrackerState(self._begin(Detections.empty(), 1, memory), next_id=1, frame=0, time_ns=None)

    @property
    def time_ns(self) -> int | None:
        """Of the last frame; None before the first."""
        return self.state.time_ns

    def require_time(self, time_ns: int) -> None:
        """Raise `InvalidValueError` if a time lies before the last frame."""
        if self.time_ns is not None and time_ns < self.time_ns:
            raise InvalidValueError(f"time must not go back, got {time_ns} ns after {self.time_ns} ns")

    def step(self, detections: Detections, time_ns: int) -> Tracks:
        """Take in one frame's detections; the tracks at its time.

        Detections that are not finite or have no size are left out.

        Args:
            detections: in the tracker's frame; an empty frame is a frame too.
            time_ns: of the frame; must not go back.

        Raises:
            InvalidValueError: time went back.
        """
        return self.step_in_turn([detections], time_ns)

    def step_in_turn(self, groups: Sequence[Detections], time_ns: int, *, awaited: bool = False) -> Tracks:
        """Take in one frame's detections from several sources, one after another.

        Each group is matched to the tracks as the groups before left them, those that these began included. A frame
        counts as one hit or one miss, however many groups there are.

        Args:
            groups: in the tracker's frame.
            time_ns: of the frame; must not go back.
            awaited: more of this frame may still come, so that a track without a detection has not been missed yet.

        Raises:
            InvalidValueError: time went back.
        """
        tracked, next_id = self.predicted(time_ns), self.state.next_id
        for number, group in enumerate(groups):
            turn, found = self._later if number else self._first, sane(group)
            if self._appearance is not None:
                tracked = replace(tracked, appearance=tracked.appearance.ready_for(found))
            rows, columns = turn.association.match(tracked, found)
            tracked = self._updated(tracked, rows, found[columns])
            unmatched = np.setdiff1d(np.arange(len(found)), columns)
            if self._appearance is not None:
                shown = self._appearance.repeats(found, columns, tracked.appearance.take(rows))
                tracked = _refreshed(tracked, rows, columns, found, shown)
                unmatched = unmatched[shown[unmatched] == unmatched]
            new = found[unmatched]
            new = new[turn.born(new)]
            if len(new):
                tracked = tracked.join(self._begin(new, next_id, tracked.appearance))
                next_id += len(new)
        if awaited:
            tracked = replace(tracked, misses=np.maximum(tracked.misses - 1, 0))
        lost = np.where(tracked.misses > 0, self._scoring.miss(tracked.score, tracked.age), tracked.score)
        tracked = replace(tracked, score=lost)
        tracked = tracked[self._lifecycle.alive(tracked)]
        tracked = replace(tracked, confidence=self._scoring.confidence(tracked))
        self.state = TrackerState(tracked, next_id, self.state.frame + 1, time_ns)
        return self.report()

    def velocity_of(self, detections: Detections, time_ns: int) -> Floats:
        """The velocity (N, 2) m/s of the track that each detection would be matched to; 0 where there is none.

        The tracker stays as it is. Detections must be `sane`; `time_ns` must not lie before the last frame.
        """
        tracked = self.predicted(time_ns)
        rows, columns = self._first.association.match(tracked, detections)
        velocity = np.zeros((len(detections), 2))
        velocity[columns] = tracked.velocity[rows]
        return velocity

    def predicted(self, time_ns: int) -> Tracked:
        """The tracks as they are expected at a time, one frame older; the tracker stays as it is.

        Raises:
            InvalidValueError: time went back.
        """
        self.require_time(time_ns)
        before = self.state.tracked
        elapsed_ns = 0 if self.time_ns is None else time_ns - self.time_ns
        beliefs = self._motion.predict(before.beliefs, elapsed_ns / NS_PER_S)
        older = replace(before, misses=before.misses + 1, age=before.age + 1)
        return self._believing(older, beliefs)

    def reported(self) -> Tracked:
        """What stands behind the rows of `report`."""
        tracked = self.state.tracked
        return tracked[self._lifecycle.reported(tracked, self.state.frame)]

    def report(self) -> Tracks:
        """The tracks that are worth it, at the time of the last frame."""
        shown = self.reported()
        boxes = Boxes3D.from_array(shown.boxes)
        # A filter may shrink a box through zero; a report of it would be refused.
        boxes = Boxes3D(boxes.center, np.maximum(boxes.size, 1e-3), boxes.yaw)
        return Tracks(shown.id, boxes, shown.velocity, shown.confidence, shown.label)

    def _updated(self, tracked: Tracked, rows: Ints, found: Detections) -> Tracked:
        if not len(rows):
            return tracked
        mean, covariance = tracked.beliefs.mean.copy(), tracked.beliefs.covariance.copy()
        matched = self._motion.update(Beliefs(mean[rows], covariance[rows]), found.boxes.array, found.covariance)
        mean[rows], covariance[rows] = matched.mean, matched.covariance
        score, latest = tracked.score.copy(), tracked.latest.copy()
        hits, misses = tracked.hits.copy(), tracked.misses.copy()
        score[rows] = self._scoring.hit(score[rows], found.score, tracked.age[rows])
        latest[rows] = found.score
        hits[rows] += misses[rows] > 0
        misses[rows] = 0
        foreign = tracked.foreign.copy()
        foreign[rows] = seen_by_others(found)
        memory = tracked.appearance
        if found.embedding is not None:
            memory = memory.update(rows, memory.readable(found))
        tracked = replace(tracked, score=score, latest=latest, hits=hits, misses=misses, foreign=foreign)
        return self._believing(replace(tracked, appearance=memory), Beliefs(mean, covariance))

    def _begin(self, found: Detections, first_id: int, memory: EmbeddingMemory) -> Tracked:
        count = len(found)
        beliefs = self._motion.initiate(found.boxes.array, found.covariance)
        ids, none, ones = first_id + np.arange(count), np.zeros(count, dtype=np.int64), np.ones(count, dtype=np.int64)
        boxes, velocity = self._motion.boxes(beliefs), self._motion.velocity(beliefs)
        score, looks = self._scoring.first(found.score), memory.born(memory.readable(found))
        return Tracked(
            beliefs,
            boxes,
            velocity,
            ids,
            found.label,
            score,
            found.score,
            score,
            ones,
            none,
            none,
            seen_by_others(found),
            looks,
        )

    def _believing(self, tracked: Tracked, beliefs: Beliefs) -> Tracked:
        boxes, velocity = self._motion.boxes(beliefs), self._motion.velocity(beliefs)
        return replace(tracked, beliefs=beliefs, boxes=boxes, velocity=velocity)


def _refreshed(tracked: Tracked, rows: Ints, columns: Ints, found: Detections, shown: Ints) -> Tracked:
    """Add to the memory of each matched track what its repeated detections look like.

    Args:
        tracked: the tracks.
        rows: (K,) matched tracks.
        columns: (K,) their detections.
        found: N detections.
        shown: (N,) as from `Appearance.repeats`.
    """
    row_of = np.full(len(found), -1)
    row_of[columns] = rows
    repeated = np.flatnonzero((shown != np.arange(len(found))) & (row_of[shown] >= 0))
    memory = tracked.appearance
    while len(repeated):  # once for each agent that saw the same object
        at, first = np.unique(row_of[shown[repeated]], return_index=True)
        memory = memory.update(at, memory.readable(found[repeated[first]]))
        repeated = np.delete(repeated, first)
    return replace(tracked, appearance=memory)


FARTHEST_M = 10_000.0
"""Nothing farther from an agent along any axis is taken in: no sensor sees and no radio reaches as far."""


def reportable(detections: Detections) -> Detections:
    """What is `sane`, of a class that a report can name, and within `FARTHEST_M` of the agent.

    Args:
        detections: in an agent's base frame.
    """
    found = sane(detections)
    good = (found.label >= 0) & (found.label < len(CLASS_NAMES))
    good &= (np.abs(found.boxes.center) <= FARTHEST_M).all(axis=1)
    return found if good.all() else found[good]


def sane(detections: Detections) -> Detections:
    """Leave out what cannot be tracked: boxes or scores that are not finite, sizes that are not positive."""
    boxes = detections.boxes
    good = np.isfinite(boxes.array).all(axis=1) & np.isfinite(detections.score) & (boxes.size > 0).all(axis=1)
    if detections.covariance is not None:
        good &= np.isfinite(detections.covariance).all(axis=(1, 2))
    return detections if good.all() else detections[good]
