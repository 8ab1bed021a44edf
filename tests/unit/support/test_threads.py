"""Sharing work among threads changes its time and nothing else."""

from __future__ import annotations

import threading
from functools import partial

import pytest

from coopsim.sensors.lidar.cast.atomics import Counters
from coopsim.support.threads import run_all, work_together


@pytest.mark.parametrize("threads", [1, 2, 3, 50])
@pytest.mark.parametrize("count", [0, 1, 2, 7])
def test_results_are_in_order_and_nothing_is_done_twice(threads: int, count: int) -> None:
    done: list[int] = []

    def act(k: int) -> int:
        done.append(k)
        return k * k

    assert run_all([partial(act, k) for k in range(count)], threads, "test") == [k * k for k in range(count)]
    assert sorted(done) == list(range(count))


def test_two_threads_work_at_once() -> None:
    meeting = threading.Barrier(2, timeout=10.0)  # breaks, were they to come one after the other
    assert set(run_all([meeting.wait] * 2, 2, "test")) == {0, 1}


@pytest.mark.parametrize("threads", [1, 2])
@pytest.mark.parametrize("broken", [0, 1, 2])
def test_an_error_comes_out_when_nobody_works_any_more(threads: int, broken: int) -> None:
    running: set[int] = set()

    def act(k: int) -> None:
        running.add(k)
        if k == broken:
            running.remove(k)
            raise ValueError(f"act {k}")
        running.remove(k)

    with pytest.raises(ValueError, match=f"act {broken}"):
        run_all([partial(act, k) for k in range(3)], threads, "test")
    assert not running


def test_an_act_may_share_work_with_another_crew() -> None:
    def act(k: int) -> int:
        return sum(run_all([partial(int, k)] * 5, 2, "inner"))

    assert run_all([partial(act, k) for k in range(6)], 2, "outer") == [5 * k for k in range(6)]


def nothing(bell: Counters, number: int) -> None:
    pass


@pytest.mark.parametrize("threads", [1, 2, 4])
def test_every_helper_is_called_and_given_what_the_leader_is(threads: int) -> None:
    meeting, given = threading.Barrier(threads, timeout=10.0), list[tuple[int, int]]()

    def act(bell: Counters, number: int) -> None:
        meeting.wait()  # breaks, were one missing
        given.append((id(bell), number))
        meeting.wait()

    for _ in range(3):
        work_together(act, act, threads)
    assert len(given) == 3 * threads and len({bell for bell, _ in given}) == 1
    numbers = [number for _, number in given]
    assert numbers == sorted(numbers) and len(set(numbers)) == 3


def test_nobody_waits_for_a_helper_that_is_busy() -> None:
    begun, leave = threading.Event(), threading.Event()

    def stay(bell: Counters, number: int) -> None:
        begun.set()
        assert leave.wait(10.0)

    def lead(bell: Counters, number: int) -> None:
        assert begun.wait(10.0)

    try:
        work_together(lead, stay, 3)
        for _ in range(3):
            work_together(nothing, nothing, 3)
    finally:
        leave.set()


def test_a_helper_outlives_a_job_that_is_broken() -> None:
    broken, helped = threading.Event(), threading.Event()

    def fail(bell: Counters, number: int) -> None:
        broken.set()
        raise ValueError("follower")

    with pytest.raises(ValueError, match="leader"):
        work_together(lambda bell, number: [broken.wait(10.0), int("leader")], fail, 2)
    work_together(lambda bell, number: helped.wait(10.0), lambda bell, number: helped.set(), 2)
    assert helped.is_set()
