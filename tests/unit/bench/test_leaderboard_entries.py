"""A leaderboard that others enter: what is as it should be enters, and each fault is one line."""

from __future__ import annotations

import json
import re
import shutil
from collections.abc import Callable, Iterator
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
from coopsim.bench.grid.grid_file import GridSource, find_grid
from coopsim.bench.results.result_table import ResultTable
from coopsim.cli import main
from coopsim.cli.arguments import FAILED, USER_ERROR
from coopsim.errors import InvalidValueError, LeaderboardEntryError

ROOT = Path(__file__).parents[3]
SHIPPED = sorted((ROOT / "leaderboard").iterdir())

ABOUT = """\
name: {name}
policy: {policy}
authors: [A. Nother]
license: MIT
"""

CARD = """\
## Method

Drops <b>unsure</b> boxes.

## Source

Ours.

## Differences from the paper

None.

## Training and tuning

None.
"""

POLICY = """\
from dataclasses import dataclass

from coopsim.agents.boxes import LateFusion


@dataclass(kw_only=True, eq=False)
class MyTracker(LateFusion):
    least_score: float = 0.3

    def fuse(self, groups):
        return super().fuse([found[found.score >= self.least_score] for found in groups])
"""

MINE = "policy.py:MyTracker(least_score=0.4)"


def make(folder: Path, policy: str = MINE, name: str = "mine") -> Path:
    folder.mkdir()
    (folder / "entry.yaml").write_text(ABOUT.format(name=name, policy=policy))
    (folder / "card.md").write_text(CARD)
    if ".py" in policy:
        (folder / "policy.py").write_text(POLICY)
    return folder


def tiny(name: str, **given: Any) -> GridSource:
    """Two towns of five frames, without the preset's conditions but one."""
    small = {"seeds": (4000, 4001), "frames": 5, "losses": (0.1,), "position_noises_m": (0.2,)}
    return find_grid(name, **given, **small, heading_noises_deg=(0.2,), options={"vehicles": 6})


@pytest.fixture(scope="module", autouse=True)
def tiny_runs() -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(fixed_run, "find_grid", tiny)
        yield


