"""Strategies for delayed measurements: those that arrive after their capture frame, or out of order.

From cheap to exact: `AsIfCurrent`, `PredictForward`, `RewindAndReplay`.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from operator import lt
from typing import Any

import numpy as np

from coopsim.geometry.boxes import Boxes3D
from coopsim.geometry.se3 import Floats
from coopsim.support.checks import require_positive
from coopsim.support.registry import Registry
from coopsim.tracking.by_class import TrackersByClass
from coopsim.tracking.track_ids import LastingIds
from coopsim.tracking.tracker import Tracker
from coopsim.types import NS_PER_S, Detections, Mask, Tracks, seconds_to_ns
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
class Measurements:
    """Measurements with their detections joined, so that those of one moment stay joined up to the fusion.

    Attributes:
        sources: name of each sender, see `Measurement`.
        captured_ns: the capture times.
        groups: the detections.
    """

    sources: Sequence[str]
    captured_ns: Sequence[int]
    groups: DetectionGroups

    @classmethod
    def of(cls, measurements: Measurements | Sequence[Measurement]) -> Measurements:
        """Join measurements; joined ones are returned unchanged."""
        if isinstance(measurements, Measurements):
            return measurements
        sources, captured_ns = [each.source for each in measurements], [each.captured_ns for each in measurements]
        return cls(sources, captured_ns, DetectionGroups.of(each.detections for each in measurements))

    def __len__(self) -> int:
        return len(self.sources)


class DelayedMeasurements(ABC):
    """A tracker together with a strategy for delayed measurements.

    Args:
        make_tracker: makes the tracker.
        fusion: applied to the measurements of one moment.
        first: the source whose measurements come first; the others follow in order of their names.
    """

    def __init__(self, make_tracker: MakeTracker, fusion: Fusion = in_turn, first: str = RECEIVER) -> None:
        self.tracker, self._fusion, self._first = make_tracker(), fusion, first

    def step(self, measurements: Measurements | Sequence[Measurement], now_ns: int) -> Tracks:
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

    def _track(self, groups: Sequence[Detections], time_ns: int) -> Tracks:
        return self.tracker.step_in_turn(self._fusion(groups), time_ns)

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


@dataclass(frozen=True, slots=True, eq=False)
class _Moving:
    """A sender's measurement with the velocities of its objects.

    Attributes:
        captured_ns: capture time.
        detections: N.
        velocity: (N, 2) m/s, 0 where unknown.
        confirmed: (N,) whether the sender's tracker has confirmed the object before.
    """

    captured_ns: int
    detections: Detections
    velocity: Floats
    confirmed: Mask

    def at(self, time_ns: int) -> Detections:
        """Return the detections where their objects should be at a time."""
        moved, boxes = self.velocity * (time_ns - self.captured_ns) / NS_PER_S, self.detections.boxes
        center = boxes.center + np.pad(moved, ((0, 0), (0, 1)))
        return replace(self.detections, boxes=Boxes3D(center, boxes.size, boxes.yaw))


class _Senders:
    """Memory of senders' measurements and of the velocities of their objects.

    Boxes that were sent with velocities have these. For all others every sender has a tracker of its own, in its own
    time. Velocities of the receiver's tracks would not do: a measurement that was moved with a velocity confirms it,
    and the error grows from frame to frame.
    """

    def __init__(self, make_tracker: MakeTracker) -> None:
        self._make_tracker = make_tracker
        self._trackers: dict[str, Tracker | TrackersByClass] = {}
        self._measured: dict[str, list[_Moving]] = {}

    def __iter__(self) -> Iterator[str]:
        return iter(self._measured)

    def forget(self, oldest_ns: int) -> None:
        """Forget what was captured earlier, and senders of which nothing is left."""
        for name, measured in self._measured.items():
            self._measured[name] = [each for each in measured if each.captured_ns >= oldest_ns]
        self._measured = {name: measured for name, measured in self._measured.items() if measured}
        self._trackers = {name: tracker for name, tracker in self._trackers.items() if name in self._measured}

    def take(self, source: str, captured_ns: int, found: Detections) -> bool:
        """Take in a measurement, unless it is the receiver's; return whether it is newer than all of the sender's."""
        if source == RECEIVER:
            return True
        measured = self._measured.setdefault(source, [])
        if measured and captured_ns <= measured[-1].captured_ns:
            return False
        if found.velocity is None:
            tracker = self._trackers.get(source) or self._make_tracker()
            velocity, confirmed = tracker.known(found, captured_ns)
            tracker.step(found, captured_ns)
            self._trackers[source] = tracker
        else:
            confirmed = np.asarray(np.isfinite(found.velocity).all(axis=1))
            velocity = np.where(confirmed[:, None], found.velocity, 0.0)
        measured.append(_Moving(captured_ns, found, velocity, confirmed))
        return True

    def last_before(self, source: str, time_ns: int) -> _Moving | None:
        """Return what a sender measured last before a time, if it is known."""
        return next((each for each in reversed(self._measured[source]) if each.captured_ns < time_ns), None)

    def newest(self, source: str) -> _Moving:
        """Return what a sender measured last."""
        return self._measured[source][-1]


class PredictForward(DelayedMeasurements):
    """Delayed detections are moved on to now by the velocity of their object (see `_Senders`).

    Until a measurement is late this is `AsIfCurrent`, and costs no more; what came on time just before is then read by
    the senders' trackers.
    """

    _REMEMBERED = 5  # steps, after which velocities are known well enough

    def __init__(self, make_tracker: MakeTracker, fusion: Fusion = in_turn, first: str = RECEIVER) -> None:
        super().__init__(make_tracker, fusion, first)
        self._senders, self._any_late = _Senders(make_tracker), False
        self._on_time: deque[tuple[int, Measurements]] = deque(maxlen=self._REMEMBERED)

    def _step(self, measurements: Measurements, now_ns: int) -> Tracks:
        newest = self._newest(measurements)
        if not self._any_late:
            if all(measurements.captured_ns[number] >= now_ns for number in newest):
                self._on_time.append((now_ns, measurements))
                return self._track(measurements.groups.take(newest), now_ns)
            self._any_late = True
            for time_ns, step in self._on_time:
                for number in self._newest(step):
                    self._senders.take(step.sources[number], time_ns, step.groups[number])
        self._senders.forget(now_ns - _EXPIRY_NS)
        return self._track(DetectionGroups.of(self._moved(measurements, number, now_ns) for number in newest), now_ns)

    def _moved(self, measurements: Measurements, number: int, now_ns: int) -> Detections:
        """Return a source's detections where their objects should be now; none if they are overtaken or expired."""
        source, captured_ns = measurements.sources[number], min(measurements.captured_ns[number], now_ns)
        found = measurements.groups[number]
        if source == RECEIVER:
            return found
        if captured_ns < now_ns - _EXPIRY_NS or not self._senders.take(source, captured_ns, found):
            return Detections.empty()
        return self._senders.newest(source).at(now_ns)


