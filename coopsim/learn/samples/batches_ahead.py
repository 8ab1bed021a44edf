"""Batches of a training, made ahead by other processes: clips, the drawing of samples, and their joining."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Protocol

from coopsim.learn.clips.ahead import Closing, Failure, Workers
from coopsim.learn.samples.sample_order import Position, SampleOrder, joined_blocks
from coopsim.support.checks import require_count

_ALONE = 4
"""Finished batches that a single worker keeps ready. Several take turns by blocks, so each keeps a whole one."""


class OrderMaker(Protocol):
    """A picklable maker of the order whose batches workers make."""

    def order(self) -> SampleOrder:
        """Return the order."""


@dataclass(frozen=True)
class BlockMaker:
    """A maker of the batches of blocks, with a `Position` alone after each block.

    Attributes:
        orders: makes the order.
        start: position of the first batch.
    """

    orders: OrderMaker
    start: Position

    def make(self, first: int, stride: int) -> Iterator[tuple[Position, Any] | Position]:
        order = self.orders.order()
        while True:
            yield from order.batches_of_block(self.start if first == self.start.block else Position(first))
            yield Position(first + 1)
            first += stride


def _ends_block(made: Any) -> bool:
    return isinstance(made, Position)


class BatchesAhead(Closing):
    """The batches of an order, made ahead by worker processes: the same for any number of them.

    Use it in a `with` statement, to end the workers.

    Args:
        orders: makes the order, in each worker.
        clips: number of clips of a block.
        workers: number of processes.
    """

    def __init__(self, orders: OrderMaker, clips: int, workers: int = 1) -> None:
        require_count(1, workers=workers)
        self._orders, self._clips, self._count = orders, clips, workers
        self._workers: Workers | None = None

    def batches(self, start: Position) -> Iterator[tuple[Position, Any]]:
        """Yield batches without end, each with the position after it.

        Raises:
            TrainingError: many blocks in a row have no sample.
            CoopsimError: a worker raised it, or another error, whose traceback it then has; or a worker was killed.
            InvalidValueError: the maker of the order cannot be pickled.
        """
        self.close()
        ahead = _ALONE if self._count == 1 else 0
        self._workers = Workers(BlockMaker(self._orders, start), self._count, ahead, _ends_block)
        self._workers.start(start.block)
        yield from joined_blocks(self._batches_of_block, start, self._clips)

    def _batches_of_block(self, start: Position) -> Iterator[tuple[Position, Any]]:
        assert self._workers is not None
        while True:
            made = self._workers.next_of(start.block)
            if isinstance(made, Failure):
                raise made.error(f"a batch of block {start.block}")
            if isinstance(made, Position):
                return
            yield made

    def close(self) -> None:
        """End the workers; may be called again."""
        if self._workers is not None:
            self._workers.close()
