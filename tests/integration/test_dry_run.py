"""Dry runs count what is left, estimate its time, and write nothing."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from coopsim.bench.benchmark import benchmark
from coopsim.bench.detect.detect_plan import DetectPlan
from coopsim.bench.dry_run import _complete, estimate_benchmark, estimate_detection
from coopsim.bench.grid.grid import Grid
from coopsim.cli import main

SIMPLE = {"lidar": None, "vehicles": 4, "pedestrians": 0, "detector": "simulated"}


@pytest.mark.usefixtures("jobs_here")
def test_stored_cells_are_counted_and_give_the_seconds(tmp_path: Path) -> None:
    grid = Grid(("no_fusion",), seeds=(0,), frames=4, options=SIMPLE)
    fresh = estimate_benchmark(grid, tmp_path / "none")
    assert (fresh.runs, fresh.stored, fresh.timed) == (1, 0, 1) and fresh.left_s > 0
    assert not (tmp_path / "none").exists()
    benchmark(grid, tmp_path)
    larger = Grid(("no_fusion",), seeds=(0, 1, 2), frames=4, options=SIMPLE)
    partly = estimate_benchmark(larger, tmp_path)
    assert (partly.runs, partly.stored, partly.timed) == (3, 1, 0) and partly.left_s > 0
    whole = estimate_benchmark(grid, tmp_path)
    assert (whole.runs, whole.stored, whole.left_s) == (1, 1, 0.0)


def test_a_long_run_takes_longer_than_a_short_one(tmp_path: Path) -> None:
    short, long = (Grid(("no_fusion",), frames=frames, options=SIMPLE) for frames in (4, 4000))
    assert estimate_benchmark(long, tmp_path).left_s > 20 * estimate_benchmark(short, tmp_path).left_s


def test_episodes_of_detection_are_estimated_by_their_length() -> None:
    one = DetectPlan(("no_fusion",), seeds=(0,), frames=2, options=SIMPLE, detector="simulated")
    first, second = estimate_detection(one, None), estimate_detection(replace(one, frames=500), None)
    assert (
        first.runs == second.runs == 1 and second.left_s > 5 * first.left_s > 0
    )  # 250 times, on a machine that is free


def test_unmeasured_kinds_grow_as_the_slowest_policy_does() -> None:
    """The first one may be alone, and crash early in one environment and not in the other."""
    seconds = {("a", "x"): 1.0, ("b", "x"): 3.0, ("b", "y"): 6.0}
    wanted = [("a", "x"), ("a", "y"), ("b", "x"), ("b", "y")]
    found, measured = _complete({}, wanted, seconds.__getitem__)
    assert found["a", "y"] == 2.0 and measured == 3
    known, measured = _complete({("a", "x"): 1.0}, [("a", "x")], seconds.__getitem__)
    assert known == {("a", "x"): 1.0} and measured == 0


def test_commands_print_a_line_and_write_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    simple = ["--option", "lidar=null", "--detector", "simulated", "--frames", "3", "--dry-run", "--workers", "2"]
    assert main(["bench", "--policies", "no_fusion", "--seeds", "0-3", *simple]) == 0
    assert capsys.readouterr().out.startswith("4 runs, 0 are stored, 4 to run: about ")
    assert main(["detect", "--policies", "no_fusion", "--json", "rows.json", *simple]) == 0
    assert "2 episodes, 0 are stored, 2 to run: about " in capsys.readouterr().out
    assert list(tmp_path.iterdir()) == []
