"""The order of jobs, and the time that is left."""

from __future__ import annotations

from coopsim.bench.engine.job import Job, Outcome
from coopsim.bench.engine.schedule import Schedule
from coopsim.bench.grid.cell import Cell, CellResult, Condition
from coopsim.catalog import PolicySpec


def job(policy: str, seed: int) -> Job:
    return Job(Cell(policy, Condition(), seed), {}, PolicySpec(policy), "")


def done(job: Job, seconds: float) -> Outcome:
    return Outcome(job, CellResult(job.cell), {"seconds": seconds})


def test_every_kind_is_tried_and_then_the_longest_comes_first() -> None:
    schedule = Schedule(job(policy, seed) for policy in ("short", "long") for seed in range(3))
    assert schedule.left_s() is None
    first, second = next(schedule), next(schedule)
    assert {first.cell.policy, second.cell.policy} == {"short", "long"}
    seconds = {"short": 1.0, "long": 10.0}
    for each in (first, second):
        schedule.learn(done(each, seconds[each.cell.policy]))
    assert schedule.left_s() == 2 * 1.0 + 2 * 10.0
    assert [each.cell.policy for each in schedule] == ["long", "long", "short", "short"]
    assert schedule.left_s() == 22.0 / 2  # all are running, each half done


def test_what_is_unknown_is_taken_for_the_mean() -> None:
    schedule = Schedule([job("a", 0), job("b", 0)])
    schedule.learn(done(next(schedule), 4.0))
    assert schedule.left_s() == 4.0


def test_nothing_to_do() -> None:
    assert list(Schedule([])) == []
