"""What to do with measurements that arrive late, or in another order than they were taken.

Three strategies, from cheap to exact: `AsIfCurrent`, `PredictForward`, `RewindAndReplay`.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from coopsim.geometry.boxes import Boxes3D
from coopsim.support.checks import require_positive
from coopsim.support.registry import Registry
from coopsim.tracking.by_class import TrackersByClass
from coopsim.tracking.tracker import Tracker, sane
from coopsim.types import NS_PER_S, Detections, Tracks, seconds_to_ns

RECEIVER = ""
"""The source of the receiver's own measurements; it sorts before the names of all senders."""

MakeTracker = Callable[[], Tracker | TrackersByClass]

Fusion = Callable[[Sequence[Detections]], Sequence[Detections]]
"""What is made of one moment's detections before they are tracked: one group per source, the most trusted first, to
groups that are tracked in turn."""


def in_turn(groups: Sequence[Detections]) -> Sequence[Detections]:
    """No fusion: every source updates the tracks for itself, one after another."""
    return groups


@dataclass(frozen=True, slots=True, eq=False)
class Measurement:
    """What one source detected at one moment.

    Attributes:
        source: who; `RECEIVER` for the agent itself.
        captured_ns: when.
        detections: in the tracker's frame.
    """

    source: str
    captured_ns: int
    detections: Detections


class DelayedMeasurements(ABC):
    """A tracker together with a way to take in what comes late.

    Args:
        make_tracker: gives the tracker.
        fusion: is applied to the measurements of one moment.
        first: the source whose measurements come first; the others follow in order of their names.
    """

    def __init__(self, make_tracker: MakeTracker, fusion: Fusion = in_turn, first: str = RECEIVER) -> None:
        self.tracker, self._fusion, self._first = make_tracker(), fusion, first

    @abstractmethod
    def step(self, measurements: Sequence[Measurement], now_ns: int) -> Tracks:
        """Take in what arrived since the last step; the tracks now.

        Args:
            measurements: in any order; those captured after `now_ns` count as captured now.
            now_ns: must not go back.

        Raises:
            InvalidValueError: time went back.
        """

    def _track(self, groups: Sequence[Detections], time_ns: int, *, awaited: bool = False) -> Tracks:
        return self.tracker.step_in_turn(self._fusion(groups), time_ns, awaited=awaited)

    def _in_order(self, sources: Iterable[str]) -> list[str]:
        return sorted(sources, key=lambda source: (source != self._first, source))

    def _newest(self, measurements: Sequence[Measurement]) -> list[Measurement]:
        """The last captured measurement of each source."""
        latest: dict[str, Measurement] = {}
        for measurement in measurements:
            known = latest.get(measurement.source)
            if known is None or measurement.captured_ns >= known.captured_ns:
                latest[measurement.source] = measurement
        return [latest[source] for source in self._in_order(latest)]


class AsIfCurrent(DelayedMeasurements):
    """Takes the newest measurement of each source as if it were captured now: objects lag behind by the delay."""

    def step(self, measurements: Sequence[Measurement], now_ns: int) -> Tracks:
        return self._track([measurement.detections for measurement in self._newest(measurements)], now_ns)


_WORTHLESS_NS = 5 * NS_PER_S
"""What was captured longer ago is not moved on, and who has been silent for longer is forgotten: names may change."""


class PredictForward(DelayedMeasurements):
    """Moves what is late to where it should be by now.

    Every other source has a tracker of its own, in its own time, and what it detects moves on with the velocity that
    the object has there. Velocities of the tracks themselves would not do: a measurement that was moved with a
    velocity confirms it, and the error grows from frame to frame.
    """

    def __init__(self, make_tracker: MakeTracker, fusion: Fusion = in_turn, first: str = RECEIVER) -> None:
        super().__init__(make_tracker, fusion, first)
        self._make_tracker = make_tracker
        self._sources: dict[str, Tracker | TrackersByClass] = {}

    def step(self, measurements: Sequence[Measurement], now_ns: int) -> Tracks:
        self.tracker.require_time(now_ns)
        oldest_ns = now_ns - _WORTHLESS_NS
        self._sources = {name: each for name, each in self._sources.items() if (each.time_ns or 0) >= oldest_ns}
        return self._track([self._moved(measurement, now_ns) for measurement in self._newest(measurements)], now_ns)

    def _moved(self, measurement: Measurement, now_ns: int) -> Detections:
        found, captured_ns = sane(measurement.detections), min(measurement.captured_ns, now_ns)
        if measurement.source == RECEIVER:
            return found
        source = self._sources.get(measurement.source) or self._make_tracker()
        overtaken = source.time_ns is not None and captured_ns <= source.time_ns
        if overtaken or captured_ns < now_ns - _WORTHLESS_NS:
            return Detections.empty()
        moved = source.velocity_of(found, captured_ns) * (now_ns - captured_ns) / NS_PER_S
        source.step(found, captured_ns)
        self._sources[measurement.source] = source
        center = found.boxes.center + np.pad(moved, ((0, 0), (0, 1)))
        return replace(found, boxes=Boxes3D(center, found.boxes.size, found.boxes.yaw))


