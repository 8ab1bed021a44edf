"""Files that others made name no code to run and no path to write, unless the user says so."""

from __future__ import annotations

import json
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import coopsim
from coopsim.bench.benchmark import check
from coopsim.bench.grid.cell import Cell, CellResult, Condition
from coopsim.bench.grid.grid import Grid
from coopsim.bench.grid.grid_file import find_grid
from coopsim.bench.nuscenes_results import read_plan
from coopsim.bench.paper.provenance import Provenance
from coopsim.bench.report.publish import publish
from coopsim.bench.store.store import Store
from coopsim.catalog import WRITING_OPTIONS
from coopsim.cli.entry import main
from coopsim.config.yaml_file import PATH_KEYS
from coopsim.envs.options import CommonOptions, PerceptionOptions
from coopsim.envs.simulated.simulation_options import SimulationOptions
from coopsim.errors import GridFileError, InvalidValueError, ScenarioFileError
from coopsim.support.user_code import code_in
from coopsim.world.drawn_options import PlaceSeeds, TownOptions
from coopsim.world.population import Population

OPTIONS = {"lidar": None, "vehicles": 4}


@pytest.fixture
def code(tmp_path: Path) -> tuple[str, Path]:
    """A policy in a file that leaves a trace when it is run, and the trace."""
    trace, file = tmp_path / "has_run", tmp_path / "theirs.py"
    file.write_text(f"open({str(trace)!r}, 'w').close()\nfrom coopsim.agents.boxes import LateFusion as Theirs\n")
    return f"{file}:Theirs", trace


def store_cells(folder: Path, policies: tuple[str, str], metric: str = "sAMOTA", **options: Any) -> None:
    """Forge a folder of results: the first policy falls behind the second, so that clips show both."""
    store, keys = Store(folder), []
    for policy, reward in zip(policies, (0.0, 0.9), strict=True):
        cell = Cell(policy, Condition(latency_s=0.2), 3, 30)
        result = CellResult(cell, {metric: reward}, {"cav_0": {metric: reward}}, np.full(30, reward))
        decided_by = json.dumps({"cell": policy})
        store.put(result, decided_by)
        keys.append(next(path.stem for path in (folder / "cells").glob("*.parquet") if path.stem not in keys))
    store.begin(keys, Provenance(grid={"options": {**OPTIONS, **options}}).as_data())


