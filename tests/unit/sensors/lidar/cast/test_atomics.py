"""Counters that threads share lose nothing, and waiting for one ends when it should."""

from __future__ import annotations

import threading

import numpy as np
from numba import njit

from coopsim.sensors.lidar.cast.atomics import Counters, add, raise_to, read, wait_for


@njit(nogil=True)
def count_up(counters: Counters, times: int) -> None:
    for k in range(times):
        add(counters, 1, 1)
        raise_to(counters, 2, k)


@njit(nogil=True)
def push_on(counters: Counters, mine: int, others: int, times: int) -> None:
    """In turn with another, who waits for this one's number before raising its own."""
    for k in range(1, times + 1):
        add(counters, mine, 1)
        wait_for(counters, others, k)


@njit
def now(counters: Counters, index: int) -> int:
    return read(counters, index)


def run_at_once(*threads: threading.Thread) -> None:
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(60.0)
        assert not thread.is_alive()


def test_no_addition_is_lost() -> None:
    counters = np.array([7, 0, -5, 7])
    run_at_once(*(threading.Thread(target=count_up, args=(counters, 100_000)) for _ in range(4)))
    assert counters.tolist() == [7, 400_000, 99_999, 7]


def test_nothing_is_lowered() -> None:
    counters = np.array([0, 0, 10**12])
    count_up(counters, 5)
    assert now(counters, 1) == 5 and now(counters, 2) == 10**12


def test_two_threads_meet_again_and_again() -> None:
    counters = np.zeros(2, np.int64)
    run_at_once(*(threading.Thread(target=push_on, args=(counters, k, 1 - k, 500), daemon=True) for k in range(2)))
    assert counters.tolist() == [500, 500]


def test_waiting_gives_up() -> None:
    counters = np.array([3])
    assert wait_for(counters, 0, 3, 1) and wait_for(counters, 0, 2, 1)
    assert not wait_for(counters, 0, 4, 10)
