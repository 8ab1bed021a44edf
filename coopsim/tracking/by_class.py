"""Rules by class: one tracker for each set of classes, side by side."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from coopsim.errors import InvalidValueError
from coopsim.geometry.boxes import Boxes3D
from coopsim.geometry.se3 import Floats
from coopsim.tracking.tracker import Tracker, TrackerState
from coopsim.types import Detections, Ints, Tracks


class TrackersByClass:
    """Objects of a class are tracked by the tracker of that class: motion, association and lifecycle may all differ.

    No track changes its class, so the trackers have nothing to do with each other. Ids are those of the trackers,
    spread so that they never collide.

    Args:
        others: the tracker of all classes that have none of their own.
        own: trackers by the classes they are for.

    Raises:
        InvalidValueError: a class has two trackers.
    """

    def __init__(self, others: Tracker, own: Mapping[tuple[int, ...], Tracker]) -> None:
        self._trackers = (others, *own.values())
        self._number: dict[int, int] = {}
        for number, labels in enumerate(own, start=1):
            for label in labels:
                if label in self._number:
                    raise InvalidValueError(f"class {label} has two trackers")
                self._number[int(label)] = number

    @property
    def state(self) -> tuple[TrackerState, ...]:
        """All that the trackers know; may be set to an earlier one."""
        return tuple(tracker.state for tracker in self._trackers)

    @state.setter
    def state(self, states: tuple[TrackerState, ...]) -> None:
        for tracker, state in zip(self._trackers, states, strict=True):
            tracker.state = state

    @property
    def time_ns(self) -> int | None:
        """Of the last frame; None before the first."""
        return self._trackers[0].time_ns

    def require_time(self, time_ns: int) -> None:
        """Raise `InvalidValueError` if a time lies before the last frame."""
        self._trackers[0].require_time(time_ns)

    def step(self, detections: Detections, time_ns: int) -> Tracks:
        """As `Tracker.step`."""
        return self.step_in_turn([detections], time_ns)

    def step_in_turn(self, groups: Sequence[Detections], time_ns: int, *, awaited: bool = False) -> Tracks:
        """As `Tracker.step_in_turn`."""
        self.require_time(time_ns)
        whose = [self._whose(group.label) for group in groups]
        reports = [
            tracker.step_in_turn(
                [group[of == k] for group, of in zip(groups, whose, strict=True)], time_ns, awaited=awaited
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

    def velocity_of(self, detections: Detections, time_ns: int) -> Floats:
        """As `Tracker.velocity_of`."""
        whose, velocity = self._whose(detections.label), np.zeros((len(detections), 2))
        for k, tracker in enumerate(self._trackers):
            velocity[whose == k] = tracker.velocity_of(detections[whose == k], time_ns)
        return velocity

    def _whose(self, label: Ints) -> Ints:
        """(N,) number of the tracker for each label."""
        classes, index = np.unique(label, return_inverse=True)
        numbers = np.array([self._number.get(each, 0) for each in classes.tolist()], dtype=np.int64)
        return numbers[index]