def test_a_report_runs_nothing_that_results_name(
    code: tuple[str, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    policy, trace = code
    victim = tmp_path / "victim"
    victim.write_text("mine")
    store_cells(tmp_path / "theirs", (policy, "no_fusion"), record=str(victim))
    assert main(["report", str(tmp_path / "theirs"), "--trust"]) == 0
    assert not trace.exists() and victim.read_text() == "mine"
    said = capsys.readouterr().err
    assert "no run has a film, so there are no clips" in said and "--trust is not needed" in said


def test_a_report_stays_in_its_folder(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Links in a folder of results, and names of metrics, lead nowhere else."""
    victim = tmp_path / "victim"
    victim.write_text("mine")
    store_cells(tmp_path / "theirs", ("no_fusion", "late_fusion"))
    (tmp_path / "theirs" / "report.md").symlink_to(victim)
    assert main(["report", str(tmp_path / "theirs"), "--clips", "0"]) == 2
    assert "it leads out of" in capsys.readouterr().err and victim.read_text() == "mine"
    results = Store(tmp_path / "theirs").results()
    name = "/../../outside"
    hostile = [replace(each, values={name: 1.0}, agents={"cav_0": {name: 1.0}}) for each in results]
    cells = [replace(each, cell=replace(each.cell, condition=Condition())) for each in hostile]
    with pytest.raises(InvalidValueError, match="it leads out of"):
        publish(tmp_path / "own", [*hostile, *cells], clips=0, with_plots=True)


@pytest.mark.usefixtures("jobs_here")
def test_a_stored_cell_is_the_one_that_was_asked_for(code: tuple[str, Path], tmp_path: Path) -> None:
    """A forged file under the key of a cell of ours would put its policy into our results, and into our clips."""
    from coopsim.bench.benchmark import benchmark

    policy, trace = code
    grid = Grid(("no_fusion",), frames=2, options=OPTIONS)
    (ours,) = benchmark(grid, tmp_path)
    (path,) = (tmp_path / "cells").glob("*.parquet")
    from coopsim.bench.store.cell_file import decode

    _, decided_by = decode(path.read_bytes())
    Store(tmp_path).put(replace(ours, cell=replace(ours.cell, policy=policy)), decided_by)
    broken: list[Exception] = []
    (again,) = benchmark(grid, tmp_path, on_broken=broken.append)
    assert again.cell == ours.cell and "of another cell" in str(broken[0]) and not trace.exists()


def test_a_grid_file_names_code_only_if_trusted(code: tuple[str, Path], tmp_path: Path) -> None:
    policy, trace = code
    path = tmp_path / "grid.yaml"
    path.write_text(f"frames: 2\npolicies: [no_fusion, '{policy}']\n")
    with pytest.raises(GridFileError, match=r"grid\.yaml:2: policies name code to run, .*--trust"):
        find_grid(path=path)
    assert main(["bench", "--grid", str(path), "--out", str(tmp_path / "out")]) == 2
    assert not trace.exists()
    check(find_grid(path=path, trust=True, options=OPTIONS).grid())
    assert trace.exists()
    assert find_grid(path=path, policies=(policy,)).grid().policies == (policy,), "typed by the user"
    path.write_text("policies: [no_fusion]\noptions:\n  record: victim\n")
    with pytest.raises(GridFileError, match=r"grid\.yaml:3: record is not an option here"):
        find_grid(path=path).grid()


@pytest.mark.parametrize(
    "content",
    [
        "policies: ['late_fusion(defense=\"mine.py:D\")']",
        "policies: [no_fusion]\noptions: {planner: 'mine.py:P'}",
        "policies: [no_fusion]\nattacks: ['cav_1=mine.py:A(x=1)']",
    ],
)
def test_a_grid_file_names_no_planner_attack_or_defence_of_strangers(content: str, tmp_path: Path) -> None:
    path = tmp_path / "grid.yaml"
    path.write_text(content)
    with pytest.raises(GridFileError, match=r"grid\.yaml:\d: \w+ name code to run, .*mine.py:.*--trust"):
        find_grid(path=path)
    assert find_grid(path=path, trust=True)


def test_what_is_no_code_is_not_taken_for_it() -> None:
    assert code_in({"planner": "idm_aeb(headway_s=2)", "device": "cuda:1", "many": [1, "a: b"]}) is None


def test_a_scenario_file_names_no_code(tmp_path: Path) -> None:
    path = tmp_path / "theirs.yaml"
    path.write_text("scenario: crossing\noptions:\n  planner: mine.py:P\n")
    with pytest.raises(ScenarioFileError, match=r"theirs\.yaml:\d: options must not name code to run, got 'mine.py:P'"):
        coopsim.parallel_env(path)


def test_a_scenario_file_names_no_file_to_write(tmp_path: Path) -> None:
    victim, path = tmp_path / "victim", tmp_path / "theirs.yaml"
    victim.write_text("mine")
    path.write_text(f"scenario: crossing\noptions:\n  lidar: null\n  record: {victim}\n")
    with pytest.raises(ScenarioFileError, match=r"theirs\.yaml:4: record belongs to the command"):
        coopsim.evaluate("no_fusion", str(path), max_cycles=2)
    assert victim.read_text() == "mine"


def test_an_export_names_no_file_to_write(tmp_path: Path) -> None:
    card = {"format": "nuscenes", "environment": "crossing", "seeds": [0], "frames": 2, "state": "done", "episodes": {}}
    (tmp_path / "export.json").write_text(json.dumps({**card, "options": {"record": str(tmp_path / "victim")}}))
    with pytest.raises(InvalidValueError, match="must not say which file to write"):
        read_plan(tmp_path)
    (tmp_path / "export.json").write_text(json.dumps({**card, "options": {"planner": "mine.py:P"}}))
    with pytest.raises(InvalidValueError, match=r"options must not name code to run, got 'mine.py:P'"):
        read_plan(tmp_path)


def test_every_option_that_may_be_a_path_is_read_or_withheld() -> None:
    """A new option with a path is thought of: either files may name what it reads, or it is the user's alone."""
    groups = (CommonOptions, PerceptionOptions, SimulationOptions, PlaceSeeds, TownOptions, Population)
    paths = {field.name for group in groups for field in fields(group) if "Path" in str(field.type)}
    assert {"playback", "record", "channel"} <= paths
    assert paths - {*WRITING_OPTIONS} <= {*PATH_KEYS}
