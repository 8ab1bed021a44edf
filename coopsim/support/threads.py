"""Work shared by threads, for functions that release the interpreter's lock: compiled kernels and numpy's draws.

The threads are Python's, not numba's: numba's layers end a process that forks after use, or that calls from two
threads.
"""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor, wait
from functools import cache
from typing import TypeVar

T = TypeVar("T")

_most = 2**31


def limit_threads(most: int) -> None:
    """Let no later `run_all` of this process use more than `most` threads: for one of as many workers as cores."""
    global _most
    _most = most


def run_all(tasks: Sequence[Callable[[], T]], threads: int) -> list[T]:
    """Call independent tasks and return their results in order; each free thread takes the next task.

    A task may itself call `run_all`. The calling thread is one of `threads`. The exception of a task that failed is
    raised once no other is running.
    """
    helpers = min(threads, len(tasks), _most) - 1
    if helpers < 1:
        return [task() for task in tasks]
    waiting, results = deque(enumerate(tasks)), dict[int, T]()

    def work() -> None:
        while waiting:
            try:
                k, task = waiting.popleft()
            except IndexError:  # another thread took the last one meanwhile
                return
            results[k] = task()

    shares = [_pool(threads - 1).submit(work) for _ in range(helpers)]
    try:
        work()
    finally:
        begun = [share for share in shares if not share.cancel()]  # a helper that has not started is not waited for
        wait(begun)
    for share in begun:
        share.result()
    return [results[k] for k in range(len(tasks))]


@cache
def _pool(threads: int) -> ThreadPoolExecutor:
    return ThreadPoolExecutor(threads, thread_name_prefix="coopsim")


if hasattr(os, "register_at_fork"):  # POSIX; elsewhere processes do not fork
    os.register_at_fork(after_in_child=_pool.cache_clear)  # a child has none of its parent's threads
