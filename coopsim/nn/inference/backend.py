"""Networks at work: without gradients, on one device, in the numbers of `coopsim.support.precision`.

On a processor agents are computed side by side, each on one thread of torch. Torch's own threads wait for each other
after every operation, which takes ten times as long where cores are busy, and add in another order. On a GPU the agents
of a frame are one batch.
"""

from __future__ import annotations

import copy
import dataclasses
import re
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache, partial
from typing import Any, TypeVar

import torch
from torch import Tensor, nn

from coopsim.errors import InvalidValueError
from coopsim.support.memory import keep_freed_memory
from coopsim.support.precision import multiplies_bfloat16
from coopsim.support.precision import precision as setting
from coopsim.support.threads import run_all

T = TypeVar("T")
M = TypeVar("M", bound=nn.Module)


@dataclass(frozen=True)
class Backend:
    """Device on which networks compute, and the numbers in which they multiply.

    Attributes:
        device: device of weights and maps.
        numbers: float32 or bfloat16; geometry is float32 always.
        threads: number of Python threads that compute agents side by side on a processor.
    """

    device: torch.device = torch.device("cpu")
    numbers: torch.dtype = torch.float32
    threads: int = 1

    @property
    def batched(self) -> bool:
        """True if all agents go through a network in one batch: a GPU needs it, a processor is no quicker for it."""
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
        """Return the results of `make` for agents: called once with all of them if batched, else side by side for each.

        Args:
            make: a function of sequences, one for each of `of_agents` and as long, to as many results.
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
    """Give torch one thread within. Freed memory stays with the process from the first use on."""
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


def find_device(name: str = "cpu") -> torch.device:
    """Return a device by name: "cpu", "cuda", "cuda:1", or "auto" for a GPU if there is one, else the processor.

    Raises:
        InvalidValueError: there is no such device; the message names those that are there.
    """
    gpus = torch.cuda.device_count() if torch.cuda.is_available() else 0
    if name == "auto":
        name = "cuda" if gpus else "cpu"
    there = ["cpu", *["cuda"] * (gpus > 0), *(f"cuda:{number}" for number in range(gpus))]
    if name not in there:
        why = "" if gpus or not re.fullmatch(r"cuda(:\d+)?", str(name)) else ": torch finds no GPU"
        raise InvalidValueError(f"device must be auto or one that is here ({', '.join(there)}), got {name!r}{why}")
    return torch.device(name)


def numbers_on(device: torch.device, precision: str = "auto") -> torch.dtype:
    """Return the numbers in which networks multiply on a device; "auto" leaves that to the process' setting.

    With that "auto", too, they are bfloat16 where the device multiplies it itself.
    """
    chosen = setting() if precision == "auto" else precision
    if chosen == "auto":
        cuda = device.type == "cuda"
        has = torch.cuda.is_bf16_supported(including_emulation=False) if cuda else multiplies_bfloat16()
        chosen = "bfloat16" if has else "float32"
    return torch.bfloat16 if chosen == "bfloat16" else torch.float32


def to_device(batch: Any, device: torch.device) -> Any:
    """Return a batch with all its tensors on a device: tensors in dataclasses, lists, tuples and mappings."""
    if device.type == "cpu":
        return batch
    if isinstance(batch, Tensor):
        return batch.to(device, non_blocking=True)
    if dataclasses.is_dataclass(batch) and not isinstance(batch, type):
        moved = {each.name: to_device(getattr(batch, each.name), device) for each in dataclasses.fields(batch)}
        return dataclasses.replace(batch, **moved)
    if isinstance(batch, (list, tuple)):
        return type(batch)(to_device(each, device) for each in batch)
    if isinstance(batch, dict):
        return {key: to_device(value, device) for key, value in batch.items()}
    return batch
