"""The order of a benchmark's jobs, and how long the remaining ones take."""

from __future__ import annotations

import math
from collections import defaultdict, deque
from collections.abc import Iterable, Iterator

from coopsim.bench.engine.job import Job, Outcome

_Kind = tuple[str, str]
"""Policy and scenario, which decide the duration of a cell of a given number of frames."""


class Schedule(Iterator[Job]):
    """Hands out jobs, and learns from outcomes how long the remaining ones take."""

    def __init__(self, jobs: Iterable[Job]) -> None:
        self._left: defaultdict[_Kind, deque[Job]] = defaultdict(deque)
        for job in jobs:
            self._left[_kind(job)].append(job)
        self._seconds: defaultdict[_Kind, list[float]] = defaultdict(list)
        self._running: defaultdict[_Kind, int] = defaultdict(int)

    def __next__(self) -> Job:
        """Return a job of a kind that was not begun yet, else one of the kind that takes longest."""
        waiting = [kind for kind, jobs in self._left.items() if jobs]
        if not waiting:
            raise StopIteration
        kind = max(waiting, key=lambda each: self._expected_s(each, unknown_s=0.0 if self._running[each] else math.inf))
        self._running[kind] += 1
        return self._left[kind].popleft()

    def learn(self, outcome: Outcome) -> None:
        """Note the duration of a job."""
        kind = _kind(outcome.job)
        self._running[kind] -= 1
        self._seconds[kind].append(outcome.seconds)

    def left_s(self) -> float | None:
        """Estimate the remaining work for one worker, s; None before the first outcome."""
        known = [second for seconds in self._seconds.values() for second in seconds]
        if not known:
            return None
        mean_s = sum(known) / len(known)
        # Half of each running job is done.
        return sum(
            (len(self._left[kind]) + self._running[kind] / 2) * self._expected_s(kind, unknown_s=mean_s)
            for kind in list(self._left)
        )

    def _expected_s(self, kind: _Kind, *, unknown_s: float) -> float:
        seconds = self._seconds[kind]
        return sum(seconds) / len(seconds) if seconds else unknown_s


def _kind(job: Job) -> _Kind:
    return job.cell.policy, job.cell.condition.scenario
