"""Networks at work: without gradients, on one thread of torch, in the numbers of `coopsim.support.precision`.

Torch's own threads wait for each other after every operation, which takes ten times as long where cores are busy, and
add in another order. Agents are computed side by side instead (`coopsim.support.threads`).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import cache, partial
from typing import TypeVar

import torch

from coopsim.nn.inference.memory import keep_freed_memory
from coopsim.support.precision import arithmetic
from coopsim.support.threads import run_all

T = TypeVar("T")


@contextmanager
def inference() -> Iterator[None]:
    """Compute a network's own pass within without gradients, on one thread; afterwards torch has as many as before.

    Products of matrices, which are all that autocast shortens, are a network's: geometry belongs outside.
    """
    enabled = arithmetic() == "bfloat16"
    with _one_thread(), torch.inference_mode(), torch.autocast("cpu", torch.bfloat16, enabled=enabled):
        yield


def side_by_side(tasks: Sequence[Callable[[], T]], threads: int) -> list[T]:
    """Return the results of tasks that use networks, computed on so many threads of Python's.

    Torch's own threads are one until the last task has ended. Parts of their number belong to the whole process: a task
    that ends first would give it back while others are still computing. Gradients and autocast belong to each thread:
    a task has neither, whichever takes it.
    """
    with _one_thread():
        return run_all([partial(_apart, task) for task in tasks], threads)


def _apart(task: Callable[[], T]) -> T:
    with torch.inference_mode(), torch.autocast("cpu", enabled=False):
        return task()


@contextmanager
def _one_thread() -> Iterator[None]:
    """Give torch one thread within. Freed memory stays with the process from the first use on, see `memory`."""
    _settle()
    before = torch.get_num_threads()
    if before != 1:
        torch.set_num_threads(1)
    try:
        yield
    finally:
        if before != 1:
            torch.set_num_threads(before)


@cache
def _settle() -> None:
    """Do once what serves all networks of this process."""
    keep_freed_memory()
