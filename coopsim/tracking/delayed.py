"""Strategies for delayed measurements: those that arrive after their capture frame, or out of order.

From cheap to exact: `AsIfCurrent`, `PredictForward`, `RewindAndReplay`.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace
from operator import lt
from typing import Any, overload

import numpy as np

from coopsim.geometry.boxes import Boxes3D
from coopsim.support.checks import require_positive
from coopsim.support.registry import Registry
from coopsim.tracking.by_class import TrackersByClass
from coopsim.tracking.tracker import Tracker
from coopsim.types import NS_PER_S, Detections, Tracks, seconds_to_ns
from coopsim.types.groups import DetectionGroups

RECEIVER = ""
"""The source of the receiver's own measurements; it sorts before the names of all senders."""

MakeTracker = Callable[[], Tracker | TrackersByClass]

Fusion = Callable[[Sequence[Detections]], Sequence[Detections]]
"""Turns one moment's detections, a group per source with the most trusted first, into groups that are tracked in
turn."""


def in_turn(groups: Sequence[Detections]) -> Sequence[Detections]:
    """Return the groups as they are: each source updates the tracks, one after another."""
    return groups


@dataclass(frozen=True, slots=True, eq=False)
class Measurement:
    """The detections of one source at one moment.

    Attributes:
        source: name of the sender; `RECEIVER` for the agent itself.
        captured_ns: capture time.
        detections: valid ones (see `drop_invalid`), in the tracker's frame.
    """

    source: str
    captured_ns: int
    detections: Detections


@dataclass(frozen=True, slots=True, eq=False)
class Measurements(Sequence[Measurement]):
    """Measurements with their detections joined, so that those of one moment stay joined up to the fusion.

    Attributes:
        sources: name of each sender, as in `Measurement`.
        captured_ns: the capture times.
        groups: the detections.
    """

    sources: Sequence[str]
    captured_ns: Sequence[int]
    groups: DetectionGroups

    @classmethod
    def of(cls, measurements: Sequence[Measurement]) -> Measurements:
        """Join measurements; what is joined already is returned as it is."""
        if isinstance(measurements, Measurements):
            return measurements
        sources, captured_ns = [each.source for each in measurements], [each.captured_ns for each in measurements]
        return cls(sources, captured_ns, DetectionGroups.of(each.detections for each in measurements))

    def __len__(self) -> int:
        return len(self.sources)

    @overload
    def __getitem__(self, index: int) -> Measurement: ...

    @overload
    def __getitem__(self, index: slice) -> Sequence[Measurement]: ...

    def __getitem__(self, index: int | slice) -> Measurement | Sequence[Measurement]:
        if isinstance(index, slice):
            return [self[number] for number in range(len(self))[index]]
        return Measurement(self.sources[index], self.captured_ns[index], self.groups[index])


class DelayedMeasurements(ABC):
    """A tracker together with a strategy for delayed measurements.

    Args:
        make_tracker: makes the tracker.
        fusion: applied to the measurements of one moment.
        first: the source whose measurements come first; the others follow in order of their names.
    """

    def __init__(self, make_tracker: MakeTracker, fusion: Fusion = in_turn, first: str = RECEIVER) -> None:
        self.tracker, self._fusion, self._first = make_tracker(), fusion, first

    def step(self, measurements: Sequence[Measurement], now_ns: int) -> Tracks:
        """Take in the measurements that arrived since the last step and return the tracks at `now_ns`.

        Args:
            measurements: in any order; those captured after `now_ns` count as captured now.
            now_ns: time of this step; must not go back.

        Raises:
            InvalidValueError: time went back.
        """
        self.tracker.require_time(now_ns)
        return self._step(Measurements.of(measurements), now_ns)

    @abstractmethod
    def _step(self, measurements: Measurements, now_ns: int) -> Tracks:
        """Take in the measurements; the time is known not to go back."""

    def _track(self, groups: Sequence[Detections], time_ns: int, *, incomplete: bool = False) -> Tracks:
        return self.tracker.step_in_turn(self._fusion(groups), time_ns, incomplete=incomplete)

    def _in_order(self, sources: Iterable[str]) -> list[str]:
        return sorted(sources, key=lambda source: (source != self._first, source))

    def _newest(self, measurements: Measurements) -> list[int]:
        """Return the number of each source's last captured measurement, in the order of `_in_order`."""
        sources = list(measurements.sources)
        if sources[:1] == [self._first] and all(map(lt, sources[1:], sources[2:])) and self._first not in sources[1:]:
            return list(range(len(sources)))  # one of each, in order: as a policy makes them
        latest: dict[str, int] = {}
        for number, (source, captured_ns) in enumerate(
            zip(measurements.sources, measurements.captured_ns, strict=True)
        ):
            known = latest.get(source)
            if known is None or captured_ns >= measurements.captured_ns[known]:
                latest[source] = number
        return [latest[source] for source in self._in_order(latest)]