@dataclass(slots=True)
class _Moment:
    """One step of the tracker: what it knew before, what it was given, and whether more was awaited."""

    time_ns: int
    groups: dict[str, Detections] = field(default_factory=dict)
    before: Any = None
    awaited: bool = False


class RewindAndReplay(DelayedMeasurements):
    """Goes back to when a measurement was captured, and tracks again from there.

    Exact: once everything has arrived, the tracks are those of a tracker to which everything came on time. Costs as
    many steps as the oldest new measurement is late. The same measurement twice counts once.

    What was captured later than the newest measurement of some source is only half of what will be known of that
    moment: until that source has been heard, or has been silent for the whole window, no track counts as missed there.
    Else what only others see would be given up before the news of it can have arrived.

    Args:
        make_tracker: gives the tracker.
        fusion: is applied to the measurements of one moment.
        first: the source whose measurements come first.
        window_s: what is later than this is left out.
    """

    def __init__(
        self, make_tracker: MakeTracker, fusion: Fusion = in_turn, first: str = RECEIVER, window_s: float = 1.0
    ) -> None:
        super().__init__(make_tracker, fusion, first)
        require_positive(window_s=window_s)
        self._window_ns = seconds_to_ns(window_s)
        self._moments: list[_Moment] = []
        self._heard_ns: dict[str, int] = {}

    def step(self, measurements: Sequence[Measurement], now_ns: int) -> Tracks:
        self.tracker.require_time(now_ns)
        self._moments = [moment for moment in self._moments if moment.time_ns >= now_ns - self._window_ns]
        moments = {moment.time_ns: moment for moment in self._moments}
        moments.setdefault(now_ns, _Moment(now_ns))
        oldest_ns, first_ns = min(moments), now_ns
        for measurement in measurements:
            captured_ns = min(measurement.captured_ns, now_ns)
            if captured_ns < oldest_ns:
                continue
            moment = moments.setdefault(captured_ns, _Moment(captured_ns))
            if measurement.source not in moment.groups:
                moment.groups[measurement.source] = measurement.detections
                first_ns = min(first_ns, captured_ns)
                self._heard_ns[measurement.source] = max(captured_ns, self._heard_ns.get(measurement.source, 0))
        self._moments = [moments[time_ns] for time_ns in sorted(moments)]
        return self._replay(min(first_ns, self._await(now_ns)))

    def _await(self, now_ns: int) -> int:
        """Mark the moments of which more may come; the first that was one and is none any more, or now."""
        oldest_ns = now_ns - self._window_ns
        self._heard_ns = {source: heard_ns for source, heard_ns in self._heard_ns.items() if heard_ns >= oldest_ns}
        whole_ns = min(self._heard_ns.values(), default=now_ns)
        changed_ns = now_ns
        for moment in reversed(self._moments):
            awaited = moment.time_ns > whole_ns
            if moment.awaited and not awaited:
                changed_ns = moment.time_ns
            moment.awaited = awaited
        return changed_ns

    def _replay(self, first_ns: int) -> Tracks:
        """Track again from the first moment at or after `first_ns`."""
        again = [moment for moment in self._moments if moment.time_ns >= first_ns]
        # The state before a moment that is new among older ones stands with the moment after it.
        known = next((moment.before for moment in again if moment.before is not None), None)
        if known is not None:
            self.tracker.state = known
        for moment in again:
            moment.before = self.tracker.state
            groups = [moment.groups[source] for source in self._in_order(moment.groups)]
            tracks = self._track(groups, moment.time_ns, awaited=moment.awaited)
        return tracks


DELAYED: Registry[type[DelayedMeasurements]] = Registry("way to take in delayed measurements")
DELAYED.register("as_current")(AsIfCurrent)
DELAYED.register("predict")(PredictForward)
DELAYED.register("replay")(RewindAndReplay)
