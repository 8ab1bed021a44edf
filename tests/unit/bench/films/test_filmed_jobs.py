"""Which cells are filmed, and that a film changes nothing else."""

from __future__ import annotations

import itertools
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from html_page import Page
from jobs_here import no_workers
from small_env import SMALL

from coopsim.bench.benchmark import Progress, benchmark
from coopsim.bench.engine.job import Job, run_job
from coopsim.bench.films import filmed_job
from coopsim.bench.films.choice import film_of
from coopsim.bench.films.filmed_job import cells_to_film
from coopsim.bench.grid.cell import Cell, CellResult, Condition
from coopsim.bench.grid.grid import Grid
from coopsim.bench.isolated.isolation import Isolation
from coopsim.bench.report.publish import publish
from coopsim.bench.store.store import Store
from coopsim.catalog import PolicySpec
from coopsim.cli.entry import main
from coopsim.episode import Recorder

OPTIONS = {name: value for name, value in SMALL.items() if name not in ("max_cycles", "threads")}
GRID = Grid(("late_fusion", "no_fusion"), latencies_ms=(200,), seeds=(3,), frames=8, options=OPTIONS)
MILD, LATE, LOSSY = Condition(), Condition(latency_s=0.3), Condition(latency_s=0.3, loss=0.5)


def cells(policies: str, *conditions: Condition, seeds: int = 2, frames: int | None = 10) -> list[Cell]:
    return [Cell(*each, frames) for each in itertools.product(policies, conditions, range(seeds))]


def test_all_that_a_report_may_show_is_filmed() -> None:
    several = cells("abt", MILD, LATE)
    assert cells_to_film(several, {"t"}) == {cell for cell in several if cell.policy != "t"}
    assert cells_to_film(cells("a", MILD, LATE)) == frozenset(), "nothing to compare it with"
    lying = cells("a", MILD, Condition(attacks="cav_1=ghost"))
    assert cells_to_film(lying) == set(lying), "a lie is compared with the honest run"


