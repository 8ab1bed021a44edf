"""A receiver's memory of what senders measured, and of how fast the objects in it move."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from coopsim.geometry.boxes import Boxes3D
from coopsim.geometry.se3 import Floats
from coopsim.tracking.side_by_side import MakeTracker, source_trackers
from coopsim.types import NS_PER_S, Detections, Mask
from coopsim.types.groups import DetectionGroups


@dataclass(slots=True, eq=False)
class MovingObjects:
    """A sender's measurement, and how its n objects move: one of the groups of a moment.

    Attributes:
        captured_ns: capture time.
        number: the number of its group.
        groups: the detections of all senders of the moment.
        velocity: (n, 2) m/s, 0 where unknown; None: not asked for yet.
        confirmed: (n,) whether the sender's tracker has confirmed the object before; None: not asked for yet.
    """

    captured_ns: int
    number: int
    groups: DetectionGroups
    velocity: Floats | None = None
    confirmed: Mask | None = None

    @property
    def detections(self) -> Detections:
        """The detections, as measured."""
        return self.groups[self.number]

    def at(self, time_ns: int) -> Detections:
        """Return the detections where their objects should be at a time."""
        assert self.velocity is not None
        detections = self.detections
        moved, boxes = self.velocity * (time_ns - self.captured_ns) / NS_PER_S, detections.boxes
        center = boxes.center + np.pad(moved, ((0, 0), (0, 1)))
        return replace(detections, boxes=Boxes3D(center, boxes.size, boxes.yaw))

    def confirmed_at(self, time_ns: int) -> Detections:
        """Return those of confirmed objects alone, where these should be at a time."""
        assert self.confirmed is not None
        return self.at(time_ns)[self.confirmed]


class Senders:
    """Memory of senders' measurements and of the velocities of their objects.

    Boxes that were sent with velocities have these. For all others a sender has a tracker of its own, in its own time,
    from when it is asked about first: it begins with the measurements that are remembered then. So senders of whom all
    arrives on time cost nothing. Velocities of the receiver's tracks would not do: a measurement that was moved with a
    velocity confirms it, and the error grows from frame to frame.
    """

    def __init__(self, make_tracker: MakeTracker) -> None:
        self._trackers = source_trackers(make_tracker)
        self._measured: dict[str, deque[MovingObjects]] = {}
        self._followed = set[str]()

    def __iter__(self) -> Iterator[str]:
        return iter(self._measured)

    def are_all_in(self, sources: Mapping[str, object]) -> bool:
        """Return whether all remembered senders are among these sources."""
        return self._measured.keys() <= sources.keys()

    def forget(self, oldest_ns: int) -> None:
        """Forget what was captured earlier, and senders of which nothing is left."""
        for measured in self._measured.values():
            while measured and measured[0].captured_ns < oldest_ns:
                measured.popleft()
        if not all(self._measured.values()):
            self._measured = {name: measured for name, measured in self._measured.items() if measured}
            self._followed &= self._measured.keys()
            self._trackers.keep(self._measured)

    def take(self, sources: Sequence[str], groups: DetectionGroups, captured_ns: int) -> None:
        """Take in measurements of one moment, a group for each of these sources; all are `are_news`."""
        if groups.parts is not None:  # they have different columns
            for source, part in zip(sources, groups.parts, strict=True):
                self._take_alike([source], DetectionGroups.of([part]), captured_ns)
        elif len(groups):
            self._take_alike(sources, groups, captured_ns)

    def _take_alike(self, sources: Sequence[str], groups: DetectionGroups, captured_ns: int) -> None:
        moving = [MovingObjects(captured_ns, number, groups) for number in range(len(sources))]
        for source, each in zip(sources, moving, strict=True):
            self._measured.setdefault(source, deque()).append(each)
        told = groups.joined.velocity
        if told is not None:
            known = np.asarray(np.isfinite(told).all(axis=1))
            _share(moving, groups, np.where(known[:, None], told, 0.0), known)
        elif followed := [number for number, source in enumerate(sources) if source in self._followed]:
            self._step(
                [sources[number] for number in followed],
                [moving[number] for number in followed],
                groups.take(followed),
            )

    def _step(self, sources: Sequence[str], moving: Sequence[MovingObjects], groups: DetectionGroups) -> None:
        """Let the trackers of sources take in their measurements of one moment, which are these groups."""
        _share(moving, groups, *self._trackers.step(sources, groups, moving[0].captured_ns))

    def _follow(self, source: str) -> None:
        """Give a sender a tracker, unless it has one, which takes in what is remembered."""
        if source in self._followed:
            return
        self._followed.add(source)
        for each in self._measured[source]:
            if each.velocity is None:
                self._step([source], [each], each.groups.take([each.number]))

    def is_news(self, source: str, captured_ns: int) -> bool:
        """Return whether a measurement is newer than all that the sender is known to have measured."""
        measured = self._measured.get(source)
        return not measured or captured_ns > measured[-1].captured_ns

    def last_before(self, source: str, time_ns: int) -> MovingObjects | None:
        """Return what a sender measured last before a time, if it is known."""
        self._follow(source)
        return next((each for each in reversed(self._measured[source]) if each.captured_ns < time_ns), None)

    def newest(self, source: str) -> MovingObjects:
        """Return what a sender measured last."""
        self._follow(source)
        return self._measured[source][-1]


def _share(moving: Sequence[MovingObjects], groups: DetectionGroups, velocity: Floats, confirmed: Mask) -> None:
    """Give each measurement its rows of what is known of all groups' objects."""
    for each, first, last in zip(moving, groups.starts[:-1].tolist(), groups.starts[1:].tolist(), strict=True):
        each.velocity, each.confirmed = velocity[first:last], confirmed[first:last]
