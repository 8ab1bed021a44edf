"""The interface between an engine and what it runs: pieces of work, and what becomes of each."""

from __future__ import annotations

from typing import Protocol, TypeVar

DoneT = TypeVar("DoneT")
DoneT_co = TypeVar("DoneT_co", covariant=True)


class Work(Protocol[DoneT_co]):
    """A piece of work as plain data, which runs in any process. It is hashable, by identity."""

    def run(self) -> DoneT_co:
        """Do the work. An exception is part of the outcome, not raised."""

    def died(self, how: str) -> DoneT_co:
        """Return the outcome where the process died; `how` differs between engines."""

    def lost(self, how: str) -> DoneT_co:
        """Return the outcome where the work could not be done for no fault of its own, as where a machine died."""


def run_work(work: Work[DoneT]) -> DoneT:
    """Do a piece of work; a function, which can be sent to other processes."""
    return work.run()
