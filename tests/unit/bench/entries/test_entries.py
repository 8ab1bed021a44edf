"""A leaderboard that others enter: what is as it should be enters, and each fault is one line."""

from __future__ import annotations

import json
import re
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from coopsim.bench.entries import fixed_run
from coopsim.bench.entries.entry_checks import check_folder
from coopsim.bench.entries.entry_folder import EntryFolder
from coopsim.bench.entries.entry_page import changes_from
from coopsim.bench.entries.fixed_run import SCORED, WARM_UP, differences, processor
from coopsim.bench.grid.cell import Cell, CellResult, Condition
from coopsim.bench.grid.grid_file import find_grid
from coopsim.bench.results.result_table import ResultTable
from coopsim.cli import main
from coopsim.cli.arguments import FAILED, USER_ERROR
from coopsim.errors import InvalidValueError, LeaderboardEntryError
from tests.helpers.entries import ABOUT, CARD, POLICY, SMALL, make_entry, tiny_grid

ROOT = Path(__file__).parents[4]
SHIPPED = sorted((ROOT / "leaderboard").iterdir())

pytestmark = pytest.mark.usefixtures("tiny_runs")


def lines_of(folder: Path, capsys: pytest.CaptureFixture[str], *flags: str) -> tuple[int, list[str]]:
    capsys.readouterr()
    return main(["entry", "check", str(folder), *flags]), capsys.readouterr().out.splitlines()


