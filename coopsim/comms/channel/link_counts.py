"""Counts of messages by link, as matrices of senders and receivers."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from coopsim.comms.radio.air import LinkName
from coopsim.types import Ints


@dataclass(frozen=True, slots=True)
class ChannelCounts:
    """Numbers of messages since the episode's start; `sent == delivered + lost + pending`.

    Attributes:
        sent: messages, each counted once per receiver.
        delivered: messages that arrived.
        lost: messages that never arrive.
        pending: messages that wait for the medium or are on their way.
        corrupted: lost messages that arrived with a wrong checksum.
        stale: lost messages that waited too long for the medium.
        duplicates: second copies that arrived; they are in no other count.
        rejected: delivered messages that a policy could not read (`Policy.rejected`). The channel does not read
            payloads: it is 0 in the channel's counts.
    """

    sent: int = 0
    delivered: int = 0
    lost: int = 0
    pending: int = 0
    corrupted: int = 0
    stale: int = 0
    duplicates: int = 0
    rejected: int = 0


_COUNTED = ("sent", "delivered", "lost", "corrupted", "stale", "duplicates")


class LinkCounts:
    """Counts of all links between named agents; all kinds but `pending`, which the channel knows at any moment."""

    def __init__(self) -> None:
        self._number: dict[str, int] = {}
        self._counts = {kind: np.zeros((0, 0), np.int64) for kind in _COUNTED}

    def numbers(self, agents: Sequence[str]) -> Ints:
        """Return the numbers (N,) by which the counts know these agents; new ones are added."""
        for agent in agents:
            self._number.setdefault(agent, len(self._number))
        new = len(self._number) - len(self._counts["sent"])
        if new:
            self._counts = {kind: np.pad(counts, (0, new)) for kind, counts in self._counts.items()}
        return np.array([self._number[agent] for agent in agents], dtype=np.int64)

    def add(self, sender: int, receivers: Ints, *kinds: str) -> None:
        """Count a message of one sender for each of its receivers (N,), all by number, as all of these kinds."""
        for kind in kinds:
            self._counts[kind][sender, receivers] += 1

    def total(self, pending: Iterable[tuple[int, Ints]]) -> ChannelCounts:
        """Return the counts of all links together.

        Args:
            pending: sender and receivers, by number, of each message that has not arrived.
        """
        counted = {kind: int(counts.sum()) for kind, counts in self._counts.items()}
        return ChannelCounts(**counted, pending=sum(len(receivers) for _, receivers in pending))

    def by_link(self, pending: Iterable[tuple[int, Ints]]) -> Mapping[LinkName, ChannelCounts]:
        """Return the counts of each link on which a message was sent."""
        waiting = np.zeros_like(self._counts["sent"])
        for sender, receivers in pending:
            waiting[sender, receivers] += 1
        names = list(self._number)
        return {
            (names[sender], names[receiver]): ChannelCounts(
                **{kind: int(counts[sender, receiver]) for kind, counts in self._counts.items()},
                pending=int(waiting[sender, receiver]),
            )
            for sender, receiver in np.argwhere(self._counts["sent"]).tolist()
        }