@dataclass(slots=True)
class _Moment:
    """A step of the tracker.

    Attributes:
        time_ns: its time.
        groups: detections by source: a group, by its number, among those that came with it.
        moved: last earlier measurement, by source without a known one of this moment.
        joined: the measured and moved groups in order; None: not joined yet, or not since they changed.
        before: the tracker's state before the step.
        shown: the tracks after it.
    """

    time_ns: int
    groups: dict[str, tuple[DetectionGroups, int]] = field(default_factory=dict)
    moved: dict[str, _Moving] = field(default_factory=dict)
    joined: DetectionGroups | None = None
    before: Any = None
    shown: Tracks = field(default_factory=Tracks.empty)

    def joined_in(self, order: Callable[[Iterable[str]], list[str]]) -> DetectionGroups:
        """Return the groups of all sources in an order; joined once, until another group comes."""
        if self.joined is None:
            sources = order([*self.groups, *self.moved])
            wholes = {id(whole): whole for whole, _ in self.groups.values()}
            if len(wholes) == 1 and not self.moved:
                (whole,) = wholes.values()
                self.joined = whole.take([self.groups[source][1] for source in sources])
            else:
                self.joined = DetectionGroups.of(map(self._group, sources))
        return self.joined

    def _group(self, source: str) -> Detections:
        if source in self.moved:
            moving = self.moved[source]
            return moving.at(self.time_ns)[moving.confirmed]
        whole, number = self.groups[source]
        return whole[number]