def test_a_good_entry_passes(entry: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert lines_of(entry, capsys) == (0, [f"{entry} is as it should be"])


def differences_of(entry: Path, run: fixed_run.FixedRun, spoil: Callable[[dict[str, Any]], object]) -> list[str]:
    """Return what a check finds if the file is spoilt, and the entry does what it did."""
    fresh = run.read(EntryFolder.read(entry))
    stored = json.loads(json.dumps(fresh))
    spoil(stored)
    return list(differences(run.file, stored, fresh))


@pytest.mark.parametrize("metric", ["sAMOTA", "MOTP", "bytes_per_s", "recall"])
def test_every_metric_of_a_repeated_cell_is_compared(entry: Path, metric: str) -> None:
    def add(stored: dict[str, Any], more: float) -> None:
        stored["cells"][1]["values"][metric] += more

    assert differences_of(entry, WARM_UP, lambda stored: add(stored, 1e-9)) == []
    (line,) = differences_of(entry, WARM_UP, lambda stored: add(stored, 1e-3))
    assert re.search(rf"warm_up\.json differs in .*seed 4001: {metric} is .* there and .* here$", line)


def test_another_processor_widens_nothing(entry: Path) -> None:
    def claim(stored: dict[str, Any], more: float) -> None:
        stored["processor"] = "x86_64 quantum"
        for cell in stored["cells"]:
            cell["values"]["HOTA"] += more

    assert differences_of(entry, SCORED, lambda stored: claim(stored, 1e-9)) == []
    lines = differences_of(entry, SCORED, lambda stored: claim(stored, 0.9))
    assert len(lines) == 2 and all("not comparable here" in line and "quantum" in line for line in lines)
    assert "OpenBLAS" in processor() or not list(Path(np.__file__).parents[1].glob("numpy.libs/*openblas*"))


def remove_policy(folder: Path) -> None:
    (folder / "policy.py").unlink()


def change_code(folder: Path) -> None:
    with (folder / "policy.py").open("a") as file:
        file.write("# changed\n")


def add_a_file(folder: Path) -> None:
    (folder / "more.yaml").write_text("{}")


def other_parameter(folder: Path) -> None:
    (folder / "entry.yaml").write_text(ABOUT.format(name="mine", policy="policy.py:MyTracker"))


def empty_card(folder: Path) -> None:
    (folder / "card.md").write_text(CARD.replace("Ours.", "<!-- to be said -->"))


def no_heading(folder: Path) -> None:
    (folder / "card.md").write_text(CARD.replace("## Source", "Source"))


def no_scores(folder: Path) -> None:
    (folder / "scores.json").unlink()


def broken_scores(folder: Path) -> None:
    (folder / "scores.json").write_text('{"cells": [{}]}')


def unknown_key(folder: Path) -> None:
    with (folder / "entry.yaml").open("a") as file:
        file.write("licence: MIT\n")


def no_yaml(folder: Path) -> None:
    (folder / "entry.yaml").write_text("name: [mine\n")


def script_as_url(folder: Path) -> None:
    with (folder / "entry.yaml").open("a") as file:
        file.write("url: javascript:alert(1)\n")


def outside(folder: Path) -> None:
    (folder / "entry.yaml").write_text(ABOUT.format(name="mine", policy="../policy.py:MyTracker"))


CARD_CHANGED = [r"card\.md changed since warm_up\.json", r"card\.md changed since scores\.json"]
YAML_CHANGED = [each.replace("card\\.md", "entry.yaml") for each in CARD_CHANGED]

FAULTS: list[tuple[Callable[[Path], None], list[str]]] = [
    (remove_policy, [r"policy names 'policy\.py', and there is no such file"]),
    (change_code, [r"policy\.py changed since warm_up\.json was made", r"policy\.py changed since scores\.json"]),
    (add_a_file, [r"more\.yaml changed since warm_up\.json was made", r"more\.yaml changed since scores\.json"]),
    (
        other_parameter,
        [r"warm_up\.json is of the policy .*0\.4", YAML_CHANGED[0], r"scores\.json is of the policy", YAML_CHANGED[1]],
    ),
    (empty_card, [r"card\.md has nothing under 'Source'", *CARD_CHANGED]),
    (no_heading, [r"card\.md has no heading 'Source'", *CARD_CHANGED]),
    (no_scores, [r"scores\.json is missing: run `coopsim entry score"]),
    (broken_scores, [r"scores\.json is broken"]),
    (unknown_key, [r"entry\.yaml:5: unknown key 'licence'\. Did you mean 'license'"]),
    (no_yaml, [r"entry\.yaml:\d: this is no YAML"]),
    (script_as_url, [r"entry\.yaml:5: url must begin with https://"]),
    (outside, [r"policy must name files of its folder"]),
]


@pytest.mark.parametrize(("spoil", "lines"), FAULTS, ids=lambda each: getattr(each, "__name__", ""))
def test_each_fault_of_a_folder_is_one_line(
    entry: Path, spoil: Callable[[Path], None], lines: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    spoil(entry)
    found = check_folder(entry)
    assert len(found) == len(lines) and all(map(re.search, lines, found)), found
    out = entry.parent / "site"
    capsys.readouterr()
    assert main(["entry", "page", str(entry), "--out", str(out)]) == FAILED  # no entry is left
    assert capsys.readouterr().out.splitlines() == [f"{entry}: {line}" for line in found] and not out.exists()


@pytest.mark.parametrize(
    ("policy", "line"),
    [
        ("truth", "policies must not need the truth"),
        ("late_fusoin", "unknown policy 'late_fusoin'. Did you mean 'late_fusion'"),
        ("no_such_package.tracker:Mine", "has no source here"),
    ],
)
def test_a_policy_that_may_not_enter(
    tmp_path: Path, policy: str, line: str, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = make_entry(tmp_path / "mine", policy)
    status, lines = lines_of(folder, capsys)
    assert status == FAILED and sum(line in each for each in lines) == 1
    assert all(line in each or "is missing: run" in each for each in lines)
    assert main(["entry", "warm-up", str(folder)]) == USER_ERROR and not (folder / "warm_up.json").exists()


def test_a_policy_that_breaks_the_rules_of_environments_is_told_so(
    entry: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (entry / "policy.py").write_text(POLICY.replace("[found[", "[1 // 0 for found in groups] or [found["))
    status, lines = lines_of(entry, capsys)
    assert status == FAILED
    assert sum("must report tracks, got " in line and "ZeroDivisionError" in line for line in lines) == 1
    assert sum("failed in" in line and "ZeroDivisionError" in line for line in lines) == 2  # of both runs


def test_a_folder_that_is_none(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for command in ("warm-up", "score", "check"):
        assert main(["entry", command, str(tmp_path / "none")]) == USER_ERROR
        assert "entry must be a folder with entry.yaml" in capsys.readouterr().err


def test_a_new_entry_has_its_card_to_fill_in(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = tmp_path / "mine"
    assert main(["entry", "new", str(folder)]) == 0
    assert EntryFolder.read(folder).spec().make() is not None
    assert [line.partition(" ")[0] for line in check_folder(folder)] == ["card.md"] * 4 + [
        "warm_up.json",
        "scores.json",
    ]
    assert main(["entry", "new", str(folder)]) == USER_ERROR and "has files" in capsys.readouterr().err


def test_the_page_names_what_has_a_fault(entry: Path, capsys: pytest.CaptureFixture[str]) -> None:
    spoilt = Path(shutil.copytree(entry, entry.parent / "spoilt"))
    (spoilt / "card.md").write_text(CARD.replace("Ours.", ""))
    twice = Path(shutil.copytree(entry, entry.parent / "twice"))
    folders = [str(each) for each in (entry, spoilt, twice)]
    capsys.readouterr()
    assert main(["entry", "page", *folders, "--out", str(entry.parent / "site")]) == FAILED
    out = capsys.readouterr().out
    assert f"{spoilt}: card.md has nothing" in out and f"{twice}: name 'mine' is that of {entry}" in out
    text = (entry.parent / "site" / "index.html").read_text()
    assert "Drops &lt;b&gt;unsure&lt;/b&gt; boxes." in text and "spoilt" not in text
    assert "http" not in text.replace("http-equiv", "")  # nothing is asked of another host


def test_the_page_runs_entries_only_if_asked_to(entry: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (entry / "policy.py").write_text("raise SystemExit('it was run')\n")
    assert ["changed since" in line for line in check_folder(entry)] == [True, True]


def test_differences_are_paired_by_town_and_corrected() -> None:
    towns = range(12)
    gains = np.linspace(2.0, 4.0, 12)

    def results(name: str, values: np.ndarray[Any, Any]) -> list[CellResult]:
        return [CellResult(Cell(name, Condition("town"), k), {"sAMOTA": values[k]}, place_seed=k) for k in towns]

    base = np.linspace(10.0, 90.0, 12)  # towns differ far more than policies
    table = ResultTable.of([*results("b", base), *results("better", base + gains), *results("same", base)])
    changes = changes_from(table, "b")
    assert changes["better"][0].startswith("+3.0 (+2.") and float(changes["better"][1].strip("< ")) <= 0.002
    assert changes["same"] == ("+0.0 (+0.0 to +0.0)", "1.000")
    assert changes_from(table, "nobody") == {}


def test_both_fixed_runs_have_towns_of_their_own() -> None:
    grids = {name: find_grid(name).grid() for name in ("leaderboard", "warm_up", "paper", "lies_places")}
    seeds = [seed for grid in grids.values() for seed in grid.seeds]
    assert len(set(seeds)) == len(seeds) and len(grids["leaderboard"].seeds) == 12
    assert all(grids[name].options == {"lidar": None} for name in ("leaderboard", "warm_up"))
    conditions = list(grids["leaderboard"].conditions())
    assert len(conditions) == 4 and {each.latency_s for each in conditions} == {0.0, 0.2}


def test_a_run_of_other_numbers_has_another_digest(monkeypatch: pytest.MonkeyPatch) -> None:
    before = WARM_UP.digest
    monkeypatch.setattr(fixed_run, "find_grid", lambda name, **given: tiny_grid(name, **given, latencies_ms=(300,)))
    assert WARM_UP.digest != before


def test_an_entry_that_is_broken_is_no_entry(tmp_path: Path) -> None:
    with pytest.raises(InvalidValueError, match="must be a folder"):
        EntryFolder.read(tmp_path / "none")
    tmp_path.joinpath("entry.yaml").write_text(ABOUT.format(name='""', policy="late_fusion"))
    with pytest.raises(LeaderboardEntryError, match=r"entry\.yaml:1: name must be a text"):
        EntryFolder.read(tmp_path)


@pytest.mark.parametrize("folder", SHIPPED, ids=[each.name for each in SHIPPED])
def test_entries_of_the_repository_enter(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """By the real fixed runs; the command that runs the warm-up again is a job of CI."""
    monkeypatch.setattr(fixed_run, "find_grid", find_grid)
    assert check_folder(folder) == []


def test_policies_on_sweeps_get_them() -> None:
    assert WARM_UP.grid().options == {"lidar": None, **SMALL}
    assert WARM_UP.grid(sweeps=True).options == SMALL


def test_the_results_page_shows_their_table(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(fixed_run, "find_grid", find_grid)
    page = ["entry", "page", *map(str, SHIPPED), "--runs", str(ROOT / "leaderboard_runs"), "--out", str(tmp_path)]
    assert main(page) == 0
    shown = [line for line in capsys.readouterr().out.splitlines() if line.startswith("|")]
    page = (ROOT / "docs" / "results" / "leaderboard.md").read_text(encoding="utf-8")
    assert len(shown) == 2 * (2 + len(SHIPPED)) and all(line in page for line in shown)
