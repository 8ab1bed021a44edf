"""Rules by class: one tracker for each set of classes, side by side."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from coopsim.errors import InvalidValueError
from coopsim.geometry.boxes import Boxes3D
from coopsim.geometry.se3 import Floats
from coopsim.tracking.tracker import Tracker, TrackerState
from coopsim.types import Detections, Ints, Mask, Tracks


class TrackersByClass:
    """Trackers by class, with the interface of one tracker: motion, association and lifecycle may all differ.

    No track changes its class, so the trackers are independent. Ids are those of the trackers, interleaved so that they
    never collide.

    Args:
        others: the tracker of all classes that `by_class` does not name.
        by_class: trackers, by the classes they are for.

    Raises:
        InvalidValueError: a class has two trackers.
    """

    def __init__(self, others: Tracker, by_class: Mapping[tuple[int, ...], Tracker]) -> None:
        self._trackers = (others, *by_class.values())
        self._number: dict[int, int] = {}
        for number, labels in enumerate(by_class, start=1):
            for label in labels:
                if label in self._number:
                    raise InvalidValueError(f"class {label} has two trackers")
                self._number[int(label)] = number

    @property
    def state(self) -> tuple[TrackerState, ...]:
        """The complete states of the trackers; may be set to earlier ones."""
        return tuple(tracker.state for tracker in self._trackers)

    @state.setter
    def state(self, states: tuple[TrackerState, ...]) -> None:
        for tracker, state in zip(self._trackers, states, strict=True):
            tracker.state = state

    @property
    def time_ns(self) -> int | None:
        """Time of the last frame; None before the first."""
        return self._trackers[0].time_ns

    def require_time(self, time_ns: int) -> None:
        """Raise `InvalidValueError` if a time lies before the last frame."""
        self._trackers[0].require_time(time_ns)

    def step(self, detections: Detections, time_ns: int) -> Tracks:
        """Take in one frame's detections, as `Tracker.step` does."""
        return self.step_in_turn([detections], time_ns)

    def step_in_turn(self, groups: Sequence[Detections], time_ns: int) -> Tracks:
        """Take in one frame's groups of detections, as `Tracker.step_in_turn` does."""
        self.require_time(time_ns)
        tracker_of = [self._tracker_of(group.label) for group in groups]
        reports = [
            tracker.step_in_turn(
                [_of_tracker(k, group, number) for group, number in zip(groups, tracker_of, strict=True)],
                time_ns,
            )
            for k, tracker in enumerate(self._trackers)
        ]
        count = len(self._trackers)
        return Tracks(
            np.concatenate([report.id * count + k for k, report in enumerate(reports)]),
            Boxes3D.concatenate(report.boxes for report in reports),
            np.concatenate([report.velocity for report in reports]),
            np.concatenate([report.score for report in reports]),
            np.concatenate([report.label for report in reports]),
        )

    def known(self, detections: Detections, time_ns: int) -> tuple[Floats, Mask]:
        """Return velocities (N, 2) of matching tracks, and whether they are confirmed (N,), as `Tracker.known` does."""
        number = self._tracker_of(detections.label)
        velocity, confirmed = np.zeros((len(detections), 2)), np.zeros(len(detections), dtype=np.bool_)
        for k, tracker in enumerate(self._trackers):
            velocity[number == k], confirmed[number == k] = tracker.known(detections[number == k], time_ns)
        return velocity, confirmed

    def _tracker_of(self, label: Ints) -> Ints:
        """Return the number (N,) of the tracker for each label."""
        numbers = np.zeros(len(label), dtype=np.int64)
        for each, number in self._number.items():
            numbers[label == each] = number
        return numbers


def _of_tracker(tracker: int, group: Detections, number: Ints) -> Detections:
    """Return the detections of a group that one tracker is for; `number` (N,) is that of each one's tracker."""
    mine = number == tracker
    return group if mine.all() else group[mine]
