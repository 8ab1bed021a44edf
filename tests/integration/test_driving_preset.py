"""The preset `driving`: 528 pairs of drives, the same for any number of workers, with both kinds told apart."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from jobs_here import no_workers

from coopsim.bench.benchmark import benchmark
from coopsim.bench.engine.engine import Engine
from coopsim.bench.grid.cell import CellResult
from coopsim.bench.grid.grid_file import find_grid
from coopsim.catalog import newest
from coopsim.config.spec import parse_spec
from coopsim.world.situations.interactions import ROWS
from coopsim.world.situations.situation import SITUATIONS


def told(results: list[CellResult]) -> str:
    return repr([(each.cell, each.values, each.rewards.tolist(), each.place_seed) for each in results])


def test_it_has_528_pairs_with_every_row_and_every_situation() -> None:
    grid = find_grid("driving").grid()
    assert len(grid) == 2 * 528
    named = [parse_spec("environment", each) for each in grid.scenarios]
    assert {options["kind"] for name, options in named if name == "interaction"} == set(ROWS)
    assert {name for name, _ in named} == {*SITUATIONS, "interaction", "route"} - {"written"}
    assert all(newest(name) != name for name, _ in named)


def test_results_are_the_same_on_one_and_on_two_workers(tmp_path: Path) -> None:
    grid = replace(
        find_grid("driving").grid(),
        scenarios=("interaction(kind=cut_in)", "route(route_m=[20, 30], vehicles=6)"),
        seeds=(1000,),
        frames=4,
    )
    grid = replace(grid, options={**grid.options, "place": ["crossing", "named"], "penetration": 0})
    with no_workers():
        one = benchmark(grid, tmp_path / "one", films=False)
    two = benchmark(grid, tmp_path / "two", films=False, engine=Engine(workers=2))
    assert told(one) == told(two)
    assert not any(each.failed for each in one), [each.reason for each in one]
    assert {each.cell.condition.scenario: "route_completion" in each.values for each in one} == dict.fromkeys(
        grid.scenarios, True
    )
