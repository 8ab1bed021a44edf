"""Networks at work: without gradients, on one thread of torch, in bfloat16 where the processor multiplies it.

Torch's own threads wait for each other after every operation, which takes ten times as long where cores are busy, and
add in another order. Agents are computed side by side instead (`coopsim.support.threads`).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import cache
from typing import TypeVar

import torch

from coopsim.nn.inference.memory import keep_freed_memory
from coopsim.support.precision import arithmetic
from coopsim.support.threads import run_all

T = TypeVar("T")


@contextmanager
def inference() -> Iterator[None]:
    """Compute what is within without gradients, on one thread; afterwards torch has as many as before.

    Freed memory stays with the process from the first use on, see `coopsim.nn.inference.memory`.
    """
    _settle()
    before = torch.get_num_threads()
    if before != 1:
        torch.set_num_threads(1)
    try:
        with torch.inference_mode(), torch.autocast("cpu", torch.bfloat16, enabled=arithmetic() == "bfloat16"):
            yield
    finally:
        if before != 1:
            torch.set_num_threads(before)


def side_by_side(tasks: Sequence[Callable[[], T]], threads: int) -> list[T]:
    """Return the results of tasks that use networks, computed on so many threads of Python's.

    Torch's own threads are one until the last task has ended. Parts of their number belong to the whole process: a task
    that ends first would give it back while others are still computing.
    """
    with inference():
        return run_all(tasks, threads)


@cache
def _settle() -> None:
    """Do once what serves all networks of this process."""
    keep_freed_memory()
