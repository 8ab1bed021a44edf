"""Tracking by detection: predict, associate, update, begin, end. All tracks at once."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from coopsim.errors import InvalidValueError
from coopsim.geometry.boxes import Boxes3D
from coopsim.geometry.se3 import Floats
from coopsim.tracking.cascade import Cascade
from coopsim.tracking.lifecycle import Lifecycle, Mask
from coopsim.tracking.motion import Beliefs, Motion
from coopsim.types import NS_PER_S, Detections, Ints, Tracks


@dataclass(frozen=True, slots=True, eq=False)
class _State:
    """N tracks, reported or not; all arrays have N rows."""

    beliefs: Beliefs
    id: Ints
    label: Ints
    score: Floats
    hits: Ints
    misses: Ints

    def take(self, index: Mask) -> _State:
        return _State(
            Beliefs(self.beliefs.mean[index], self.beliefs.covariance[index]),
            self.id[index],
            self.label[index],
            self.score[index],
            self.hits[index],
            self.misses[index],
        )

    def join(self, other: _State) -> _State:
        mine, theirs = self.beliefs, other.beliefs
        return _State(
            Beliefs(np.concatenate([mine.mean, theirs.mean]), np.concatenate([mine.covariance, theirs.covariance])),
            np.concatenate([self.id, other.id]),
            np.concatenate([self.label, other.label]),
            np.concatenate([self.score, other.score]),
            np.concatenate([self.hits, other.hits]),
            np.concatenate([self.misses, other.misses]),
        )


class Tracker:
    """A tracker, composed of how objects move, how they are recognised, and when they come and go.

    All boxes are in one frame that does not move with the observer (world or odometry). Ids count from 1
    and are never used twice. Memory is that of the tracks alive.

    Args:
        motion: the motion model and its filter.
        association: matches predicted tracks to detections.
        lifecycle: what is reported and what is dropped.
    """

    def __init__(self, motion: Motion, association: Cascade, lifecycle: Lifecycle) -> None:
        self._motion, self._association, self._lifecycle = motion, association, lifecycle
        self.reset()

    def reset(self) -> None:
        """Forget everything."""
        self._state = self._born(Detections.empty(), first_id=1)
        self._next_id, self._frame = 1, 0
        self._time_ns: int | None = None

    def step(self, detections: Detections, time_ns: int) -> Tracks:
        """Take in one frame's detections; the tracks at its time.

        Detections that are not finite or have no size are left out.

        Args:
            detections: in the tracker's frame; an empty frame is a frame too.
            time_ns: of the frame; must not go back.

        Raises:
            InvalidValueError: time went back.
        """
        found = sane(detections)
        state = self._predicted(time_ns)
        rows, columns = self._association.match(
            self._motion.boxes(state.beliefs), state.label, found.boxes.array, found.label
        )
        state = self._updated(state, rows, found[columns])
        born = self._born(found[np.setdiff1d(np.arange(len(found)), columns)], self._next_id)
        self._next_id += len(born.id)
        state = state.join(born)
        self._state = state.take(self._lifecycle.alive(state.misses))
        return self._report(self._state)

    def _predicted(self, time_ns: int) -> _State:
        elapsed_ns = 0 if self._time_ns is None else time_ns - self._time_ns
        if elapsed_ns < 0:
            raise InvalidValueError(f"time must not go back, got {time_ns} ns after {self._time_ns} ns")
        self._time_ns, self._frame = time_ns, self._frame + 1
        beliefs = self._motion.predict(self._state.beliefs, elapsed_ns / NS_PER_S)
        return replace(self._state, beliefs=beliefs, misses=self._state.misses + 1)

    def _updated(self, state: _State, rows: Ints, found: Detections) -> _State:
        if not len(rows):
            return state
        mean, covariance = state.beliefs.mean.copy(), state.beliefs.covariance.copy()
        matched = Beliefs(mean[rows], covariance[rows])
        matched = self._motion.update(matched, found.boxes.array, found.covariance)
        mean[rows], covariance[rows] = matched.mean, matched.covariance
        score, hits, misses = state.score.copy(), state.hits.copy(), state.misses.copy()
        score[rows], misses[rows] = found.score, 0
        hits[rows] += 1
        return _State(Beliefs(mean, covariance), state.id, state.label, score, hits, misses)

    def _born(self, found: Detections, first_id: int) -> _State:
        count = len(found)
        beliefs = self._motion.initiate(found.boxes.array, found.covariance)
        ids, ones = first_id + np.arange(count), np.ones(count, dtype=np.int64)
        return _State(beliefs, ids, found.label, found.score, ones, np.zeros(count, dtype=np.int64))

    def _report(self, state: _State) -> Tracks:
        shown = state.take(self._lifecycle.reported(state.hits, state.misses, self._frame))
        boxes = Boxes3D.from_array(self._motion.boxes(shown.beliefs))
        # A filter may shrink a box through zero; a report of it would be refused.
        boxes = Boxes3D(boxes.center, np.maximum(boxes.size, 1e-3), boxes.yaw)
        return Tracks(shown.id, boxes, self._motion.velocity(shown.beliefs), shown.score, shown.label)


def sane(detections: Detections) -> Detections:
    """Leave out what cannot be tracked: boxes or scores that are not finite, sizes that are not positive."""
    boxes = detections.boxes
    good = np.isfinite(boxes.array).all(axis=1) & np.isfinite(detections.score) & (boxes.size > 0).all(axis=1)
    if detections.covariance is not None:
        good &= np.isfinite(detections.covariance).all(axis=(1, 2))
    return detections if good.all() else detections[good]
