"""Strategies for delayed measurements: those that arrive after their capture frame, or out of order.

From cheap to exact: `AsIfCurrent`, `PredictForward`, `RewindAndReplay`.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Callable, Container, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import compress
from operator import lt
from typing import Any

from coopsim.support.checks import require_positive
from coopsim.support.registry import Registry
from coopsim.tracking.senders import MovingObjects, Senders
from coopsim.tracking.side_by_side import MakeTracker
from coopsim.tracking.track_ids import LastingIds
from coopsim.types import NS_PER_S, Detections, Tracks, seconds_to_ns
from coopsim.types.groups import DetectionGroups

RECEIVER = ""
"""The source of the receiver's own measurements; it sorts before the names of all senders."""

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


class PredictForward(DelayedMeasurements):
    """Delayed detections are moved on to now by the velocity of their object (see `Senders`).

    Until a measurement is late this is `AsIfCurrent`, and costs no more; what came on time just before is then read by
    the senders' trackers.
    """

    _REMEMBERED = 5  # steps, after which velocities are known well enough

    def __init__(self, make_tracker: MakeTracker, fusion: Fusion = in_turn, first: str = RECEIVER) -> None:
        super().__init__(make_tracker, fusion, first)
        self._senders, self._any_late = Senders(make_tracker), False
        self._on_time: deque[tuple[int, Measurements]] = deque(maxlen=self._REMEMBERED)

    def _step(self, measurements: Measurements, now_ns: int) -> Tracks:
        newest = self._newest(measurements)
        if not self._any_late:
            if all(measurements.captured_ns[number] >= now_ns for number in newest):
                self._on_time.append((now_ns, measurements))
                return self._track(measurements.groups.take(newest), now_ns)
            self._any_late = True
            for time_ns, step in self._on_time:
                _take(self._senders, step, {time_ns: self._newest(step)})
        self._senders.forget(now_ns - _EXPIRY_NS)
        by_capture: dict[int, list[int]] = {}
        for number in newest:
            captured_ns = min(measurements.captured_ns[number], now_ns)
            if captured_ns >= now_ns - _EXPIRY_NS:
                by_capture.setdefault(captured_ns, []).append(number)
        taken = _take(self._senders, measurements, by_capture)
        moved = (self._moved(measurements, number, taken, now_ns) for number in newest)
        return self._track(DetectionGroups.of(moved), now_ns)

    def _moved(self, measurements: Measurements, number: int, taken: Container[int], now_ns: int) -> Detections:
        """Return a source's detections where their objects should be now; none if they were not taken in."""
        source = measurements.sources[number]
        if source == RECEIVER:
            return measurements.groups[number]
        return self._senders.newest(source).at(now_ns) if number in taken else Detections.empty()


def _take(senders: Senders, measurements: Measurements, by_capture: Mapping[int, Sequence[int]]) -> set[int]:
    """Let senders take in measurements of which they know no newer one of the sender, and return their numbers.

    The numbers of measurements are given by capture time, the earliest first; the receiver's are left out.
    """
    taken = set[int]()
    for captured_ns, numbers in by_capture.items():
        sources = [measurements.sources[number] for number in numbers]
        news = [source != RECEIVER and senders.is_news(source, captured_ns) for source in sources]
        chosen = list(compress(numbers, news))
        senders.take(list(compress(sources, news)), measurements.groups.take(chosen), captured_ns)
        taken.update(chosen)
    return taken


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
    moved: dict[str, MovingObjects] = field(default_factory=dict)
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
            return self.moved[source].confirmed_at(self.time_ns)
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
        self._senders, self._ids = Senders(make_tracker), LastingIds()

    def _step(self, measurements: Measurements, now_ns: int) -> Tracks:
        last_ns = self._moments[-1].time_ns if self._moments else now_ns
        self._moments = [moment for moment in self._moments if moment.time_ns >= now_ns - self._window_ns]
        moments = {moment.time_ns: moment for moment in self._moments}
        moments.setdefault(now_ns, _Moment(now_ns))
        oldest_ns, first_ns, by_capture = min(moments), now_ns, dict[int, list[int]]()
        for number in sorted(range(len(measurements)), key=measurements.captured_ns.__getitem__):
            source, captured_ns = measurements.sources[number], min(measurements.captured_ns[number], now_ns)
            if captured_ns < oldest_ns:
                continue
            moment = moments.get(captured_ns)
            if moment is None:
                moment = moments[captured_ns] = _Moment(captured_ns)
            if source not in moment.groups:
                moment.groups[source], moment.joined = (measurements.groups, number), None
                first_ns = min(first_ns, captured_ns)
                by_capture.setdefault(captured_ns, []).append(number)
        _take(self._senders, measurements, by_capture)
        self._moments = [moments[time_ns] for time_ns in sorted(moments)]
        self._senders.forget(now_ns - 2 * self._window_ns)  # what the oldest moment may need
        self._replay(min([first_ns, *self._move_on()]), last_ns)
        return self._ids.name(moments[now_ns].shown, now_ns)

    def _move_on(self) -> list[int]:
        """Give each moment what silent senders measured before; return the times of those that this changes."""
        changed_ns = []
        for moment in self._moments:
            moved = {}
            for source in () if self._senders.are_all_in(moment.groups) else self._senders:
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
        if forgotten := _shown_ids(again):
            self._ids.forget(forgotten - _shown_ids(moment for moment in self._moments if moment.time_ns < first_ns))
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
