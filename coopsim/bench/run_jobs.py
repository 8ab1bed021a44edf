"""Jobs of any plan: finished ones are taken from a store, the others are run by an engine, and stored at once."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, field, replace

from coopsim.bench.engine.engine import Engine
from coopsim.bench.engine.job import Job, Outcome
from coopsim.bench.engine.schedule import Schedule
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
    is_kept: Callable[[Job, CellResult], bool] = lambda job, result: not result.failed,
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
        is_kept: says of a job and its stored result whether it stands; others are run again.
        on_progress: called before the first job and after each.
        on_broken: called for each broken file of the store; its job is run again.
    """
    found = {} if store is None else _stored(store, jobs, on_broken)
    results = {job.key: found[job.key] for job in jobs if job.key in found and is_kept(job, found[job.key])}
    progress = Progress(len(jobs), len(results), results=results)
    on_progress(progress)
    if progress.stored == progress.cells:  # start no engine
        return results
    schedule = Schedule(job for job in jobs if job.key not in results)
    with closing((engine or Engine()).run(schedule)) as outcomes:
        for outcome in outcomes:
            result = outcome.result
            if store is not None and not outcome.lost:
                result = store.put(result, outcome.job.decided_by, outcome.circumstances, outcome.film)
            results[outcome.job.key] = result
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