class AsIfCurrent(DelayedMeasurements):
    """The newest measurement of each source counts as captured now: objects lag behind by the delay."""

    def _step(self, measurements: Measurements, now_ns: int) -> Tracks:
        return self._track(measurements.groups.take(self._newest(measurements)), now_ns)


_EXPIRY_NS = 5 * NS_PER_S
"""Measurements that are older are dropped, and silent sources are forgotten after this time: names may change."""


class PredictForward(DelayedMeasurements):
    """Delayed detections are moved on to now by the velocity of their object.

    Every sender has a tracker of its own, in its own time, which gives the velocities. Velocities of the receiver's
    tracks would not do: a measurement that was moved with a velocity confirms it, and the error grows from frame to
    frame.
    """

    def __init__(self, make_tracker: MakeTracker, fusion: Fusion = in_turn, first: str = RECEIVER) -> None:
        super().__init__(make_tracker, fusion, first)
        self._make_tracker = make_tracker
        self._sources: dict[str, Tracker | TrackersByClass] = {}

    def _step(self, measurements: Measurements, now_ns: int) -> Tracks:
        oldest_ns = now_ns - _EXPIRY_NS
        self._sources = {name: each for name, each in self._sources.items() if (each.time_ns or 0) >= oldest_ns}
        newest = (measurements[number] for number in self._newest(measurements))
        return self._track(DetectionGroups.of(self._moved(measurement, now_ns) for measurement in newest), now_ns)

    def _moved(self, measurement: Measurement, now_ns: int) -> Detections:
        """Return the detections where their objects should be at `now_ns`; none if they are overtaken or expired."""
        found, captured_ns = measurement.detections, min(measurement.captured_ns, now_ns)
        if measurement.source == RECEIVER:
            return found
        source = self._sources.get(measurement.source) or self._make_tracker()
        overtaken = source.time_ns is not None and captured_ns <= source.time_ns
        if overtaken or captured_ns < now_ns - _EXPIRY_NS:
            return Detections.empty()
        moved = source.velocity_of(found, captured_ns) * (now_ns - captured_ns) / NS_PER_S
        source.step(found, captured_ns)
        self._sources[measurement.source] = source
        center = found.boxes.center + np.pad(moved, ((0, 0), (0, 1)))
        return replace(found, boxes=Boxes3D(center, found.boxes.size, found.boxes.yaw))


@dataclass(slots=True)
class _Moment:
    """A step of the tracker.

    Attributes:
        time_ns: its time.
        groups: by source, the detections: a group, by its number, among those that came with it.
        joined: the groups in order; None: not joined yet, or not since the last came.
        before: the tracker's state before the step.
        incomplete: more groups may come.
    """

    time_ns: int
    groups: dict[str, tuple[DetectionGroups, int]] = field(default_factory=dict)
    joined: DetectionGroups | None = None
    before: Any = None
    incomplete: bool = False

    def joined_in(self, order: Sequence[str]) -> DetectionGroups:
        """Return the groups of these sources, which must be all; joined once, until another group comes."""
        if self.joined is None:
            groups = [self.groups[source] for source in order]
            together = {id(whole): whole for whole, _ in groups}
            if len(together) == 1:
                self.joined = groups[0][0].take([number for _, number in groups])
            else:
                self.joined = DetectionGroups.of(whole[number] for whole, number in groups)
        return self.joined


