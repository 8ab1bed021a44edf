"""Search of a telling pair: seed by seed, until messages avoid a crash."""

from __future__ import annotations

from collections.abc import Iterable

from coopsim.bench.benchmark import check
from coopsim.bench.engine.job import Job, run_job
from coopsim.bench.films.crash_pairs import CRASH
from coopsim.bench.films.filming import Filming
from coopsim.bench.films.recording import Recording
from coopsim.bench.grid.cell import Cell
from coopsim.bench.grid.grid import Grid
from coopsim.errors import InvalidValueError


def search_pair(grid: Grid, seeds: Iterable[int]) -> tuple[Recording, Recording]:
    """Run and film a grid's two policies, the one without messages first, until the other avoids a crash.

    Raises:
        InvalidValueError: a run fails, no car is driven, or no crash is avoided with any seed.
    """
    specs = check(grid)
    (condition,) = grid.conditions()
    alone, sharing = grid.policies
    for seed in seeds:
        crashed, films = list[float](), list[Recording]()
        for policy in (alone, sharing):
            cell, filming = Cell(policy, condition, seed, None), Filming()
            result = run_job(Job.of(cell, grid.options, specs[policy]), (filming,)).result
            if result.failed:
                raise InvalidValueError(f"{policy} failed in {condition.scenario} with seed {seed}: {result.reason}")
            if CRASH not in result.values:
                raise InvalidValueError(f"a car must be driven in {condition.scenario}: add control=planner")
            crashed.append(result.values[CRASH])
            films.append(Recording.of(cell, filming.film))
        if crashed[0] > crashed[1]:
            return films[0], films[1]
    raise InvalidValueError(
        f"{sharing} avoids no crash of {alone} in {condition.scenario} with any seed that was tried"
    )
