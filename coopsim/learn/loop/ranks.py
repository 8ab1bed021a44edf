"""Processes that train together, as torchrun starts them: each has its own samples, and all have the same weights."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import torch
from torch import nn

from coopsim.learn.samples.sample_order import Position


@dataclass(frozen=True, slots=True)
class Ranks:
    """This process among those that train together.

    Attributes:
        rank: its number; number 0 writes all files.
        ranks: how many there are.
        device: its device.
    """

    rank: int
    ranks: int
    device: torch.device

    @property
    def writes(self) -> bool:
        """Whether this process writes files and shows progress."""
        return self.rank == 0

    def wrap(self, task: nn.Module) -> Any:
        """Return the task so that gradients are means over all processes."""
        if self.ranks == 1:
            return task
        from torch.nn.parallel import DistributedDataParallel

        # A batch without an object gives the box branch no gradient.
        return DistributedDataParallel(task, find_unused_parameters=True)

    def positions(self, own: Position) -> tuple[Position, ...]:
        """Return the positions of all processes; all must call it."""
        if self.ranks == 1:
            return (own,)
        mine = torch.tensor([own.block, own.turn, own.batches], device=self.device)
        found = [torch.empty_like(mine) for _ in range(self.ranks)]
        torch.distributed.all_gather(found, mine)
        return tuple(Position(*each.tolist()) for each in found)

    def any(self, flag: bool) -> bool:
        """Return whether the flag is set in any process; all must call it."""
        if self.ranks == 1:
            return flag
        flags = torch.tensor([int(flag)], device=self.device)
        torch.distributed.all_reduce(flags, op=torch.distributed.ReduceOp.MAX)
        return bool(flags.item())


@contextmanager
def joined(device: torch.device) -> Iterator[Ranks]:
    """Join the processes that torchrun started; without torchrun this process is alone."""
    count = int(os.environ.get("WORLD_SIZE", "1"))
    if count == 1:
        yield Ranks(0, 1, device)
        return
    if device.type == "cuda":
        device = torch.device("cuda", int(os.environ.get("LOCAL_RANK", "0")))
        torch.cuda.set_device(device)
    torch.distributed.init_process_group("nccl" if device.type == "cuda" else "gloo")
    try:
        yield Ranks(torch.distributed.get_rank(), count, device)
    finally:
        torch.distributed.destroy_process_group()
