"""A benchmark from the grid to the results: all that it names is tried first, then its jobs are run."""

from __future__ import annotations

import inspect
import math
from collections.abc import Callable, Collection, Iterable
from pathlib import Path

from coopsim.bench.engine.engine import Engine
from coopsim.bench.engine.job import Job
from coopsim.bench.films.choice import has_film
from coopsim.bench.films.filmed_job import FilmedJob, film_jobs
from coopsim.bench.films.telling_pair import has_space, space_jobs
from coopsim.bench.grid.axis import ATTACKS, LATENCY, POLICY, RATE
from coopsim.bench.grid.cell import (
    Cell,
    CellResult,
    Condition,
    environment_options,
    further_options,
    scenario_options,
)
from coopsim.bench.grid.grid import Grid
from coopsim.bench.grid.policies import of_cell, takes
from coopsim.bench.isolated.isolation import Isolation
from coopsim.bench.paper.provenance import Provenance
from coopsim.bench.run_jobs import Progress, run_jobs
from coopsim.bench.store.fingerprint import Sources
from coopsim.bench.store.metric_spec import MetricSpec
from coopsim.bench.store.store import Store
from coopsim.catalog import NAMESPACE, PolicySpec, newest
from coopsim.errors import InvalidValueError, StoreError, UnknownNameError
from coopsim.provided import listening_env


def benchmark(
    grid: Grid,
    folder: str | Path,
    *,
    engine: Engine | None = None,
    retry_failed: bool = False,
    films: bool = False,
    retry_unfilmed: bool = False,
    space: bool = False,
    command: str = "",
    isolation: Isolation = Isolation(),  # noqa: B008  (frozen)
    only: Collection[Cell] | None = None,
    on_progress: Callable[[Progress], object] = lambda progress: None,
    on_broken: Callable[[StoreError], object] = lambda error: None,
) -> list[CellResult]:
    """Run every cell of a grid that is not in the store yet, and return the results of all cells.

    Policies, scenarios and options are looked up and tried before the first cell runs. Each cell is stored as soon as
    it is finished, so after any interruption the same call continues and ends in the same results. A cell whose policy
    raises has a traceback instead of values, and the others go on. So has one whose machine died, which is not stored:
    the same call runs it again.

    Args:
        grid: the cells.
        folder: folder of the store, made if need be.
        engine: runs the cells; None: processes of this machine, as many as cores.
        retry_failed: also run cells whose stored result is a traceback.
        films: keep films of the runs, for the clips of a report: of those of `cells_to_film`, without a salt.
        retry_unfilmed: also run cells again whose result is stored, and whose film is missing or broken.
        space: with `films`, run the most telling pair again, and keep its films in three dimensions.
        command: the command that gives the same numbers, kept in the store.
        isolation: separation of policies from the world.
        only: the cells to run; None: all of the grid.
        on_progress: called before the first cell and after each.
        on_broken: called for each broken file of the store; its cell is run again.

    Returns:
        The results in the order of `grid.cells()`, or of `only`, those of failed cells included.

    Raises:
        CoopsimError: a name is unknown or a value is not accepted; the message says what is accepted.
    """
    policies = check(grid, isolation)
    store = Store(folder)
    metrics = MetricSpec.all()  # after `check`, which loads the policies' files
    sources = Sources()
    cells = grid.cells() if only is None else only
    jobs = [Job.of(cell, grid.options, policies[cell.policy], metrics, isolation, sources) for cell in cells]
    if films and isolation.salt is None:  # a film shows the place, which a salt keeps secret
        jobs = film_jobs(jobs)
    store.begin([job.key for job in jobs], Provenance.of(grid, command, isolation).as_data())

    def is_kept(job: Job, result: CellResult) -> bool:
        if result.failed:
            return not retry_failed
        return not (retry_unfilmed and isinstance(job, FilmedJob)) or has_film(result)

    results = run_jobs(jobs, engine, store, is_kept=is_kept, on_progress=on_progress, on_broken=on_broken)
    if space:
        again = space_jobs(jobs, results)
        results |= run_jobs(again, engine, store, is_kept=lambda job, result: has_space(result), on_broken=on_broken)
    return [results[job.key] for job in jobs]


def check(grid: Grid, isolation: Isolation = Isolation()) -> dict[str, PolicySpec]:  # noqa: B008  (frozen)
    """Look up everything that a grid names, and make every policy and its environments once. Return policies by text.

    Raises:
        CoopsimError: a name is unknown or a value is not accepted.
    """
    isolation.require(grid.options)
    for scenario in grid.scenarios:
        if newest(scenario.removeprefix(f"{NAMESPACE}/")).startswith("replay-"):
            raise InvalidValueError(
                f"scenarios must be simulated, got {scenario!r}: `coopsim leaderboard` ranks policies on recordings"
            )
        _require_no_condition(scenario)
    specs, met, conditions = {text: PolicySpec.parse(text) for text in grid.policies}, set(), _telling(grid)
    _require_parameters(grid, specs.values(), isolation)
    for text, spec in specs.items():
        made = [of_cell(spec, each, trusted=not (isolation.limit_s and spec.place)) for each in conditions]
        for each in {each.text: each for each in made}.values():
            with isolation.described(each) as policy:
                # Policies with the same needs meet the same environments.
                kind = policy.needs, type(policy)
                for condition in conditions if kind not in met else ():
                    options = environment_options(Cell(text, condition, grid.seeds[0], grid.frames), grid.options)
                    listening_env(condition.scenario, policy, options).close()
                met.add(kind)
    return specs


def _telling(grid: Grid) -> list[Condition]:
    """Return the hardest conditions of each scenario, and one with each value of attacks and of further options."""
    found: dict[Condition, None] = {}
    for scenario in grid.scenarios:
        met = [condition for condition in grid.conditions() if condition.scenario == scenario]
        hardest = {
            max(met, key=lambda each: each.get(LATENCY) or 0.0),
            min(met, key=lambda each: each.get(RATE) or math.inf),
        }
        for option in (ATTACKS, *further_options(met)):
            hardest |= set({str(each.get(option)): each for each in reversed(met)}.values())
        found |= dict.fromkeys(sorted(hardest))
    return list(found)


def _require_parameters(grid: Grid, specs: Iterable[PolicySpec], isolation: Isolation) -> None:
    """Refuse an axis of a parameter that none of the policies has."""
    trusted = [spec for spec in specs if not (isolation.limit_s and spec.place)]
    for option in grid.axes if trusted else ():
        name = option.removeprefix(POLICY)
        if name != option and not any(takes(spec, name) for spec in trusted):
            known = {each for spec in trusted for each in inspect.signature(spec.policy_class()).parameters}
            raise UnknownNameError("parameter of policies", name, sorted(known))


def _require_no_condition(scenario: str) -> None:
    """Refuse a scenario file with a channel or localization, which would hide the conditions of the grid."""
    options = scenario_options(scenario)
    for name in ("channel", "localization"):
        if options.get(name) is not None:
            raise InvalidValueError(
                f"scenarios must have no {name} of their own in a grid, got {scenario!r}: move it to the grid's "
                "options, where it is the same in all runs"
            )
