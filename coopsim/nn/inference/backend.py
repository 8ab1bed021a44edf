"""Networks at work: without gradients, on one device, in the numbers of `coopsim.support.precision`.

On a processor agents are computed side by side, each on one thread of torch. Torch's own threads wait for each other
after every operation, which takes ten times as long where cores are busy, and add in another order. On a GPU the agents
of a frame are one batch.
"""

from __future__ import annotations

import copy
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache, partial
from typing import Any, TypeVar

import torch
from torch import nn

from coopsim.nn.inference.devices import find_device, numbers_on, to_device
from coopsim.nn.inference.memory import keep_freed_memory
from coopsim.support.threads import run_all

T = TypeVar("T")
M = TypeVar("M", bound=nn.Module)


@dataclass(frozen=True)
class Backend:
    """Where networks compute, and in which numbers they multiply.

    Attributes:
        device: of weights and maps.
        numbers: float32 or bfloat16; geometry is float32 always.
        threads: on a processor, agents are computed side by side on so many threads of Python's.
    """

    device: torch.device = torch.device("cpu")
    numbers: torch.dtype = torch.float32
    threads: int = 1

    @property
    def batched(self) -> bool:
        """Whether all agents go through a network in one batch: what a GPU needs. A processor is no quicker for it."""
        return self.device.type != "cpu"

    @contextmanager
    def inference(self) -> Iterator[None]:
        """Compute a network's own pass within without gradients; afterwards torch has as many threads as before.

        Products of matrices, which are all that autocast shortens, are a network's: geometry belongs outside.
        """
        short = self.numbers is torch.bfloat16
        with _one_thread(), torch.inference_mode(), torch.autocast(self.device.type, torch.bfloat16, enabled=short):
            yield

    def side_by_side(self, tasks: Sequence[Callable[[], T]]) -> list[T]:
        """Return the results of tasks that use networks, computed on `threads`; on a GPU one after another.

        Torch's own threads are one until the last task has ended. Parts of their number belong to the whole process: a
        task that ends first would give it back while others are still computing. Gradients and autocast belong to each
        thread: a task has neither, whichever takes it.
        """
        with _one_thread():
            return run_all([partial(self._apart, task) for task in tasks], 1 if self.batched else self.threads)

    def map(self, make: Callable[..., Sequence[T]], *of_agents: Sequence[Any]) -> list[T]:
        """Return what `make` returns for agents: called once with all of them if batched, else side by side for each.

        Args:
            make: from sequences, one for each of `of_agents` and as long, to as many results.
            of_agents: sequences with an item for each agent.
        """
        if self.batched:
            return list(make(*of_agents)) if of_agents[0] else []
        tasks = [partial(make, *([each] for each in items)) for items in zip(*of_agents, strict=True)]
        return [made for (made,) in self.side_by_side(tasks)]

    def place(self, module: M) -> M:
        """Return a network on the device: itself, or a copy where it was elsewhere, because weights are shared."""
        return module if self.device.type == "cpu" else copy.deepcopy(module).to(self.device)

    def put(self, batch: T) -> T:
        """Return tensors, or what holds tensors, on the device."""
        moved: T = to_device(batch, self.device)
        return moved

    def _apart(self, task: Callable[[], T]) -> T:
        with torch.inference_mode(), torch.autocast(self.device.type, enabled=False):
            return task()


PROCESSOR = Backend()
"""The processor, one agent after another, in float32."""


def find_backend(device: str = "cpu", threads: int = 1) -> Backend:
    """Return the backend of a device by name, in the arithmetic that is set now.

    Raises:
        InvalidValueError: there is no such device.
        UnknownNameError: `COOPSIM_PRECISION` has a value that is not accepted.
    """
    found = find_device(device)
    return Backend(found, numbers_on(found), threads)


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
