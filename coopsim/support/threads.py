"""Work shared by threads, for what holds no lock while it runs: compiled kernels and numpy's random numbers.

Threads of our own, not numba's: its layers end a process that forks after use, or that calls from two threads.
"""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor, wait
from contextlib import suppress
from functools import cache, partial
from itertools import count
from queue import SimpleQueue
from threading import Thread
from typing import TypeVar

import numpy as np

from coopsim.sensors.lidar.cast.atomics import Counters

T = TypeVar("T")


def run_all(acts: Sequence[Callable[[], T]], threads: int, crew: str) -> list[T]:
    """What `acts` return, in their order; whoever is free takes the next.

    Args:
        acts: that do not depend on each other.
        threads: that share them, the calling one included.
        crew: name of the threads. An act may share work of its own, but not with the crew that it is done by.
    """
    helpers = min(threads, len(acts)) - 1
    if helpers < 1:
        return [act() for act in acts]
    left, done = deque(enumerate(acts)), dict[int, T]()

    def work() -> None:
        while left:
            try:
                k, act = left.popleft()
            except IndexError:  # another took the last one meanwhile
                return
            done[k] = act()

    shares = [_pool(crew, threads - 1).submit(work) for _ in range(helpers)]
    try:
        work()
    finally:
        begun = [share for share in shares if not share.cancel()]  # who has not even woken up is not waited for
        wait(begun)
    for share in begun:
        share.result()
    return [done[k] for k in range(len(acts))]


def work_together(
    lead: Callable[[Counters, int], object], follow: Callable[[Counters, int], object], threads: int
) -> None:
    """Do a job that takes hardly longer than it takes to wake a thread.

    Both acts are given a bell and the job's number. Each of the helpers may come late, or not at all: others may have
    given them work.

    Args:
        lead: raises `bell[0]` to the number, does what no helper does, and returns when all is done. Called here.
        follow: helps, and holds no lock until `bell[0]` is above the number, or for a short time: an awake helper is
            called by the bell, an idle one takes longer to wake.
        threads: that share the job, the calling one included.
    """
    crew = _crew(threads - 1)
    number = next(crew.numbers)
    for queue in crew.queues:
        if queue.empty():  # who has yet to take the last job up is too busy for another
            queue.put(partial(follow, crew.bell, number))
    lead(crew.bell, number)


class _Crew:
    """Helpers, each with a queue of its own; they end with the process."""

    def __init__(self, helpers: int) -> None:
        self.bell, self.numbers = np.zeros(1, np.int64), count(1)
        self.queues: list[SimpleQueue[Callable[[], object]]] = [SimpleQueue() for _ in range(helpers)]
        for queue in self.queues:
            Thread(target=_serve, args=(queue,), name="coopsim-crew", daemon=True).start()


def _serve(queue: SimpleQueue[Callable[[], object]]) -> None:
    while True:
        with suppress(Exception):  # what is wrong with a job, who leads it is told
            queue.get()()


@cache
def _crew(helpers: int) -> _Crew:
    return _Crew(helpers)


@cache
def _pool(crew: str, threads: int) -> ThreadPoolExecutor:
    return ThreadPoolExecutor(threads, thread_name_prefix=f"coopsim-{crew}")


for _threads in (_pool, _crew):
    os.register_at_fork(after_in_child=_threads.cache_clear)  # a child has none of its parent's threads
