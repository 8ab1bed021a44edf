"""Work shared by threads, for what holds no lock while it runs: compiled kernels and numpy's random numbers.

Threads of our own, not numba's: its layers end a process that forks after use, or that calls from two threads.
"""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor, wait
from functools import cache
from typing import TypeVar

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


@cache
def _pool(crew: str, threads: int) -> ThreadPoolExecutor:
    return ThreadPoolExecutor(threads, thread_name_prefix=f"coopsim-{crew}")


os.register_at_fork(after_in_child=_pool.cache_clear)  # a child has none of its parent's threads
