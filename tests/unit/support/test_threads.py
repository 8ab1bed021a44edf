"""Sharing work among threads changes its time and nothing else."""

from __future__ import annotations

import os
import threading
from functools import partial

import pytest

from coopsim.support.threads import run_all


@pytest.mark.parametrize("threads", [1, 2, 3, 50])
@pytest.mark.parametrize("count", [0, 1, 2, 7])
def test_results_are_in_order_and_nothing_is_done_twice(threads: int, count: int) -> None:
    done: list[int] = []

    def act(k: int) -> int:
        done.append(k)
        return k * k

    assert run_all([partial(act, k) for k in range(count)], threads) == [k * k for k in range(count)]
    assert sorted(done) == list(range(count))


def test_two_threads_work_at_once() -> None:
    meeting = threading.Barrier(2, timeout=10.0)  # breaks, were they to come one after the other
    assert set(run_all([meeting.wait] * 2, 2)) == {0, 1}


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
        run_all([partial(act, k) for k in range(3)], threads)
    assert not running


def test_a_task_may_share_work_of_its_own() -> None:
    def act(k: int) -> int:
        return sum(run_all([partial(int, k)] * 5, 2))

    assert run_all([partial(act, k) for k in range(6)], 2) == [5 * k for k in range(6)]


@pytest.mark.skipif(not hasattr(os, "fork"), reason="needs fork")
@pytest.mark.filterwarnings("ignore:.*fork.*:DeprecationWarning")
def test_a_forked_process_makes_threads_of_its_own() -> None:
    run_all([partial(int, k) for k in range(4)], 2)
    child = os.fork()
    if not child:
        meeting = threading.Barrier(2, timeout=10.0)
        try:
            done = set(run_all([meeting.wait] * 2, 2))
        except threading.BrokenBarrierError:
            done = set()
        os._exit(0 if done == {0, 1} else 1)
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 0
