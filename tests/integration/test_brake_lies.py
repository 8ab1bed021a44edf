"""Lies that aim at a planner, in a benchmark: the same bits on any number of workers, and played beside the twin."""

from __future__ import annotations

from pathlib import Path

import pytest
from jobs_here import no_workers

from coopsim.bench.benchmark import benchmark
from coopsim.bench.engine.engine import Engine
from coopsim.bench.films.choice import Films
from coopsim.bench.films.lie_pairs import filmed_lies, lie_pairs
from coopsim.bench.grid.cell import CellResult
from coopsim.bench.grid.grid import Grid
from coopsim.bench.report.lie_figures import lie_figure
from coopsim.bench.results.result_table import ResultTable

DRIVEN = {"lidar": None, "control": "planner", "driven_agents": ["cav_0"]}
ATTACKS = ("none", "cav_1=phantom_stop(start_s=0.5)")
GRID = Grid(("late_fusion",), scenarios=("parking_street",), attacks=ATTACKS, seeds=(3000,), frames=16, options=DRIVEN)


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, list[CellResult]]:
    folder = tmp_path_factory.mktemp("one")
    with no_workers():
        return folder, benchmark(GRID, folder, films=True)


def test_lies_are_the_same_on_two_workers(run: tuple[Path, list[CellResult]], tmp_path: Path) -> None:
    benchmark(GRID, tmp_path, films=True, engine=Engine(workers=2))
    one, two = ({each.name: each.read_bytes() for each in (f / "cells").glob("*.parquet")} for f in (run[0], tmp_path))
    assert one == two and len(one) == 2


def test_a_report_plays_an_attack_that_aims_at_a_planner_beside_its_honest_twin(
    run: tuple[Path, list[CellResult]],
) -> None:
    table = ResultTable.of(run[1])
    (pair,) = lie_pairs(table, 5)
    assert pair.receiver == "cav_0" and pair.metric in ("phantom_brakes", "hard_brakes", "time_lost")
    (filmed,) = filmed_lies([pair], Films())
    honest, attacked = lie_figure(filmed, table).data["sides"]
    assert not any(each["claimed"] for each in honest["lies"]) and any(each["claimed"] for each in attacked["lies"])
