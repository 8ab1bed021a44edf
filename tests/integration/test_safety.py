"""A benchmark of situations: the same for any number of workers, resumed, and told with pairs and films."""

from __future__ import annotations

from contextlib import nullcontext
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from jobs_here import no_workers
from PIL import Image

from coopsim.bench.benchmark import benchmark
from coopsim.bench.engine.engine import Engine
from coopsim.bench.engine.job import Job, run_job
from coopsim.bench.films.filming import Filming
from coopsim.bench.films.recording import Recording
from coopsim.bench.grid.cell import Cell, CellResult, Condition
from coopsim.bench.grid.grid import Grid
from coopsim.bench.report.bench_report import About, Played, render_bench_report
from coopsim.bench.report.crash_figures import KEYS, NOTE, crash_figure
from coopsim.bench.report.film_section import FilmSection
from coopsim.bench.report.publish import publish
from coopsim.bench.results.result_table import ResultTable
from coopsim.bench.safety.movie import write_movie
from coopsim.bench.safety.pair_clip import SIZE_PX, PairClip
from coopsim.bench.safety.panel import CRASH, Panel, View
from coopsim.bench.store.store import Store
from coopsim.catalog import PolicySpec
from coopsim.cli.entry import main
from coopsim.episode import Recorder
from coopsim.interfaces.planner import PLANNERS, PlannedCar, Planner

SITUATION = "crossing_path"
BLIND: dict[str, Any] = {"lidar": None}
GRID = Grid(
    ("no_fusion", "late_fusion"), scenarios=(SITUATION,), penetrations=(1, 0), seeds=(0, 1), frames=8, options=BLIND
)


class KeepsItsSpeed(Planner):
    """Drives into whatever is in its way."""

    def plan(self, car: PlannedCar) -> float:
        return 0.0


class Falls(Planner):
    def plan(self, car: PlannedCar) -> float:
        raise RuntimeError("no idea")


@pytest.fixture(scope="module", autouse=True)
def planners() -> None:
    for name, kind in {"keeps_its_speed": KeepsItsSpeed, "falls": Falls}.items():
        if name not in PLANNERS:
            PLANNERS.register(name)(kind)


def run(cell: Cell, *recorders: Recorder, **options: Any) -> CellResult:
    return run_job(Job.of(cell, options, PolicySpec.parse(cell.policy)), recorders).result


def told(results: list[CellResult]) -> str:
    return repr([(each.cell, each.values, each.agents, each.rewards.tolist(), each.messages) for each in results])


@pytest.mark.heavy("it draws all figures of a benchmark")
@pytest.mark.parametrize("workers", [0, pytest.param(2, marks=pytest.mark.long)])
def test_results_are_the_same_after_an_interruption(tmp_path: Path, workers: int) -> None:
    """And for any number of workers; none: in this process."""
    with nullcontext() if workers else no_workers():
        whole = benchmark(GRID, tmp_path / "two", engine=Engine(workers=workers or 1))
    assert not any(each.failed for each in whole) and all("crash" in each.values for each in whole)
    stored: list[int] = []
    with no_workers():
        part = replace(GRID, seeds=(1,))
        benchmark(part, tmp_path / "one")
        again = benchmark(GRID, tmp_path / "one", on_progress=lambda progress: stored.append(progress.stored))
    assert stored[0] == len(part) == 4, "the cells of the interrupted run are taken from the store"
    assert told(again) == told(whole)
    assert told(Store(tmp_path / "one").results()) == told(whole)
    written = publish(tmp_path / "two", whole, clips=0)
    names = {path.relative_to(tmp_path / "two").as_posix() for path in written}
    assert {"safety.md", "plots/crash_over_penetration.svg", "plots/crash_over_bytes.svg"} <= names
    assert "Crashes" in (tmp_path / "two" / "report.html").read_text(encoding="utf-8")
    text = (tmp_path / "two" / "safety.md").read_text(encoding="utf-8")
    assert "## What messages change" in text and "### penetration" in text and "nan" not in text


def test_a_planner_that_falls_loses_its_own_cell() -> None:
    result = run(Cell("no_fusion", Condition(SITUATION), 0, None), planner="falls")
    assert result.failed and "no idea" in str(result.reason) and "cav_0" in str(result.reason)
    assert not run(Cell("no_fusion", Condition(SITUATION), 0, 5)).failed


