"""The worst moments: found where they are, and varied."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from synthetic_results import FRAMES, LATENCIES, failed, result

from coopsim.bench.films.moments import LEAST_GAP, worst_windows
from coopsim.bench.grid.cell import Cell
from coopsim.bench.results.result_table import ResultTable


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
