"""Pools of workers: environments in processes of their own, or in the calling one."""

from __future__ import annotations

import os
import pickle
import queue
import threading
import traceback
from abc import ABC, abstractmethod
from collections.abc import Sequence

from coopsim.envs.vector.environments import Description, EnvironmentGroup, Failure, Order, Reply
from coopsim.envs.vector.worker import Worker, WorkerDiedError


class Round:
    """Orders given together, at most one for each environment, and their replies so far.

    Attributes:
        orders: calls, by environment.
        replies: replies, by environment. When a worker dies, all of its environments have a `Failure`, with or without
            an order, and also those that have replied: they are lost all the same.
        dead: environments whose worker died.
        done: set when all replies are there.
        replace: start a new worker for one that died; otherwise its orders are dropped.
        shares: pickled orders of each worker, and their environments.
    """

    def __init__(self, orders: Sequence[Order], *, replace: bool) -> None:
        self.orders, self.replace = {order.env: order for order in orders}, replace
        self.shares: dict[int, tuple[bytes, list[int]]] = {}
        self.replies: dict[int, Reply] = {}
        self.dead: set[int] = set()
        self.done = threading.Event()


class Pool(ABC):
    """Environments that obey orders, one round after another.

    A round that Ctrl-C interrupts goes on, or is taken up: `finish` returns it until the caller says `forget`.
    """

    description: Description
    _round: Round | None = None

    @property
    def busy(self) -> bool:
        """Tell whether a round was interrupted."""
        return self._round is not None

    def run(self, orders: Sequence[Order], *, replace: bool = True) -> Round:
        """Run a round and return it; see `Round`. The one before must have been forgotten."""
        round_ = Round(orders, replace=replace)
        self._prepare(round_)
        self._round = round_
        self._carry_out(round_)
        return round_

    def finish(self) -> Round | None:
        """Wait for the round that was interrupted, and return it; None if there is none."""
        if self._round is not None:
            self._carry_out(self._round)
        return self._round

    def forget(self) -> None:
        """Note that the caller has taken the replies of the round."""
        self._round = None

    @abstractmethod
    def end(self) -> None:
        """End all workers, whatever they do; may be called again."""

    def _prepare(self, round_: Round) -> None:
        """Do what may refuse the orders, before anything is noted."""

    @abstractmethod
    def _carry_out(self, round_: Round) -> None:
        """Have all orders obeyed; called again after an interrupt."""


class CallingProcess(Pool):
    """Environments in the calling process. One that Ctrl-C interrupts is lost, as nobody knows how far it came."""

    def __init__(self, recipe: bytes, count: int) -> None:
        self._group = EnvironmentGroup(recipe, range(count))
        self.description = self._group.describe()

    def end(self) -> None:
        """Leave the environments to the garbage collector."""

    def _carry_out(self, round_: Round) -> None:
        for index, order in round_.orders.items():
            if index not in round_.replies:
                round_.replies[index] = Failure(f"Ctrl-C interrupted its {order.call}\n")  # if nothing else comes
                round_.replies[index] = self._group.do(order)


class WorkerPool(Pool):
    """Processes that share the environments, in blocks.

    A thread talks to them, as signal handlers run in the main thread alone: so Ctrl-C interrupts a wait, and never a
    message.

    Raises:
        LostEnvironmentsError: a worker died while it made its environments.
        Exception: an error in making an environment.
    """

    def __init__(self, recipe: bytes, count: int, workers: int) -> None:
        self._recipe, self._owner = recipe, os.getpid()
        self._blocks = [range(k * count // workers, (k + 1) * count // workers) for k in range(workers)]
        self._worker_of = {index: k for k, block in enumerate(self._blocks) for index in block}
        self._workers: list[Worker | None] = []
        self._rounds: queue.SimpleQueue[Round | None] = queue.SimpleQueue()
        threading.Thread(target=self._talk, daemon=True).start()
        try:
            for block in self._blocks:
                self._workers.append(Worker(recipe, block))
            self.description, *_ = [worker.describe() for worker in self._workers if worker is not None]
        except BaseException:
            self.end()
            raise

    def end(self) -> None:
        if os.getpid() == self._owner:  # else this is a fork of the process whose workers they are
            for worker in self._workers:
                if worker is not None:
                    worker.kill()
            self._rounds.put(None)

    def _prepare(self, round_: Round) -> None:
        for k in sorted({self._worker_of[index] for index in round_.orders}):
            share = [order for index, order in round_.orders.items() if self._worker_of[index] == k]
            round_.shares[k] = pickle.dumps(share, protocol=5), [order.env for order in share]

    def _carry_out(self, round_: Round) -> None:
        self._rounds.put(round_)  # a second time after an interrupt, which the thread passes over
        round_.done.wait()

    def _talk(self) -> None:
        while (round_ := self._rounds.get()) is not None:
            if not round_.done.is_set():
                try:
                    self._converse(round_)
                finally:
                    round_.done.set()
        for worker in self._workers:
            if worker is not None:
                worker.close()

    def _converse(self, round_: Round) -> None:
        """Give each worker its share, then take the replies of each."""
        waiting: dict[int, list[int]] = {}
        for k, (share, indices) in round_.shares.items():
            worker = self._workers[k] or (self._replaced(k, round_) if round_.replace else None)
            if worker is not None:
                worker.send(share)
                waiting[k] = indices
        for k, indices in waiting.items():
            worker = self._workers[k]
            assert worker is not None
            try:
                round_.replies.update(zip(indices, worker.receive(), strict=True))
            except WorkerDiedError as death:
                self._bury(k, f"the worker died ({death}) in a {round_.orders[indices[0]].call}\n", round_)
            except Exception:  # a content that cannot be unpickled here
                self._bury(k, traceback.format_exc(), round_)

    def _replaced(self, k: int, round_: Round) -> Worker | None:
        """Return a new worker for one that died; None if its environments cannot be made again."""
        self._workers[k] = worker = Worker(self._recipe, self._blocks[k])
        try:
            worker.describe()
        except Exception as error:  # of a user's environment
            self._bury(k, "".join(traceback.format_exception(error)), round_)
            return None
        return worker

    def _bury(self, k: int, report: str, round_: Round) -> None:
        worker, self._workers[k] = self._workers[k], None
        if worker is not None:
            worker.kill()
            worker.close()
        round_.dead.update(self._blocks[k])
        round_.replies.update((index, Failure(report)) for index in self._blocks[k])
