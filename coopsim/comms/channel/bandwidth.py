"""Bandwidth: airtime of messages, and the queue in front of a medium."""

from __future__ import annotations

import heapq
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Generic, Literal, TypeVar

import numpy as np

from coopsim.support.checks import require_choice, require_number, require_positive
from coopsim.types import NS_PER_S, seconds_to_ns

T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class Bandwidth:
    """Bandwidth of the channel.

    Attributes:
        rate_bit_s: bits per second, above the envelope: a message of B bytes takes `8 B / rate_bit_s`.
        medium: "shared" (all agents send one after another, and a broadcast is sent once), or "link" (each sender to
            each receiver has the rate for itself).
        order: message sent next: "in_order" (the one that has waited longest), or "newest_first" (the newest of the
            sender whose turn was longest ago, so that no sender starves).
        max_wait_s: a message that has waited longer at its turn is dropped and counted as lost; inf: no limit.
    """

    rate_bit_s: float
    medium: Literal["shared", "link"] = "shared"
    order: Literal["in_order", "newest_first"] = "in_order"
    max_wait_s: float = np.inf

    def __post_init__(self) -> None:
        require_positive(rate_bit_s=self.rate_bit_s)
        # A rate below a bit per second is a slip, and its airtimes might not fit the clock.
        require_number(">= 1", lambda rate: rate >= 1, rate_bit_s=self.rate_bit_s)
        require_choice("medium", self.medium, ("shared", "link"))
        require_choice("order", self.order, ("in_order", "newest_first"))
        require_number(">= 0 (inf: no limit)", lambda wait: wait >= 0, max_wait_s=self.max_wait_s)

    def airtime_ns(self, size_bytes: int) -> int:
        """Return the time for which a message of that size occupies the medium, ns."""
        return round(8 * size_bytes / self.rate_bit_s * NS_PER_S)


@dataclass(frozen=True, slots=True, order=True)
class _Waiting(Generic[T]):
    since_ns: int
    number: int
    sender: str = field(compare=False)
    airtime_ns: int = field(compare=False)
    content: T = field(compare=False)


@dataclass(frozen=True, slots=True, eq=False)
class Departure(Generic[T]):
    """Content that left the queue of a medium, and the time (ns) at which its last bit was on the air; None: it was
    dropped.
    """

    content: T
    sent_ns: int | None


class Medium(Generic[T]):
    """Server with a queue; a message that is being sent is never interrupted.

    Contents may be put in in any order of `since_ns`, but none before the latest `before_ns` given to `departures`.
    """

    def __init__(self, bandwidth: Bandwidth) -> None:
        self._bandwidth = bandwidth
        self._max_wait_ns = seconds_to_ns(min(bandwidth.max_wait_s, 1e9))
        self._coming: list[_Waiting[T]] = []
        self._queues: dict[str, deque[_Waiting[T]]] = {}  # by sender, oldest first; never empty
        self._turns: dict[str, int] = {}  # number of each sender's latest turn
        self._free_ns = 0
        self._number = 0

    def put(self, content: T, size_bytes: int, since_ns: int, sender: str = "") -> None:
        """Queue content of `size_bytes` of a sender, ready to be sent from `since_ns` on."""
        self._number += 1
        waiting = _Waiting(since_ns, self._number, sender, self._bandwidth.airtime_ns(size_bytes), content)
        heapq.heappush(self._coming, waiting)

    def departures(self, before_ns: int) -> Iterator[Departure[T]]:
        """Take out all contents whose turn comes before that moment, in order of turns."""
        while self._queues or self._coming:
            oldest = min(queue[0] for queue in self._queues.values()) if self._queues else self._coming[0]
            start_ns = max(self._free_ns, oldest.since_ns)
            if start_ns >= before_ns:
                return
            while self._coming and self._coming[0].since_ns <= start_ns:
                waiting = heapq.heappop(self._coming)
                self._queues.setdefault(waiting.sender, deque()).append(waiting)
            if start_ns - oldest.since_ns > self._max_wait_ns:
                yield Departure(self._take(oldest.sender, 0).content, None)
                continue
            waiting = self._take(*self._next())
            self._turns[waiting.sender] = max(self._turns.values(), default=0) + 1
            self._free_ns = start_ns + waiting.airtime_ns
            yield Departure(waiting.content, self._free_ns)

    @property
    def waiting(self) -> Iterator[T]:
        """Contents that have not been sent yet."""
        return (waiting.content for queue in (*self._queues.values(), self._coming) for waiting in queue)

    def _next(self) -> tuple[str, int]:
        """Return the sender whose turn it is, and the end of its queue to take from: 0 oldest, -1 newest."""
        turns = {sender: self._turns.get(sender, 0) for sender in self._queues}
        if self._bandwidth.order == "newest_first":
            return min(turns, key=lambda sender: (turns[sender], self._queues[sender][-1].number)), -1
        return min(turns, key=lambda sender: (self._queues[sender][0].since_ns, turns[sender])), 0

    def _take(self, sender: str, end: int) -> _Waiting[T]:
        queue = self._queues[sender]
        taken = queue.popleft() if end == 0 else queue.pop()
        if not queue:
            del self._queues[sender]
        return taken