class RewindAndReplay(DelayedMeasurements):
    """The tracker is rewound to the capture time of a delayed measurement, and tracks again from there.

    Exact: once everything has arrived, the tracks are those of a tracker to which everything came on time. The cost is
    as many steps as the oldest new measurement is delayed by. The same measurement twice counts once.

    At a moment of which a sender has said nothing yet, what it measured last counts, moved on as by `PredictForward`.
    Else objects that only senders see would be missed there, and boxes that several agents see would follow the
    receiver's alone.

    Args:
        make_tracker: makes the tracker.
        fusion: applied to the measurements of one moment.
        first: the source whose measurements come first.
        window_s: measurements that are delayed by more are dropped, and none is moved on for longer.
    """

    def __init__(
        self, make_tracker: MakeTracker, fusion: Fusion = in_turn, first: str = RECEIVER, window_s: float = 1.0
    ) -> None:
        super().__init__(make_tracker, fusion, first)
        require_positive(window_s=window_s)
        self._window_ns = seconds_to_ns(window_s)
        self._moments: list[_Moment] = []
        self._senders, self._ids = _Senders(make_tracker), LastingIds()

    def _step(self, measurements: Measurements, now_ns: int) -> Tracks:
        last_ns = self._moments[-1].time_ns if self._moments else now_ns
        self._moments = [moment for moment in self._moments if moment.time_ns >= now_ns - self._window_ns]
        moments = {moment.time_ns: moment for moment in self._moments}
        moments.setdefault(now_ns, _Moment(now_ns))
        oldest_ns, first_ns = min(moments), now_ns
        for number in sorted(range(len(measurements)), key=measurements.captured_ns.__getitem__):
            source, captured_ns = measurements.sources[number], min(measurements.captured_ns[number], now_ns)
            if captured_ns < oldest_ns:
                continue
            moment = moments.setdefault(captured_ns, _Moment(captured_ns))
            if source not in moment.groups:
                moment.groups[source], moment.joined = (measurements.groups, number), None
                first_ns = min(first_ns, captured_ns)
                self._senders.take(source, captured_ns, measurements.groups[number])
        self._moments = [moments[time_ns] for time_ns in sorted(moments)]
        self._senders.forget(now_ns - 2 * self._window_ns)  # what the oldest moment may need
        self._replay(min([first_ns, *self._move_on()]), last_ns)
        return self._ids.name(moments[now_ns].shown, now_ns)

    def _move_on(self) -> list[int]:
        """Give each moment what silent senders measured before; return the times of those that this changes."""
        changed_ns = []
        for moment in self._moments:
            moved = {}
            for source in self._senders:
                last = None if source in moment.groups else self._senders.last_before(source, moment.time_ns)
                if last is not None and last.captured_ns >= moment.time_ns - self._window_ns:
                    moved[source] = last
            if moved.keys() != moment.moved.keys() or any(moved[name] is not moment.moved[name] for name in moved):
                moment.moved, moment.joined = moved, None
                changed_ns.append(moment.time_ns)
        return changed_ns

    def _replay(self, first_ns: int, last_ns: int) -> None:
        """Track again from the first moment at or after `first_ns`; the last report was of `last_ns`."""
        again = [moment for moment in self._moments if moment.time_ns >= first_ns]
        # The state before a moment that is new among older ones is that of the moment after it.
        known = next((moment.before for moment in again if moment.before is not None), None)
        if known is not None:
            self.tracker.state = known
        lasting = _shown_ids(moment for moment in self._moments if moment.time_ns < first_ns)
        self._ids.forget(_shown_ids(again) - lasting)
        for moment in again:
            moment.before = self.tracker.state
            moment.shown = self._track(moment.joined_in(self._in_order), moment.time_ns)
            if moment.time_ns == last_ns:
                self._ids.carry_over(moment.shown, last_ns)


def _shown_ids(moments: Iterable[_Moment]) -> set[int]:
    return {each for moment in moments for each in moment.shown.id.tolist()}


DELAYED: Registry[type[DelayedMeasurements]] = Registry("delayed")
DELAYED.register("as_current")(AsIfCurrent)
DELAYED.register("predict")(PredictForward)
DELAYED.register("replay")(RewindAndReplay)
