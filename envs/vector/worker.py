"""Workers: what has a group of environments, wherever it runs."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Sequence
from typing import Any

from coopsim.envs.vector.group import Description, EnvironmentGroup, Failure, Order, Reply


class WorkerDiedError(Exception):
    """A worker is gone, and its environments with it; the message says how it ended."""


class Worker(ABC):
    """A group of environments that take orders. Orders are given together; replies come one by one, in order."""

    @abstractmethod
    def describe(self) -> Description:
        """Wait until the environments are made, and describe them; to be called first.

        Raises:
            WorkerDiedError: it is gone.
            Exception: what making them raised.
        """

    @abstractmethod
    def give(self, orders: Sequence[Order]) -> None:
        """Give orders; all earlier ones have been replied to. A worker that is gone says so in `take`."""

    @abstractmethod
    def wait(self) -> None:
        """Wait for the reply to the next order. If Ctrl-C interrupts it, it can be called again.

        Raises:
            WorkerDiedError: it is gone.
        """

    @abstractmethod
    def take(self) -> Reply:
        """Return the reply that `wait` has waited for; must not be interrupted.

        Raises:
            WorkerDiedError: it is gone.
        """

    @abstractmethod
    def end(self) -> None:
        """End at once; may be called again."""


class RemoteWorker(Worker):
    """A worker elsewhere: what it sends comes as it was sent."""

    def describe(self) -> Description:
        made: Description | Failure = self._receive()
        if isinstance(made, Failure):
            raise made.exception
        return made

    @abstractmethod
    def _receive(self) -> Any:
        """Wait for what the worker sends next, and return it.

        Raises:
            WorkerDiedError: it is gone.
        """


class InProcess(Worker):
    """Environments in the calling process. An order is obeyed when its reply is waited for.

    An environment that Ctrl-C interrupts is lost, as nobody knows how far it came.
    """

    def __init__(self, recipe: bytes, indices: Sequence[int]) -> None:
        self._group = EnvironmentGroup(recipe, indices)
        self._orders: deque[Order] = deque()
        self._reply: Reply | None = None

    def describe(self) -> Description:
        return self._group.describe()

    def give(self, orders: Sequence[Order]) -> None:
        self._orders.extend(orders)

    def wait(self) -> None:
        if self._reply is None:
            order = self._orders[0]
            self._reply = Failure(f"Ctrl-C interrupted its {order.call}\n")  # the reply, if nothing else comes of it
            self._reply = self._group.do(order)

    def take(self) -> Reply:
        reply, self._reply = self._reply, None
        assert reply is not None
        self._orders.popleft()
        return reply

    def end(self) -> None:
        self._reply = None
        self._orders.clear()
