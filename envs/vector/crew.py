"""The workers of a vector: which has which environments, and what happens when one dies."""

from __future__ import annotations

import traceback
from collections import deque
from collections.abc import Callable, Iterator, Sequence

from coopsim.envs.vector.group import Description, Failure, Order, Reply
from coopsim.envs.vector.hold import Hold
from coopsim.envs.vector.worker import Worker, WorkerDiedError
from coopsim.errors import LostEnvironmentsError

StartWorker = Callable[[Sequence[int]], Worker]
"""Makes the worker of these environments."""

DIED = "died"
"""The call of replies that stand for the death of a worker, whatever was called."""


class Crew:
    """Workers that share the environments of a vector, in blocks.

    Args:
        start: makes a worker.
        count: number of environments.
        workers: number of workers, at most `count`.

    Attributes:
        hold: in which `give` and `replies` are to be called; Ctrl-C is let through only where replies are waited for.

    Raises:
        LostEnvironmentsError: a worker died while it made its environments.
    """

    def __init__(self, start: StartWorker, count: int, workers: int) -> None:
        self.hold = Hold()
        self._start = start
        self._blocks = [range(k * count // workers, (k + 1) * count // workers) for k in range(workers)]
        self._worker_of = {index: k for k, block in enumerate(self._blocks) for index in block}
        self._workers: list[Worker | None] = []
        self._waiting: list[deque[Order]] = [deque() for _ in self._blocks]
        self._deaths: deque[tuple[int, Failure]] = deque()
        self._unsure: set[int] = set()  # workers in the middle of a message, where only another signal can interrupt
        try:
            for block in self._blocks:
                self._workers.append(start(block))
            self.description, *_ = [
                _described(worker, block)
                for worker, block in zip(self._workers, self._blocks, strict=True)
                if worker is not None
            ]
        except BaseException:
            self.end()
            raise

    @property
    def busy(self) -> bool:
        """Whether there are orders without a reply: a call was interrupted."""
        return any(self._waiting)

    def give(self, orders: Sequence[Order], *, replace: bool = True) -> None:
        """Give orders to the workers that have their environments.

        Args:
            orders: calls of environments.
            replace: start a new worker for one that died; otherwise its orders are dropped.
        """
        self._bury_unsure()
        shares: list[list[Order]] = [[] for _ in self._blocks]
        for order in orders:
            shares[self._worker_of[order.env]].append(order)
        for k, share in enumerate(shares):
            if not share:
                continue
            worker = self._living(k) if replace else self._workers[k]
            if worker is not None:
                self._unsure.add(k)
                self._waiting[k].extend(share)
                worker.give(share)
                self._unsure.discard(k)

    def replies(self) -> Iterator[tuple[int, str, Reply]]:
        """Yield index, call and reply for all orders that were given, as they come, from all workers in turns.

        A worker that died yields a `Failure` for each of its environments, with or without an order, and also for those
        that have replied: they are lost all the same.
        """
        self._bury_unsure()
        while self._deaths or any(self._waiting):
            while self._deaths:
                index, failure = self._deaths[0]
                yield index, DIED, failure
                self._deaths.popleft()
            for k, waiting in enumerate(self._waiting):
                worker = self._workers[k]
                if not waiting or worker is None:
                    continue
                order = waiting[0]
                try:
                    self.hold.wait(worker.wait)
                    self._unsure.add(k)
                    reply = worker.take()
                except WorkerDiedError as death:
                    self._bury(k, f"the worker died ({death}) in a {order.call}\n")
                    continue
                waiting.popleft()
                yield order.env, order.call, reply
                self._unsure.discard(k)  # the caller has noted it

    def end(self) -> None:
        """End all workers, whatever they do; may be called again."""
        for worker in self._workers:
            if worker is not None:
                worker.end()
        self._workers = [None] * len(self._blocks)

    def _living(self, k: int) -> Worker | None:
        """Return worker `k`, a new one if it died; None if there can be no new one."""
        worker = self._workers[k]
        if worker is not None:
            return worker
        fresh = self._start(self._blocks[k])
        try:
            self.hold.wait(fresh.describe)
        except Exception as error:  # of a user's environment
            fresh.end()
            self._bury(k, "".join(traceback.format_exception(error)))
            return None
        except BaseException:
            fresh.end()
            raise
        self._workers[k] = fresh
        return fresh

    def _bury_unsure(self) -> None:
        for k in sorted(self._unsure):
            self._bury(k, "its worker was interrupted in the middle of a message\n")

    def _bury(self, k: int, report: str) -> None:
        self._unsure.discard(k)
        worker, self._workers[k] = self._workers[k], None
        if worker is not None:
            worker.end()
        self._waiting[k].clear()
        self._deaths.extend((index, Failure(report)) for index in self._blocks[k])


def _described(worker: Worker, block: Sequence[int]) -> Description:
    try:
        return worker.describe()
    except WorkerDiedError as death:
        report = f"the worker died ({death}) while it made its environments\n"
        raise LostEnvironmentsError(dict.fromkeys(block, report)) from None
