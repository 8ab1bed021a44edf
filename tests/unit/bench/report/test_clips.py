"""The worst moments: found where they are, varied, and filmed from runs that are the same again."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from html_page import Page
from small_env import SMALL
from synthetic_results import FRAMES, LATENCIES, failed, result

from coopsim.bench.grid.cell import Cell, CellResult, Condition
from coopsim.bench.paper.provenance import Provenance
from coopsim.bench.report.clips import film
from coopsim.bench.report.publish import make_rerun, publish
from coopsim.bench.report.scene import UNIT_M
from coopsim.bench.results.result_table import ResultTable
from coopsim.bench.results.standings import LEAST_GAP, worst_windows
from coopsim.episode import Recorder
from coopsim.errors import InvalidValueError

OPTIONS = {name: value for name, value in SMALL.items() if name not in ("max_cycles", "threads")}


def with_dips(*dips: tuple[str, int, int, int, float], seeds: int = 2) -> ResultTable:
    """Even rewards of 0.5, 0.51 for the best, but for dips: policy, condition, seed, frame, depth over 10 frames."""
    given = []
    for policy in ("a", "b", "c"):
        for k, condition in enumerate(LATENCIES):
            for seed in range(seeds):
                rewards = np.full(FRAMES, 0.51 if policy == "c" else 0.5)
                for name, where, when, first, depth in dips:
                    if (name, where, when) == (policy, k, seed):
                        rewards[first : first + 10] -= depth
                given.append(replace(result(Cell(policy, condition, seed, FRAMES), 50.0), rewards=rewards))
    return ResultTable.of(given)


def test_the_worst_moment_is_where_the_dip_is() -> None:
    (moment,) = worst_windows(with_dips(("a", 1, 1, 20, 0.4)), 5, window_frames=10)
    assert moment.worst.cell == Cell("a", LATENCIES[1], 1, FRAMES) and moment.best.cell.policy == "c"
    assert (moment.first, moment.last) == (20, 30) and moment.gap == pytest.approx(0.41)


def test_moments_are_varied() -> None:
    # By depth alone, the first three would all be of policy a in one condition.
    table = with_dips(
        ("a", 0, 0, 0, 0.40), ("a", 0, 0, 20, 0.39), ("a", 0, 1, 10, 0.38), ("b", 1, 0, 20, 0.30), ("a", 2, 1, 30, 0.29)
    )  # fmt: skip
    chosen = [(each.worst.cell.policy, each.worst.cell.condition) for each in worst_windows(table, 3, 10)]
    assert chosen == [("a", LATENCIES[0]), ("b", LATENCIES[1]), ("a", LATENCIES[2])]
    everything = worst_windows(table, 50, 10)
    spans = [(each.worst.cell, each.first, each.last) for each in everything]
    for k, (cell, first, last) in enumerate(spans):
        for other, begin, end in spans[:k]:
            assert other != cell or end <= first or last <= begin, "no two of a run overlap"
    assert all(each.gap >= LEAST_GAP for each in everything)


def test_windows_are_not_longer_than_runs_and_failed_runs_are_in_none() -> None:
    table = with_dips(("a", 0, 0, 0, 0.4))
    (moment, *_) = worst_windows(table, 1, window_frames=1000)
    assert (moment.first, moment.last) == (0, FRAMES)
    gone = [failed(each.cell) if each.cell.policy == "a" else each for each in table.results]
    assert worst_windows(ResultTable.of(gone), 5) == ()
    assert worst_windows(ResultTable.of([failed(each.cell) for each in gone]), 5) == ()
    assert worst_windows(table, 0) == ()


def test_the_agent_is_the_one_that_suffers_most() -> None:
    table = with_dips(("a", 0, 0, 0, 0.4))
    (moment,) = worst_windows(table, 1)
    worse = replace(moment.worst, agents={"x": {"MOTA": 10.0}, "y": {"MOTA": 30.0}, "z": {}, "only": {"MOTA": 0.0}})
    better = replace(moment.best, agents={"x": {"MOTA": 20.0}, "y": {"MOTA": 60.0}, "z": {"MOTA": 99.0}})
    assert replace(moment, worst=worse, best=better).agent == "y"
    assert replace(moment, worst=replace(worse, agents={})).agent is None


CELLS = [Cell(policy, Condition("crossing", latency_s=0.2), 3, 8) for policy in ("no_fusion", "late_fusion")]


@pytest.fixture(scope="module")
def run() -> list[CellResult]:
    """Both cells, run for real, the first one worse."""
    given = [make_rerun(OPTIONS)(cell) for cell in CELLS]
    assert not any(each.failed for each in given), given[0].traceback
    return given


def moments_of(given: list[CellResult], first: int = 3, last: int = 6) -> Any:
    table = ResultTable.of(given)
    worst, best = sorted(table.results, key=lambda each: each.rewards.mean())
    from coopsim.bench.results.standings import Moment

    return [Moment(worst, best, first, last, 0.1)]


def test_a_clip_shows_the_frames_of_its_window(run: list[CellResult]) -> None:
    (moment,) = moments_of(run)
    (clip,), notes = film([moment], make_rerun(OPTIONS))
    assert notes == () and len(clip.frames) == len(clip.worst) == len(clip.best) == 3
    seen: list[Any] = []
    watch = Recorder()
    watch.on_step = lambda episode: seen.append(episode.env.bev_frame())  # type: ignore[method-assign]
    make_rerun(OPTIONS)(moment.worst.cell, watch)
    for shown, tracks, frame in zip(clip.frames, clip.worst, seen[3:6], strict=True):
        assert shown.time_ns == frame.time_ns and list(tracks) == [clip.agent]
        np.testing.assert_array_equal(shown.actors.boxes.center, frame.actors.boxes.center)
        np.testing.assert_array_equal(tracks[clip.agent].boxes.center, frame.tracks[clip.agent].boxes.center)
        assert len(shown.points) <= 500
    assert clip.start_s == pytest.approx(seen[3].time_ns / 1e9)
    data = clip.data()
    assert len(data["frames"]) == 3 and [len(each["tracks"]) for each in data["runs"]] == [3, 3] and UNIT_M > 0
    assert data["runs"][0]["score"] == pytest.approx(moment.worst.rewards[3:6], abs=1e-3)


def test_what_cannot_be_filmed_is_told(run: list[CellResult]) -> None:
    (moment,) = moments_of(run)
    policy = moment.worst.cell.policy
    changed = replace(moment, worst=replace(moment.worst, rewards=moment.worst.rewards + 1e-9))
    assert film([changed], make_rerun(OPTIONS)) == (
        (), (f"{policy}, seed 3: run again it gave other rewards, so something changed since",)
    )  # fmt: skip
    lost = replace(moment, worst=replace(moment.worst, cell=replace(moment.worst.cell, policy="nobody:Nothing")))
    clips, (note,) = film([lost], make_rerun(OPTIONS))
    assert clips == () and note.startswith(
        "nobody:Nothing, seed 3: it failed when it was run again: it names code, 'nobody:Nothing'"
    )


def test_time_is_bounded_and_a_run_is_run_once() -> None:
    table = with_dips(("a", 0, 0, 0, 0.4), ("a", 0, 0, 20, 0.4), ("b", 1, 1, 5, 0.3))
    moments = worst_windows(table, 3, 10)
    ran: list[Cell] = []

    def run(cell: Cell, *recorders: Recorder) -> CellResult:
        ran.append(cell)
        return failed(cell)

    ticks = iter((0.0, 0.0, 5.0, 11.0))
    clips, notes = film(moments, run, time_limit_s=10, clock=lambda: next(ticks))
    assert clips == () and notes[-1] == "1 clip is left out, as time was up after 10 s" and len(notes) == 3
    film(moments, run)
    assert len(ran) == len(set(ran)) + 4, "the first call's four runs, and then each run once"
    assert max(cell.frames for cell in ran) <= FRAMES


def test_publish_writes_everything_and_the_same_again(run: list[CellResult], tmp_path: Path) -> None:
    contents = []
    for name in ("one", "two"):
        paths = publish(tmp_path / name, run, Provenance(grid={"options": OPTIONS}), clips=2, with_plots=True)
        assert {path.relative_to(tmp_path / name).as_posix() for path in paths} == {
            *("report.html", "report.md", "results.csv", "intervals.csv", "protocol.txt"),
            *("tables/undisturbed.tex", "plots/sAMOTA_over_bytes.svg"),
        }
        contents.append([path.read_bytes() for path in paths])
    assert contents[0] == contents[1]
    page = Page((tmp_path / "one" / "report.html").read_text())
    gap = worst_windows(ResultTable.of(run), 2)
    assert len(page.data["clips"]) == len(gap) > 0 and "Worst moments" in page.texts("h2")
    assert sum(tag == "canvas" for tag, _, _ in page.elements) == 2 * len(gap)


def test_publish_without_clips_runs_nothing(tmp_path: Path) -> None:
    table = with_dips(("a", 1, 1, 20, 0.4))  # of policies that do not exist
    paths = publish(tmp_path / "a" / "b", table.results, clips=0, with_plots=True)
    assert (tmp_path / "a" / "b" / "plots" / "sAMOTA_latency.svg") in paths
    with pytest.raises(InvalidValueError, match="clips must be an integer >= 0"):
        publish(tmp_path, table.results, clips=-1)
    (tmp_path / "file").write_text("")
    with pytest.raises(InvalidValueError, match="cannot make the folder"):
        publish(tmp_path / "file", table.results, clips=0)
    with pytest.raises(InvalidValueError, match="there are no results"):
        publish(tmp_path, [])
