"""Jobs that film their cells, and the cells of a grid that are filmed."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from itertools import groupby

from coopsim.bench.engine.job import Job, Outcome, run_job
from coopsim.bench.films.film_file import film_bytes
from coopsim.bench.films.filming import Filming
from coopsim.bench.films.space import CLOUD_POINTS
from coopsim.bench.grid.cell import Cell
from coopsim.bench.grid.labels import disturbances

MOST_FRAMES = 200_000
"""Frames of a grid that are filmed at most: the first ones by `cells_to_film`. A frame takes 2 to 8 kB."""

_EPISODE_FRAMES = 200
"""Frames that an episode of its own length is counted as."""


@dataclass(frozen=True, slots=True, eq=False)
class FilmedJob(Job):
    """A job that keeps the film of its cell.

    Its key is that of the cell, filmed or not: a recorder decides nothing.

    Attributes:
        of_each: film the points and messages of each agent, too, which pairs with a lie show.
        space: film in three dimensions, too.
    """

    of_each: bool = False
    space: bool = False

    @classmethod
    def like(cls, job: Job, *, of_each: bool, space: bool = False) -> FilmedJob:
        """Make the job that films the cell of another one."""
        return cls(job.cell, job.options, job.policy, job.decided_by, job.metrics, job.isolation, of_each, space)

    def perform(self) -> Outcome:
        filming = Filming(of_each=self.of_each, space=CLOUD_POINTS if self.space else None)
        outcome = run_job(self, (filming,))
        if outcome.result.failed:
            return outcome
        return replace(outcome, film=film_bytes(filming.film, self.key))


def film_jobs(jobs: Sequence[Job]) -> list[Job]:
    """Return the jobs of a grid, those of `cells_to_film` as jobs that film."""
    bounds = {job.cell.policy for job in jobs if _is_bound(job)}
    filmed = cells_to_film([job.cell for job in jobs], bounds)
    lies = any(cell.condition.attacks for cell in filmed)
    return [FilmedJob.like(job, of_each=lies) if job.cell in filmed else job for job in jobs]


def _is_bound(job: Job) -> bool:
    """Return whether a policy is told the truth, as far as that is known without importing one that runs apart."""
    if job.isolation.limit_s and job.policy.place:
        return False
    return bool(getattr(getattr(job.policy.policy_class(), "needs", None), "truth", False))


def cells_to_film(cells: Sequence[Cell], bounds: Collection[str] = ()) -> frozenset[Cell]:
    """Return the cells of a grid that are filmed: those that a report may show, and no more than `MOST_FRAMES`.

    A report shows runs of one condition and seed beside each other, and one with a lie beside the honest one. So those
    of a condition and seed are filmed together, the least disturbed first, and then seed by seed. Where one policy
    competes and nobody lies there is nothing to show.

    Args:
        cells: the cells of the grid.
        bounds: policies that are upper bounds, which no report shows.
    """
    shown = [cell for cell in cells if cell.policy not in bounds]
    conditions = list(dict.fromkeys(cell.condition for cell in shown))
    if len({cell.policy for cell in shown}) < 2 and not any(each.attacks for each in conditions):
        return frozenset()
    ranks = {each: (count, k) for k, (each, count) in enumerate(zip(conditions, disturbances(conditions), strict=True))}
    seeds = {seed: k for k, seed in enumerate(dict.fromkeys(cell.seed for cell in shown))}

    def place(cell: Cell) -> tuple[int, int, int]:
        disturbed, number = ranks[cell.condition]
        return disturbed, seeds[cell.seed], number

    filmed, frames = set[Cell](), 0
    for _, group in groupby(sorted(shown, key=place), key=place):
        together = list(group)
        frames += sum(cell.frames or _EPISODE_FRAMES for cell in together)
        if filmed and frames > MOST_FRAMES:
            break
        filmed.update(together)
    return frozenset(filmed)
