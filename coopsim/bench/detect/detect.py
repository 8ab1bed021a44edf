"""A detection measurement from the plan to the rows: finished episodes are read from files, the others are run."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from coopsim.bench.benchmark import Engine
from coopsim.bench.detect.detect_job import DetectJob, DetectOutcome
from coopsim.bench.detect.detect_plan import DetectPlan
from coopsim.bench.detect.detect_rows import EVERYWHERE, Measured, row_of
from coopsim.bench.detect.disturbance import Disturbance
from coopsim.bench.detect.perceived.perceived import Perceived
from coopsim.bench.detect.perceived.perceived_files import PerceivedFiles
from coopsim.errors import StoreError

_Place = tuple[str, str, Disturbance]


@dataclass(frozen=True, slots=True)
class DetectProgress:
    """The progress of a measurement.

    Attributes:
        episodes: number of all.
        done: number of finished ones, stored ones included.
        outcome: the latest one that was run.
        rows: the rows whose episodes are all there, in order.
    """

    episodes: int
    done: int
    outcome: DetectOutcome | None
    rows: list[dict[str, Any]]


def measure_detection(
    plan: DetectPlan,
    *,
    folder: str | Path | None = None,
    check: bool = True,
    engine: Engine | None = None,
    on_progress: Callable[[DetectProgress], object] = lambda progress: None,
) -> list[dict[str, Any]]:
    """Run every episode of a plan that is not in the folder yet, and return the rows.

    The rows are the same for any number of processes, but for the times in them. A row whose policy raised in an
    episode is missing; `on_progress` was told.

    Args:
        plan: what is measured.
        check: make every policy and environment before the first episode, see `DetectPlan.check`.
        folder: of finished episodes, made if need be; None: nothing is kept.
        engine: runs the episodes; None: processes of this machine, as many as cores.
        on_progress: called before the first episode and after each.

    Raises:
        CoopsimError: a name is unknown or a value is not accepted; the message says what is accepted.
    """
    if check:
        plan.check()
    engine = engine or Engine()
    files = None if folder is None else PerceivedFiles(Path(folder))
    table = _Table(plan)
    jobs = {job: place for place, of_place in table.jobs.items() for job in of_place}
    for job in jobs:
        stored = None if files is None else _stored(files, job)
        if stored is not None:
            table.take(jobs[job], job, stored)
    waiting = {job.key: job for job in jobs if job not in table.episodes}
    done = len(jobs) - len(waiting)
    on_progress(DetectProgress(len(jobs), done, None, table.rows))
    if not waiting:
        return table.rows
    with closing(engine.run(iter(waiting.values()))) as outcomes:
        for outcome in outcomes:
            job = waiting[outcome.job.key]  # ours; the outcome has a copy
            if outcome.perceived is not None:
                if files is not None:
                    files.put(job.key, outcome.perceived)
                table.take(jobs[job], job, outcome.perceived)
            done += 1
            on_progress(DetectProgress(len(jobs), done, outcome, table.rows))
    return table.rows


class _Table:
    """Rows that fill up as episodes come.

    Attributes:
        jobs: the episodes of each row.
        episodes: by job, those that are there.
    """

    def __init__(self, plan: DetectPlan) -> None:
        self._plan = plan
        self.jobs: dict[_Place, list[DetectJob]] = {place: plan.jobs_of(*place) for place in plan.rows()}
        self.episodes: dict[DetectJob, Measured] = {}
        self._rows: dict[_Place, dict[str, Any]] = {}
        self._wholes: dict[_Place, list[DetectJob]] = {}
        if len(plan.environments) > 1:
            for (policy, _, disturbance), jobs in self.jobs.items():
                self._wholes.setdefault((policy, EVERYWHERE, disturbance), []).extend(jobs)

    @property
    def rows(self) -> list[dict[str, Any]]:
        """The complete rows; after those of all environments, the one that pools them."""
        return [self._rows[place] for place in self._order() if place in self._rows]

    def take(self, place: _Place, job: DetectJob, perceived: Perceived) -> None:
        """Take an episode in, and make the rows that it completes."""
        self.episodes[job] = Measured.of(perceived, self._plan.protocol, self._plan.within_m)
        policy, _, disturbance = place
        whole = (policy, EVERYWHERE, disturbance)
        for each, jobs in ((place, self.jobs[place]), (whole, self._wholes.get(whole, []))):
            if jobs and all(part in self.episodes for part in jobs):
                options = {name: value for name, value in jobs[0].options.items() if name != "threads"}
                self._rows[each] = row_of(self._plan, each, options, [self.episodes[part] for part in jobs])

    def _order(self) -> Iterator[_Place]:
        for place in self.jobs:
            yield place
            if place[1] == self._plan.environments[-1] and self._wholes:
                yield place[0], EVERYWHERE, place[2]


def _stored(files: PerceivedFiles, job: DetectJob) -> Perceived | None:
    """Return an episode from its file; None if there is none, or it is broken and must be run again."""
    try:
        return files.get(job.key)
    except StoreError:
        return None
