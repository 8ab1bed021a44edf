"""Tracking by detection: predict, associate, update, initiate, drop. All tracks at once."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from coopsim.errors import InvalidValueError
from coopsim.geometry.assignment import Pairs
from coopsim.geometry.boxes import Boxes3D
from coopsim.geometry.se3 import Floats
from coopsim.tracking.appearance import Appearance, seen_by_others
from coopsim.tracking.cascade import Cascade, Selector, everything
from coopsim.tracking.lifecycle import Latest, Lifecycle, Scoring
from coopsim.tracking.motion.constant_velocity import Beliefs, Motion
from coopsim.tracking.track_states import EmbeddingMemory, TrackStates
from coopsim.types import NS_PER_S, Detections, Ints, Mask, Tracks, seconds_to_ns
from coopsim.types.groups import DetectionGroups
from coopsim.types.valid_detections import drop_invalid


@dataclass(frozen=True, slots=True)
class AssociationRound:
    """The rules for one group of detections.

    Attributes:
        association: matches tracks to the group's detections.
        initiator: selects the unmatched detections that begin a track.
    """

    association: Cascade
    initiator: Selector = everything


@dataclass(frozen=True, slots=True, eq=False)
class TrackerState:
    """The complete state of a tracker. It never changes, so keeping one costs nothing; see `Tracker.state`.

    Attributes:
        tracked: the tracks, reported or not.
        next_id: the id of the next track.
        frame: number of frames so far.
        time_ns: time of the last frame; None before the first.
    """

    tracked: TrackStates
    next_id: int
    frame: int
    time_ns: int | None


class Tracker:
    """A tracker, composed of a motion model, an association and a lifecycle.

    All boxes are in one frame that does not move with the observer (world or odometry). Ids count from 1 and are never
    used twice. Only tracks that are alive take memory.

    Attributes:
        state: the tracker's complete state; may be set to an earlier one, to track again from there.
        motion: the motion model and its filter.
        lifecycle: the rule that selects the tracks that are reported and kept.
        appearance: the model of embeddings, or None.
        first_round: the rules for the first group of detections.

    Args:
        motion: the motion model and its filter.
        association: matches predicted tracks to detections.
        lifecycle: selects the tracks that are reported and kept.
        scoring: model of a track's score from the scores of its detections; None: `Latest`.
        initiator: selects the unmatched detections that begin a track.
        later: rules for the groups after the first, see `step_in_turn`; None: the same.
        appearance: model of embeddings; None: embeddings are not used.
    """

    def __init__(
        self,
        motion: Motion,
        association: Cascade,
        lifecycle: Lifecycle,
        *,
        scoring: Scoring | None = None,
        initiator: Selector = everything,
        later: AssociationRound | None = None,
        appearance: Appearance | None = None,
    ) -> None:
        self.motion, self.lifecycle, self.appearance = motion, lifecycle, appearance
        self.first_round = AssociationRound(association, initiator)
        self._scoring, self._later = scoring or Latest(), later or self.first_round
        self.reset()

    def reset(self) -> None:
        """Forget everything, as before the first frame."""
        self.state = TrackerState(self.blank(), next_id=1, frame=0, time_ns=None)

    def blank(self) -> TrackStates:
        """Return no tracks, to which such can be joined."""
        memory = EmbeddingMemory.blank(0, dim=0, window=1 if self.appearance is None else self.appearance.views)
        nobody = np.zeros(0, dtype=np.int64)
        return self._initiate(Detections.empty(), np.zeros((0, 7)), nobody, 1, memory, time_ns=0)

    @property
    def time_ns(self) -> int | None:
        """Time of the last frame; None before the first."""
        return self.state.time_ns

    def require_time(self, time_ns: int) -> None:
        """Raise `InvalidValueError` if a time lies before the last frame."""
        if self.time_ns is not None and time_ns < self.time_ns:
            raise InvalidValueError(f"time must not go back, got {time_ns} ns after {self.time_ns} ns")

    def step(self, detections: Detections, time_ns: int) -> Tracks:
        """Take in one frame's detections and return the tracks at its time.

        Invalid detections are dropped (see `drop_invalid`).

        Args:
            detections: in the tracker's frame; an empty frame is a frame too.
            time_ns: time of the frame; must not go back.

        Raises:
            InvalidValueError: time went back.
        """
        return self.step_in_turn([detections], time_ns)

    def step_in_turn(self, groups: Sequence[Detections], time_ns: int) -> Tracks:
        """Take in one frame's detections from several sources, one after another, and return the tracks.

        Each group is matched to the tracks as the groups before left them, new tracks included. A frame counts as one
        hit or one miss, however many groups there are.

        Raises:
            InvalidValueError: time went back.
        """
        tracked, next_id = self.predict(time_ns), self.state.next_id
        for number, found in enumerate(_valid(groups)):
            rules = self._later if number else self.first_round
            if len(found):
                tracked, next_id = self._take_in(tracked, found, rules, next_id, time_ns)
        tracked, _ = self.finish(tracked)
        self.state = TrackerState(tracked, next_id, self.state.frame + 1, time_ns)
        return self.report()

    def finish(self, tracked: TrackStates) -> tuple[TrackStates, Ints]:
        """Return the tracks that are alive after a frame's detections, with their scores; and their rows before."""
        missed = np.flatnonzero(tracked.misses)
        tracked.score[missed] = self._scoring.miss(tracked.score[missed], tracked.age[missed])
        alive = self.lifecycle.alive(tracked)
        rows = np.flatnonzero(alive)
        tracked = tracked if alive.all() else tracked[rows]
        tracked.confidence[:] = self._scoring.confidence(tracked)
        return tracked, rows

    def known(self, detections: Detections, time_ns: int) -> tuple[Floats, Mask]:
        """Return the velocity (N, 2) m/s of the track that each detection would be matched to, 0 without one.

        The second result (N,) says whether that track is confirmed, so that it would be reported. The tracker's state
        stays. Detections must be valid (see `drop_invalid`), and `time_ns` must not lie before the last frame.
        """
        tracked = self.predict(time_ns)
        rows, columns = self.first_round.association.match(tracked, detections)
        velocity, confirmed = np.zeros((len(detections), 2)), np.zeros(len(detections), dtype=np.bool_)
        velocity[columns], confirmed[columns] = tracked.velocity[rows], self._were_reported(tracked)[rows]
        return velocity, confirmed

    def predict(self, time_ns: int) -> TrackStates:
        """Return the tracks predicted to a time, one frame older; the tracker's state stays.

        Raises:
            InvalidValueError: time went back.
        """
        self.require_time(time_ns)
        before = self.state.tracked
        elapsed_ns = 0 if self.time_ns is None else time_ns - self.time_ns
        predicted = self.motion.predict(before.beliefs, elapsed_ns / NS_PER_S) if len(before) else before.beliefs
        return self.age(before, predicted, time_ns)

    def age(self, before: TrackStates, predicted: Beliefs, time_ns: int) -> TrackStates:
        """Return tracks one frame older, with these beliefs; what is written to is not shared with those before."""
        beliefs = Beliefs(
            _apart_from(before.beliefs.mean, predicted.mean),
            _apart_from(before.beliefs.covariance, predicted.covariance),
        )
        return TrackStates(
            beliefs,
            self.motion.boxes(beliefs),
            self.motion.velocity(beliefs),
            before.id,
            before.label,
            before.score.copy(),
            before.latest.copy(),
            before.confidence.copy(),
            before.hits.copy(),
            before.misses + 1,
            before.age + 1,
            before.foreign.copy(),
            self._recent(before.appearance, time_ns),
        )

    def reported(self) -> TrackStates:
        """Return the full tracks behind the rows of `report`."""
        return self.state.tracked[self._reported_rows()]

    def report(self) -> Tracks:
        """Return the reported tracks, at the time of the last frame."""
        tracked, rows = self.state.tracked, self._reported_rows()
        boxes = tracked.boxes[rows]
        # A filter may shrink a box through zero; a report of it would be refused.
        np.maximum(boxes[:, 3:6], 1e-3, out=boxes[:, 3:6])
        shown = Boxes3D.from_array(boxes)
        return Tracks(tracked.id[rows], shown, tracked.velocity[rows], tracked.confidence[rows], tracked.label[rows])

    def _reported_rows(self) -> Ints:
        return np.flatnonzero(self.lifecycle.reported(self.state.tracked, self.state.frame))

    def _recent(self, memory: EmbeddingMemory, time_ns: int) -> EmbeddingMemory:
        """Return the memory of a time: without what is older than the window."""
        if self.appearance is None:
            return memory
        return memory.since(time_ns - seconds_to_ns(self.appearance.window_s))

    def _take_in(
        self, tracked: TrackStates, found: Detections, rules: AssociationRound, next_id: int, time_ns: int
    ) -> tuple[TrackStates, int]:
        """Return the tracks after one group of valid detections, the new ones last with ids from `next_id` on.

        The second result is the next id then.
        """
        if self.appearance is None or found.embedding is None:
            pairs = rules.association.match(tracked, found)
            tracked, new = self.take_in(tracked, found, pairs, next_id, time_ns, rules.initiator)
            return tracked, next_id + len(new)
        tracked = replace(tracked, appearance=tracked.appearance.ready_for(found))
        younger, columns = rules.association.match(tracked, found)
        rows = self.appearance.older(tracked, found, younger, columns, self._were_reported(tracked))
        if len(rows):
            tracked = self._update(tracked, rows, found, found.boxes.array, columns, time_ns)
        shown = self.appearance.repeats(found, columns, tracked.appearance.take(rows))
        tracked = _add_repeats(tracked, rows, columns, found, shown, time_ns)
        new = _unmatched(found, columns, rules.initiator, shown == np.arange(len(found)))
        if not np.array_equal(rows, younger):
            tracked = tracked[np.setdiff1d(np.arange(len(tracked)), np.setdiff1d(younger, rows))]
        return self._begin(tracked, found, new, next_id, time_ns), next_id + len(new)

    def take_in(
        self,
        tracked: TrackStates,
        found: Detections,
        pairs: Pairs,
        next_id: int,
        time_ns: int,
        initiator: Selector = everything,
    ) -> tuple[TrackStates, Ints]:
        """Return the tracks after valid detections that are matched to them, and the detections of the new, last ones.

        The new ones have ids from `next_id` on.
        """
        rows, columns = pairs
        if len(rows):
            tracked = self._update(tracked, rows, found, found.boxes.array, columns, time_ns)
        new = _unmatched(found, columns, initiator)
        return self._begin(tracked, found, new, next_id, time_ns), new

    def _begin(self, tracked: TrackStates, found: Detections, new: Ints, next_id: int, time_ns: int) -> TrackStates:
        """Return the tracks and new ones behind them, of the detections at `new` (K,)."""
        if not len(new):
            return tracked
        return tracked.join(self._initiate(found, found.boxes.array, new, next_id, tracked.appearance, time_ns))

    def _were_reported(self, tracked: TrackStates) -> Mask:
        """Return which predicted tracks (N,) have been reported, as far as their numbers of hits say."""
        return self.confirmed(tracked, self.state.frame + 1)

    def confirmed(self, tracked: TrackStates, frame: int | Ints) -> Mask:
        """Return which predicted tracks (N,) would be reported with a detection in this frame, or each in its own."""
        seen = replace(tracked, misses=np.zeros_like(tracked.misses))
        return self.lifecycle.reported(seen, frame)  # type: ignore[arg-type]  # see `Lifecycle.reported`

    def _update(
        self, tracked: TrackStates, rows: Ints, found: Detections, boxes: Floats, columns: Ints, time_ns: int
    ) -> TrackStates:
        """Return the tracks with those at `rows` (K,) updated by the detections at `columns` (K,), in place."""
        beliefs, covariance = tracked.beliefs, found.covariance
        matched = self.motion.update(
            Beliefs(beliefs.mean[rows], beliefs.covariance[rows]),
            boxes[columns],
            None if covariance is None else covariance[columns],
        )
        beliefs.mean[rows], beliefs.covariance[rows] = matched.mean, matched.covariance
        score = found.score[columns]
        tracked.score[rows] = self._scoring.hit(tracked.score[rows], score, tracked.age[rows])
        tracked.latest[rows] = score
        tracked.hits[rows] += tracked.misses[rows] > 0
        tracked.misses[rows] = 0
        tracked.foreign[rows] = seen_by_others(found)[columns]
        memory = tracked.appearance
        if found.embedding is not None and memory.dim:
            memory = memory.update(rows, memory.readable(found)[columns], time_ns)
        boxes, velocity = self.motion.boxes(beliefs), self.motion.velocity(beliefs)
        return replace(tracked, boxes=boxes, velocity=velocity, appearance=memory)

    def _initiate(
        self, found: Detections, boxes: Floats, new: Ints, first_id: int, memory: EmbeddingMemory, time_ns: int
    ) -> TrackStates:
        """Return new tracks, one for each of the detections at `new` (K,)."""
        count, covariance = len(new), found.covariance
        beliefs = self.motion.initiate(boxes[new], None if covariance is None else covariance[new])
        detected = found.score[new]
        score = self._scoring.first(detected)
        none = np.zeros(count, dtype=np.int64)
        return TrackStates(
            beliefs,
            self.motion.boxes(beliefs),
            self.motion.velocity(beliefs),
            first_id + np.arange(count),
            found.label[new],
            score,
            detected,
            score,
            np.ones(count, dtype=np.int64),
            none,
            none,
            seen_by_others(found)[new],
            memory.begin(memory.readable(found)[new], time_ns),
        )


