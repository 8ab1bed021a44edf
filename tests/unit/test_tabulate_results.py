"""The script that makes pages' tables of what `coopsim detect` and `coopsim bench` have measured."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import pytest
import tabulate_results

from coopsim.bench.benchmark import benchmark
from coopsim.bench.grid.grid import Grid


def row(policy: str, place: str, ap: float | None, **more: Any) -> dict[str, Any]:
    whole = {
        "policy": policy,
        "environment": place,
        "noise": None,
        "delay_ms": None,
        "APBEV@0.5": ap,
        "APBEV@0.7": 0.25,
    }
    return {**whole, "bytes_per_message": 1234.5, "ms_policy": 2.25, "intervals": {}, **more}


def tabulated(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], *words: object) -> list[list[str]]:
    """Return the cells of the table, its heading first."""
    monkeypatch.setattr(sys, "argv", ["tabulate_results.py", *map(str, words)])
    tabulate_results.main()
    lines = capsys.readouterr().out.splitlines()
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in lines if not line.startswith("|-")]


@pytest.fixture
def rows(tmp_path: Path) -> Path:
    intervals = {"APBEV@0.5": [0.4, 0.6]}
    clean = [
        *(row("early", place, ap) for place, ap in (("crossing", 0.5), ("highway", 0.75))),
        row("early", "all", 0.625, intervals=intervals),
        *(row("late_fusion", place, None) for place in ("crossing", "highway", "all")),
    ]
    (tmp_path / "clean.json").write_text(json.dumps(clean))
    noisy = [row("early", "crossing", ap, noise=noise) for ap, noise in ((0.5, "0/0"), (0.25, "0.4/0.4"))]
    (tmp_path / "noisy.json").write_text(json.dumps(noisy))
    return tmp_path


def test_runs_beside_each_other(
    rows: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    runs = (rows / "clean.json", f"bad poses={rows / 'noisy.json'}", "--metrics", "APBEV@0.5,APBEV@0.7")
    assert tabulated(monkeypatch, capsys, *runs) == [
        ["", "clean", "bad poses 0/0", "bad poses 0.4/0.4"],
        ["early", "0.625/0.250 (0.40-0.60)", "0.500/0.250", "0.250/0.250"],
        ["late_fusion", "-/0.250", "-", "-"],
    ]


def test_places_and_metrics_of_one_run(
    rows: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    clean = rows / "clean.json"
    places = tabulated(monkeypatch, capsys, clean, "--columns", "places", "--policy", "points=early")
    assert places == [["", "crossing", "highway"], ["points", "0.500", "0.750"]]
    metrics = ("--columns", "metrics", "--metrics", "bytes_per_message,ms_policy,APBEV@0.5")
    assert tabulated(monkeypatch, capsys, clean, *metrics)[1] == ["early", "1,234", "2.2", "0.625"]


def test_trainings_of_one_title_have_mean_and_deviation(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "clean.json"
    path.write_text(json.dumps([row(f"early(weights='{seed}')", "crossing", ap) for seed, ap in ((0, 0.5), (1, 0.7))]))
    titles = [word for seed in (0, 1) for word in ("--policy", f"Early=early(weights='{seed}')")]
    assert tabulated(monkeypatch, capsys, path, *titles)[1] == ["Early", "0.600 ± 0.141"]


@pytest.mark.usefixtures("jobs_here")
def test_a_benchmark_has_means_over_places_and_seeds(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    grid = Grid(("no_fusion",), ("crossing", "highway"), seeds=(0, 1), frames=2, options={"lidar": None})
    results = benchmark(grid, tmp_path / "run")
    values = [result.values["FN"] for result in results]
    words = (tmp_path / "run", "--columns", "metrics", "--metrics", "FN", "--standard-error")
    heading, (name, cell) = tabulated(monkeypatch, capsys, *words)
    assert heading == ["", "FN"] and name == "no_fusion"
    mean, error = (float(part) for part in cell.split(" ± "))
    assert mean == pytest.approx(sum(values) / 4, abs=0.5) and error > 0


def test_the_figure_has_a_line_for_each_policy(
    rows: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    drawn = rows / "drawn.svg"
    tabulated(monkeypatch, capsys, rows / "noisy.json", "--policy", "points=early", "--figure", drawn)
    assert "points" in drawn.read_text() and "bytes a second" in drawn.read_text()
