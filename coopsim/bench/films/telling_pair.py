"""The most telling pair of a benchmark, which is run again to be filmed in three dimensions."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from coopsim.bench.engine.job import Job
from coopsim.bench.films.choice import film_of
from coopsim.bench.films.crash_pairs import CRASH, telling_pairs
from coopsim.bench.films.filmed_job import FilmedJob
from coopsim.bench.films.lie_pairs import lie_pairs
from coopsim.bench.films.moments import worst_windows
from coopsim.bench.grid.cell import CellResult
from coopsim.bench.results.result_table import ResultTable
from coopsim.errors import StoreError


def telling_pair(results: Sequence[CellResult]) -> tuple[CellResult, CellResult] | None:
    """Return the two runs that a report shows first: of a crash, or else the worst moment, or a lie; None without any.

    Where agents lie it is the pair with a lie that costs most.
    """
    table = ResultTable.of([each for each in results if each.film is not None or not each.bound])
    for lie in lie_pairs(table, 1):
        return lie.honest, lie.attacked
    for crash in telling_pairs(table, 1) if CRASH in table.metrics else ():
        return crash.alone, crash.sharing
    for moment in worst_windows(table, 1) if CRASH not in table.metrics else ():
        return moment.worst, moment.best
    return None


def space_jobs(jobs: Sequence[Job], results: Mapping[str, CellResult]) -> list[FilmedJob]:
    """Return jobs that film the most telling pair in three dimensions; `results` are those of all jobs by key."""
    finished = [results[job.key] for job in jobs if not results[job.key].failed]
    pair = telling_pair(finished) if finished else None
    cells = {each.cell for each in pair or ()}
    return [
        FilmedJob.like(job, of_each=job.of_each, space=True)
        for job in jobs
        if isinstance(job, FilmedJob) and job.cell in cells
    ]


def has_space(result: CellResult) -> bool:
    """Return whether a result has a film in three dimensions that can be read."""
    try:
        return bool(film_of(result).solids)
    except StoreError:
        return False