def _valid(groups: Sequence[Detections]) -> Iterable[Detections]:
    """Return the groups without their invalid detections."""
    if isinstance(groups, DetectionGroups) and groups.parts is None and drop_invalid(groups.joined) is groups.joined:
        return groups  # as nearly always: one look at all of them was enough
    return map(drop_invalid, groups)


def _unmatched(found: Detections, columns: Ints, initiator: Selector, free: Mask | None = None) -> Ints:
    """Return the detections that begin tracks, of those that are free and not matched at `columns`."""
    free = np.ones(len(found), dtype=np.bool_) if free is None else free.copy()
    free[columns] = False
    new = np.flatnonzero(free)
    return new[initiator(found[new])] if len(new) and initiator is not everything else new


def _apart_from(before: Floats, now: Floats) -> Floats:
    """Return an array that may be written into while the one of the frame before stays."""
    return now if now.flags.writeable and not np.may_share_memory(before, now) else now.copy()


def _add_repeats(
    tracked: TrackStates, rows: Ints, columns: Ints, found: Detections, shown: Ints, time_ns: int
) -> TrackStates:
    """Add the embeddings of repeated detections to those of the tracks that they belong to.

    Tracks at `rows` (K,) were matched to the detections at `columns` (K,); `shown` (N,) is from `Appearance.repeats`.
    """
    row_of = np.full(len(found), -1)
    row_of[columns] = rows
    repeated = np.flatnonzero((shown != np.arange(len(found))) & (row_of[shown] >= 0))
    memory = tracked.appearance
    while len(repeated):  # once for each agent that saw the same object
        at, first = np.unique(row_of[shown[repeated]], return_index=True)
        memory = memory.update(at, memory.readable(found[repeated[first]]), time_ns)
        repeated = np.delete(repeated, first)
    return replace(tracked, appearance=memory)
