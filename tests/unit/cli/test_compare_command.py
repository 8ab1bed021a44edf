"""`coopsim compare`: folders or policies, what it prints and writes, and what it says when it cannot."""

from __future__ import annotations

import csv
import json
import re
from dataclasses import replace
from pathlib import Path

import pytest
from synthetic_results import LATENCIES, results

from coopsim.bench.grid.cell import CellResult
from coopsim.bench.store.store import Store
from coopsim.cli import main


def stored(folder: Path, given: list[CellResult]) -> Path:
    store = Store(folder)
    for number, each in enumerate(given):
        store.put(each, f"what decides {number}")
    return folder


def raised(given: list[CellResult], by: float) -> list[CellResult]:
    return [replace(each, values={**each.values, "sAMOTA": each.values["sAMOTA"] + by}) for each in given]


RESULTS = results({"bad": 30.0, "good": 60.0}, LATENCIES[:2], seeds=range(10))


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """In which there are the results `before`, and an empty folder of some."""
    folder = tmp_path_factory.mktemp("benchmarks")
    stored(folder / "before", RESULTS)
    (folder / "empty" / "cells").mkdir(parents=True)
    return folder


def test_two_folders(folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    before, after = folder / "before", stored(tmp_path / "after", raised(RESULTS, 5.0)[:-1])
    rows, everything = tmp_path / "rows.csv", tmp_path / "all.json"
    assert main(["compare", str(before), str(after), "--csv", str(rows), "--json", str(everything)]) == 0
    printed = capsys.readouterr().out
    assert f"A: {before}\nB: {after}\n" in printed and "39 pairs of runs, 9 to 10 seeds, 6 comparisons (6 id" in printed
    assert "good, sAMOTA, over all conditions: B is better (B - A = +5," in printed
    assert "good, HOTA, over all conditions: A and B are identical" in printed
    assert "Left out (1):" in printed and "seed 9, 40 frames: not in B" in printed
    written = json.loads(everything.read_text())
    assert written["a"] == str(before) and written["pairs"] == 39 and len(written["differences"]) == 12
    assert [row["verdict"] for row in csv.DictReader(rows.read_text().splitlines())] == [
        row["verdict"] for row in written["differences"]
    ]


def test_two_policies_of_a_folder(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["compare", "bad", "good", "--results", str(folder / "before"), "--metrics", "sAMOTA,IDS"]) == 0
    printed = capsys.readouterr().out
    assert "good - bad, sAMOTA, over all conditions: B is better" in printed
    assert "Of 2 conditions, B is better in 2, worse in 0." in printed
    assert "good - bad, IDS, over all conditions: B is better (B - A = -30" in printed, "less is better"


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (
            ["{}/befor", "{}/before"],
            "unknown folder of results 'befor' in {} (policies need --results). Did you mean 'before'?",
        ),
        (["{}/none/a", "{}/before"], "unknown folder of results"),
        (["good", "goood", "--results", "{}/before"], "unknown policy of the results 'goood'. Did you mean 'good'?"),
        (["good", "good", "--results", "{}/before"], "A and B must be two policies, got 'good' for both"),
        (["{}/before", "{}/empty"], "there are no results in {}/empty: run `coopsim bench` first"),
        (["{}/before", "{}/before", "--metrics", "MOTTA"], "unknown metric 'MOTTA'. Did you mean 'sAMOTA'"),
        (["{}/before", "{}/before", "--json", "{}/x", "--csv", "{}/x"], "--json and --csv must be two files"),
        (["{}/before", "{}/before", "--json", "{}/no/x"], "cannot write {}/no/x"),
    ],
)
def test_mistakes_are_named(
    folder: Path, arguments: list[str], message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["compare", *(each.format(folder) for each in arguments)]) == 2
    shown = capsys.readouterr()
    assert shown.out == "" and message.replace("{}", str(folder)) in shown.err
    assert not re.search("Traceback", shown.err) and not (folder / "befor").exists(), "and nothing is made"