@pytest.fixture(scope="module")
def crash() -> Recording:
    """A car that does not brake, in the first seed in which it meets what comes."""
    for seed in range(12):
        cell, filming = Cell("late_fusion", Condition(SITUATION), seed, None), Filming()
        result = run(cell, filming, planner="keeps_its_speed")
        assert not result.failed, result.traceback
        if result.values["crash"]:
            return Recording.of(cell, filming.film)
    raise AssertionError("nothing was hit in twelve seeds")


def test_a_recording_ends_at_the_crash(crash: Recording) -> None:
    assert crash.events.crash_s == pytest.approx(crash.end_s) and crash.events.impact_m_s > 0
    assert len(crash.drive) == len(crash.film.frames) + 1 == len(crash.film.arrived)
    assert all(each[crash.agent] for each in crash.film.arrived), (
        "messages reach the car in every frame, the first among them"
    )
    assert crash.drive.in_conflict.any(), "the script says what it must not touch"
    half = (crash.drive.time_s[3] + crash.drive.time_s[4]) / 2
    between = (crash.drive.car[3] + crash.drive.car[4]) / 2
    np.testing.assert_allclose(crash.at(half).car, between, atol=1e-9)
    assert crash.at(crash.end_s + 5).car.tolist() == crash.drive.car[-1].tolist(), "then it stands"


def test_the_star_is_drawn_from_the_crash_on(crash: Recording) -> None:
    panel = Panel(crash, View.of([crash], crash.end_s - 3), (300, 220))
    before, after = (panel.draw(crash.end_s + shift) for shift in (-0.3, 0.0))

    def red(picture: Image.Image) -> int:
        return int((np.abs(np.asarray(picture).astype(int) - CRASH).max(axis=2) < 30).sum())

    assert red(after) > red(before) + 20


def test_a_clip_lasts_as_long_as_asked_and_slows_down(crash: Recording) -> None:
    clip = PairClip(crash, crash, lasts_s=30.0)
    beats = clip.beats()
    assert sum(beat.lasts_s for beat in beats) == pytest.approx(30.0, abs=0.1)
    assert beats[0].from_s == beats[0].to_s and beats[-1].from_s == beats[-1].to_s, "standing pictures to be read"
    assert all(earlier.to_s == later.from_s for earlier, later in pairwise(beats))


def test_a_report_plays_a_pair_up_to_its_crash(crash: Recording) -> None:
    table = ResultTable.of([CellResult(crash.cell, {"crash": 100.0, "bytes_per_s": 0.0})])
    figure = crash_figure((crash, crash), table)
    data = figure.data
    side = data["sides"][0]
    assert len(side["frames"]) == len(side["marks"]) == len(side["runs"][0]["tracks"]) > 5
    (run,) = side["runs"]
    assert len(run["news"]) == len(run["tracks"]) and any(run["news"]), "what messages tell of is marked"
    assert [mark["crash"] for mark in side["marks"]] == [False] * (len(side["marks"]) - 1) + [True]
    assert all(mark["met"] for mark in side["marks"]), "what it must not touch is ringed"
    page = render_bench_report(table, About(), Played([FilmSection("Telling pairs", NOTE, KEYS, [figure])]))
    assert "Telling pairs" in page and f"crash at {3.6 * crash.events.impact_m_s:.0f} km/h" in page


def test_a_clip_becomes_a_file(tmp_path: Path, crash: Recording) -> None:
    path = write_movie(tmp_path / "a.gif", PairClip(crash, crash, lasts_s=22.0).frames(1), 1)
    with Image.open(path) as found:
        width, height = found.size
        assert width / height == SIZE_PX[0] / SIZE_PX[1]
        assert found.n_frames > 3  # type: ignore[attr-defined]


def test_the_command_says_what_it_cannot_film(
    tmp_path: Path, crash: Recording, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "pair.gif"
    seeds = f"--seeds={crash.cell.seed}"
    same = ["--alone", "late_fusion", "--sharing", "late_fusion", "--option", "planner=keeps_its_speed"]
    assert main(["clip", SITUATION, seeds, "--out", str(out), *same]) == 2
    assert "policies must be distinct" in capsys.readouterr().err
    assert main(["clip", "highway", "--seeds=0", "--out", str(out)]) == 2
    assert "a car must be driven in highway: add control=planner" in capsys.readouterr().err
    assert not out.exists()