@pytest.fixture(scope="module")
def measured(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An entry with scores, made by the commands."""
    folder = make(tmp_path_factory.mktemp("entries") / "mine")
    assert main(["entry", "warm-up", str(folder)]) == 0
    assert main(["entry", "score", str(folder), "--workers", "1"]) == 0
    return folder


@pytest.fixture
def entry(measured: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(measured, tmp_path / "mine"))


def lines_of(folder: Path, capsys: pytest.CaptureFixture[str], *flags: str) -> tuple[int, list[str]]:
    capsys.readouterr()
    return main(["entry", "check", str(folder), "--workers", "1", *flags]), capsys.readouterr().out.splitlines()


@pytest.mark.parametrize("flags", [("--whole",), ("--isolate",)])
def test_a_good_entry_passes(entry: Path, flags: tuple[str, ...], capsys: pytest.CaptureFixture[str]) -> None:
    assert lines_of(entry, capsys, *flags) == (0, [f"{entry} is as it should be"])


def changed_values(folder: Path, run: fixed_run.FixedRun, change: float, key: str = "sAMOTA") -> None:
    scores = json.loads((folder / run.file).read_text())
    scores["cells"][1]["values"][key] += change
    run.write(folder, scores)


def test_a_tampered_warm_up_is_found_to_the_last_bit(entry: Path, capsys: pytest.CaptureFixture[str]) -> None:
    scores = json.loads((entry / "warm_up.json").read_text())
    before = scores["cells"][1]["values"]["MOTP"]
    changed_values(entry, WARM_UP, float(np.nextafter(before, 1e9)) - before, "MOTP")
    status, lines = lines_of(entry, capsys)
    assert status == FAILED and len(lines) == 1
    assert re.search(r"warm_up\.json differs in .*seed 4001: MOTP is .* there and .* here$", lines[0])


def test_tampered_scores_are_found_by_the_whole_check(entry: Path, capsys: pytest.CaptureFixture[str]) -> None:
    changed_values(entry, SCORED, 3.0)
    assert lines_of(entry, capsys)[0] == 0  # the warm-up is that of this code
    status, lines = lines_of(entry, capsys, "--whole")
    assert status == FAILED and len(lines) == 1 and "scores.json differs in" in lines[0]


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


FAULTS: list[tuple[Callable[[Path], None], list[str]]] = [
    (remove_policy, [r"policy names 'policy\.py', and there is no such file"]),
    (change_code, [r"policy\.py changed since warm_up\.json was made", r"policy\.py changed since scores\.json"]),
    (add_a_file, [r"more\.yaml changed since warm_up\.json was made", r"more\.yaml changed since scores\.json"]),
    (other_parameter, [r"warm_up\.json is of the policy .*0\.4", r"scores\.json is of the policy"]),
    (empty_card, [r"card\.md has nothing under 'Source'"]),
    (no_heading, [r"card\.md has no heading 'Source'"]),
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
        ("truth", "told the truth: a bound, which does not compete"),
        ("late_fusoin", "unknown policy 'late_fusoin'. Did you mean 'late_fusion'"),
        ("no_such_package.tracker:Mine", "has no source here"),
    ],
)
def test_a_policy_that_may_not_enter(
    tmp_path: Path, policy: str, line: str, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = make(tmp_path / "mine", policy)
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
    assert sum("must report tracks, got ZeroDivisionError" in line for line in lines) == 1
    assert sum("failed in" in line and "ZeroDivisionError" in line for line in lines) == 1


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


def test_the_page_ranks_what_passed(entry: Path, capsys: pytest.CaptureFixture[str]) -> None:
    other = Path(shutil.copytree(entry, entry.parent / "other"))
    (other / "entry.yaml").write_text(ABOUT.format(name="<i>other</i>", policy=MINE))
    changed_values(other, SCORED, 5.0)
    spoilt = Path(shutil.copytree(entry, entry.parent / "spoilt"))
    empty_card(spoilt)
    twice = Path(shutil.copytree(entry, entry.parent / "twice"))
    folders = [str(each) for each in (entry, other, spoilt, twice)]
    page = [*("entry", "page", *folders), "--out", str(entry.parent / "site"), "--baseline", "mine"]
    capsys.readouterr()
    assert main(page) == FAILED
    out = capsys.readouterr().out
    assert f"{spoilt}: card.md has nothing" in out and f"{twice}: name 'mine' is that of {entry}" in out
    text = (entry.parent / "site" / "index.html").read_text()
    assert text.index("&lt;i&gt;other&lt;/i&gt;") < text.index(">mine</a>") and "<i>" not in text
    assert "Drops &lt;b&gt;unsure&lt;/b&gt; boxes." in text and "spoilt" not in text
    assert "http" not in text.replace("http-equiv", "")  # nothing is asked of another host
    assert main([*page[:-1], "nobody"]) == USER_ERROR
    assert "unknown baseline 'nobody'" in capsys.readouterr().err


def test_the_page_runs_entries_only_if_asked_to(entry: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (entry / "policy.py").write_text("raise SystemExit('it was run')\n")
    assert "changed since" in check_folder(entry)[0]
    changed_values(entry, WARM_UP, 1.0)
    assert len(check_folder(entry)) == 2


def test_elsewhere_scores_need_only_be_close(entry: Path) -> None:
    stored = WARM_UP.read(EntryFolder.read(entry))
    fresh = json.loads(json.dumps(stored)) | {"processor": "another"}
    fresh["cells"][0]["values"]["sAMOTA"] += 0.9
    fresh["cells"][0]["values"]["MOTP"] += 9.0
    assert list(differences("warm_up.json", stored, fresh)) == []
    fresh["cells"][0]["values"]["sAMOTA"] += 0.2
    (line,) = differences("warm_up.json", stored, fresh)
    assert "another processor" in line and stored["processor"] == processor()


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
    monkeypatch.setattr(fixed_run, "find_grid", lambda name, **given: tiny(name, **given, latencies_ms=(300,)))
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


def test_policies_on_sweeps_get_them_and_are_ranked_apart(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert WARM_UP.grid().options == {"lidar": None, "vehicles": 6}
    assert WARM_UP.grid(sweeps=True).options == {"vehicles": 6}
    monkeypatch.setattr(fixed_run, "find_grid", find_grid)
    folders = [Path(shutil.copytree(each, tmp_path / each.name)) for each in SHIPPED]
    scores = json.loads((folders[0] / SCORED.file).read_text())
    SCORED.write(folders[0], scores | {"reads": "sensors"})
    assert main(["entry", "page", *map(str, folders), "--out", str(tmp_path / "site")]) == 0
    boxes, sensors = capsys.readouterr().out.split("Policies that read sweeps or pictures")
    assert folders[0].name in sensors and folders[0].name not in boxes
    assert " -0." not in sensors and "| 1 " in sensors  # no difference to a baseline that reads something else


def test_the_results_page_shows_their_table(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(fixed_run, "find_grid", find_grid)
    assert main(["entry", "page", *map(str, SHIPPED), "--out", str(tmp_path)]) == 0
    shown = [line for line in capsys.readouterr().out.splitlines() if line.startswith("|")]
    page = (ROOT / "docs" / "results" / "leaderboard.md").read_text(encoding="utf-8")
    assert len(shown) == 2 + len(SHIPPED) and all(line in page for line in shown)