def test_of_a_large_grid_the_least_disturbed_runs_are_filmed_and_together(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(filmed_job, "MOST_FRAMES", 60)
    filmed = cells_to_film(cells("ab", LOSSY, MILD, LATE))
    assert filmed == set(cells("ab", MILD)) | set(cells("ab", LATE, seeds=1))
    monkeypatch.setattr(filmed_job, "MOST_FRAMES", 1)
    assert cells_to_film(cells("ab", LOSSY, MILD, frames=None)) == set(cells("ab", MILD, seeds=1, frames=None))


@pytest.fixture(scope="module")
def store(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a benchmark that keeps films."""
    folder = tmp_path_factory.mktemp("filmed")
    with no_workers():
        benchmark(GRID, folder, films=True)
    return folder


def test_a_film_shows_what_the_run_was(store: Path) -> None:
    result = next(each for each in Store(store).results() if each.cell.policy == "late_fusion")
    seen: list[Any] = []
    watch = Recorder()
    watch.on_step = lambda episode: seen.append(episode.env.bev_frame())  # type: ignore[method-assign]
    cell = result.cell
    plain = run_job(Job.of(cell, GRID.options, PolicySpec.parse(cell.policy)), (watch,)).result
    np.testing.assert_array_equal(plain.rewards, result.rewards)
    film = film_of(result)
    for shown, frame in zip(film.frames, seen, strict=True):
        assert shown.time_ns == frame.time_ns and set(shown.tracks) == set(frame.tracks)
        np.testing.assert_allclose(shown.truth[:, 1:3] / 100, frame.actors.boxes.center[:, :2], atol=0.0051)
        np.testing.assert_allclose(
            shown.tracks["cav_0"][:, 1:3] / 100, frame.tracks["cav_0"].boxes.center[:, :2], atol=0.0051
        )
        assert 0 < len(shown.points[""]) <= 500
        nearest = np.abs(shown.points_m("")[:, None] - frame.points[None, :, :2]).max(axis=2).min(axis=1)
        assert nearest.max() <= 0.0251


@pytest.mark.usefixtures("jobs_here")
def test_a_run_has_the_same_key_and_result_filmed_or_not(store: Path, tmp_path: Path) -> None:
    plain = benchmark(GRID, tmp_path)
    filmed = Store(store).results()
    assert {path.name for path in (tmp_path / "cells").glob("*.parquet")} == {
        path.name for path in (store / "cells").glob("*.parquet")
    }
    for one, two in zip(plain, filmed, strict=True):
        assert one.values == two.values and one.film is None and two.film is not None
        np.testing.assert_array_equal(one.rewards, two.rewards)
    assert not (tmp_path / "films").exists()


@pytest.mark.usefixtures("jobs_here")
def test_a_salted_run_is_not_filmed(tmp_path: Path) -> None:
    results = benchmark(GRID, tmp_path, films=True, isolation=Isolation(None, b"x" * 16))
    assert not any(each.failed or each.film for each in results)


def test_equal_results_with_equal_films_give_equal_reports_and_nothing_is_run(
    store: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*args: object, **options: object) -> None:
        raise AssertionError("a report makes no environment")

    for name in ("bench.evaluate.listening_env", "bench.engine.job.evaluate", "provided.parallel_env"):
        monkeypatch.setattr(f"coopsim.{name}", refuse)
    shutil.copytree(store, tmp_path / "copy")
    contents = []
    for folder, out in ((store, "one"), (store, "two"), (tmp_path / "copy", "three")):
        paths = publish(tmp_path / out, Store(folder).results(), clips=2, with_plots=True)
        assert {path.relative_to(tmp_path / out).as_posix() for path in paths} == {
            *("report.html", "report.md", "results.csv", "intervals.csv", "protocol.txt"),
            *("tables/undisturbed.tex", "plots/sAMOTA_over_bytes.svg"),
        }
        contents.append([path.read_bytes() for path in paths])
    assert contents[0] == contents[1] == contents[2]
    page = Page((tmp_path / "one" / "report.html").read_text())
    count = len(page.data["pairs"])
    assert count > 0 and "Worst moments" in page.texts("h2")
    assert sum(tag == "canvas" for tag, _, _ in page.elements) == 2 * count
    (frames, sides) = (page.data["pairs"][0][name] for name in ("frames", "sides"))
    assert [len(side["runs"][0]["tracks"]) for side in sides] == [len(frames)] * 2


def without_films(store: Path, folder: Path) -> list[CellResult]:
    shutil.copytree(store, folder)
    return Store(folder).results()


def test_a_lost_or_broken_film_is_told_and_the_report_goes_on(store: Path, tmp_path: Path) -> None:
    results = without_films(store, tmp_path / "copy")
    broken, lost = (each.film for each in results)
    assert broken is not None and lost is not None
    broken.write_bytes(broken.read_bytes()[:-9])
    notes: list[str] = []
    publish(tmp_path / "copy", results, on_note=notes.append)
    (note,) = notes
    assert note.startswith(f"the film films/{broken.name} is broken: ")
    page = (tmp_path / "copy" / "report.html").read_text()
    assert str(broken.name) in page and "Worst moments" not in page and "Ranking" in page
    lost.unlink()
    notes.clear()
    publish(tmp_path / "copy", Store(tmp_path / "copy").results(), on_note=notes.append)
    assert notes == ["1 of 2 runs have no film: `coopsim bench` of the same grid with --retry-unfilmed runs them again"]


@pytest.mark.usefixtures("jobs_here")
def test_a_store_without_films_says_what_to_do_and_that_helps(
    store: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "old"
    without_films(store, folder)
    first = sorted((folder / "films").iterdir())[0]
    shutil.rmtree(folder / "films")
    assert main(["report", str(folder), "--clips", "1"]) == 0
    said = capsys.readouterr().err
    assert said.count("\n") == 1 and said.startswith("coopsim: no run has a film") and "--retry-unfilmed" in said
    assert main(["report", str(folder), "--clips", "0"]) == 0 and not capsys.readouterr().err
    stored: list[int] = []

    def note(progress: Progress) -> None:
        stored.append(progress.stored)

    benchmark(GRID, folder, films=True, on_progress=note)
    assert stored == [2] and not (folder / "films").exists(), "stored results stand, filmed or not"
    benchmark(GRID, folder, films=True, retry_unfilmed=True)
    assert all(each.film for each in Store(folder).results())
    first = folder / "films" / first.name
    first.write_bytes(b"broken")
    stored.clear()
    again = benchmark(
        GRID, folder, films=True, retry_unfilmed=True, on_progress=lambda each: stored.append(each.stored)
    )
    assert stored[0] == 1 and all(film_of(each) for each in again), "one that is broken is filmed again"
