"""Jobs of any plan: finished ones are taken from a store, the others are run by an engine, and stored at once."""

from __future__ import annotations

import math
from collections import defaultdict, deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, field, replace

from coopsim.bench.engine.engine import Engine
from coopsim.bench.engine.job import Job, Outcome
from coopsim.bench.grid.cell import CellResult
from coopsim.bench.store.store import Store
from coopsim.errors import StoreError


@dataclass(frozen=True, slots=True)
class Progress:
    """Progress of a plan's jobs.

    Attributes:
        cells: number of all jobs.
        stored: number of jobs that were in the store at the start.
        done: number of jobs run since.
        left_s: estimated remaining work for one worker, s; None before the first outcome.
        outcome: latest outcome.
        results: results so far, by the jobs' keys; those of lost jobs are failed.
    """

    cells: int
    stored: int
    done: int = 0
    left_s: float | None = None
    outcome: Outcome | None = None
    results: Mapping[str, CellResult] = field(default_factory=dict)


def run_jobs(
    jobs: Sequence[Job],
    engine: Engine | None = None,
    store: Store | None = None,
    *,
    retry_failed: bool = False,
    on_progress: Callable[[Progress], object] = lambda progress: None,
    on_broken: Callable[[StoreError], object] = lambda error: None,
) -> dict[str, CellResult]:
    """Run the jobs that are not in the store yet, and return the results of all by their keys.

    Each result is stored as soon as it is there, but for those that were lost for no fault of the job, which are failed
    results here, and are run by the next call.

    Args:
        jobs: the jobs.
        engine: runs them; None: processes of this machine, as many as cores.
        store: has finished ones; None: nothing is kept.
        retry_failed: also run jobs whose stored result is a traceback.
        on_progress: called before the first job and after each.
        on_broken: called for each broken file of the store; its job is run again.
    """
    results = {} if store is None else _stored(store, jobs, on_broken)
    results = {key: result for key, result in results.items() if not (result.failed and retry_failed)}
    progress = Progress(len(jobs), len(results), results=results)
    on_progress(progress)
    if progress.stored == progress.cells:  # start no engine
        return results
    schedule = Schedule(job for job in jobs if job.key not in results)
    with closing((engine or Engine()).run(schedule)) as outcomes:
        for outcome in outcomes:
            if store is not None and not outcome.lost:
                store.put(outcome.result, outcome.job.decided_by, outcome.circumstances)
            results[outcome.job.key] = outcome.result
            schedule.learn(outcome)
            progress = replace(progress, done=progress.done + 1, left_s=schedule.left_s(), outcome=outcome)
            on_progress(progress)
    return results


def _stored(store: Store, jobs: Iterable[Job], on_broken: Callable[[StoreError], object]) -> dict[str, CellResult]:
    """Return the results in the store, by key."""
    found = {}
    for job in jobs:
        try:
            result = store.get(job.key)
            if result is not None and result.cell != job.cell:
                raise StoreError(f"{store.path_of(job.key)} is broken: it is of another cell, {result.cell}")
        except StoreError as error:
            on_broken(error)
            continue
        if result is not None and (result.failed or bool(result.arrays) == job.arrays):
            found[job.key] = result
    return found


Kind = tuple[str, str]
"""Policy and scenario, which decide the duration of a cell of a given number of frames."""


class Schedule(Iterator[Job]):
    """Hands out jobs, and learns from outcomes how long the remaining ones take."""

    def __init__(self, jobs: Iterable[Job]) -> None:
        self._left: defaultdict[Kind, deque[Job]] = defaultdict(deque)
        for job in jobs:
            self._left[kind_of(job)].append(job)
        self._seconds: defaultdict[Kind, list[float]] = defaultdict(list)
        self._running: defaultdict[Kind, int] = defaultdict(int)

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
        kind = kind_of(outcome.job)
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

    def _expected_s(self, kind: Kind, *, unknown_s: float) -> float:
        seconds = self._seconds[kind]
        return sum(seconds) / len(seconds) if seconds else unknown_s


def kind_of(job: Job) -> Kind:
    """Return what decides how long a job takes."""
    return job.cell.policy, job.cell.condition.scenario