class RewindAndReplay(DelayedMeasurements):
    """The tracker is rewound to the capture time of a delayed measurement, and tracks again from there.

    Exact: once everything has arrived, the tracks are those of a tracker to which everything came on time. The cost is
    as many steps as the oldest new measurement is delayed by. The same measurement twice counts once.

    A moment later than the newest measurement of some source is incomplete: until that source's message has come, or
    the source has been silent for the whole window, no track counts as missed there. Else objects that only senders
    see would be dropped before the messages about them can have arrived.

    Args:
        make_tracker: makes the tracker.
        fusion: applied to the measurements of one moment.
        first: the source whose measurements come first.
        window_s: measurements that are delayed by more are dropped.
    """

    def __init__(
        self, make_tracker: MakeTracker, fusion: Fusion = in_turn, first: str = RECEIVER, window_s: float = 1.0
    ) -> None:
        super().__init__(make_tracker, fusion, first)
        require_positive(window_s=window_s)
        self._window_ns = seconds_to_ns(window_s)
        self._moments: list[_Moment] = []
        self._newest_ns: dict[str, int] = {}

    def _step(self, measurements: Measurements, now_ns: int) -> Tracks:
        self._moments = [moment for moment in self._moments if moment.time_ns >= now_ns - self._window_ns]
        moments = {moment.time_ns: moment for moment in self._moments}
        moments.setdefault(now_ns, _Moment(now_ns))
        oldest_ns, first_ns = min(moments), now_ns
        for number, source in enumerate(measurements.sources):
            captured_ns = min(measurements.captured_ns[number], now_ns)
            if captured_ns < oldest_ns:
                continue
            moment = moments.setdefault(captured_ns, _Moment(captured_ns))
            if source not in moment.groups:
                moment.groups[source], moment.joined = (measurements.groups, number), None
                first_ns = min(first_ns, captured_ns)
                self._newest_ns[source] = max(captured_ns, self._newest_ns.get(source, 0))
        self._moments = [moments[time_ns] for time_ns in sorted(moments)]
        return self._replay(min(first_ns, self._mark_incomplete(now_ns)))

    def _mark_incomplete(self, now_ns: int) -> int:
        """Mark incomplete moments; return the time of the first that has become complete, or `now_ns`."""
        oldest_ns = now_ns - self._window_ns
        self._newest_ns = {source: newest_ns for source, newest_ns in self._newest_ns.items() if newest_ns >= oldest_ns}
        whole_ns = min(self._newest_ns.values(), default=now_ns)
        changed_ns = now_ns
        for moment in reversed(self._moments):
            incomplete = moment.time_ns > whole_ns
            if moment.incomplete and not incomplete:
                changed_ns = moment.time_ns
            moment.incomplete = incomplete
        return changed_ns

    def _replay(self, first_ns: int) -> Tracks:
        """Track again from the first moment at or after `first_ns`."""
        again = [moment for moment in self._moments if moment.time_ns >= first_ns]
        # The state before a moment that is new among older ones is that of the moment after it.
        known = next((moment.before for moment in again if moment.before is not None), None)
        if known is not None:
            self.tracker.state = known
        for moment in again:
            moment.before = self.tracker.state
            groups = moment.joined_in(self._in_order(moment.groups))
            tracks = self._track(groups, moment.time_ns, incomplete=moment.incomplete)
        return tracks


DELAYED: Registry[type[DelayedMeasurements]] = Registry("delayed")
DELAYED.register("as_current")(AsIfCurrent)
DELAYED.register("predict")(PredictForward)
DELAYED.register("replay")(RewindAndReplay)
