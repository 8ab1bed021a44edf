"""Times that tests are held to: a test of `make test` that computes for longer than a few seconds fails."""

from __future__ import annotations

import time
from collections.abc import Generator

import pytest
from numba.core import event

LIMIT_S = 8.0
"""Processor time of one test's call, on the machine for which `REFERENCE_S` was measured. Tests are meant to take less
than 3 s; the rest is for processors that others use at the same time."""

REFERENCE_S = 0.045
"""Processor time of `some_work` on the machine on which tests were measured, a virtual core of an AMD EPYC."""


def some_work() -> float:
    """Do a fixed piece of work. Return its processor time, the least of three."""
    taken = []
    for _ in range(3):
        began_s = time.process_time()
        sum(number * number for number in range(1_000_000))
        taken.append(time.process_time() - began_s)
    return min(taken)


class Compilations(event.Listener):
    """The processor time that numba has spent on compilation: of kernels that are compiled on their first use."""

    def __init__(self) -> None:
        self.spent_s, self._depth, self._began_s = 0.0, 0, 0.0
        event.register("numba:compiler_lock", self)

    def on_start(self, event: event.Event) -> None:
        if self._depth == 0:
            self._began_s = time.process_time()
        self._depth += 1

    def on_end(self, event: event.Event) -> None:
        self._depth -= 1
        if self._depth == 0:
            self.spent_s += time.process_time() - self._began_s


class HeldTimes:
    """A plugin of pytest that fails each test whose call takes more processor time than a test may take.

    The time is this process's own, which no other process on the machine changes. Compilation is not counted. On a
    machine that is slower than the reference the limit is higher in proportion. A test marked `heavy` is let off.
    """

    def __init__(self, limit_s: float = LIMIT_S) -> None:
        self._limit_s = limit_s * max(1.0, some_work() / REFERENCE_S)
        self._compilations = Compilations()

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_call(self, item: pytest.Item) -> Generator[None, object, object]:
        began_s, compiled_s = time.process_time(), self._compilations.spent_s
        result = yield
        took_s = time.process_time() - began_s - (self._compilations.spent_s - compiled_s)
        if took_s > self._limit_s and item.get_closest_marker("heavy") is None:
            pytest.fail(
                f"took {took_s:.1f} s of processor time; a test of `make test` may take {self._limit_s:.1f} s on this "
                "machine. Make it smaller, or mark it `long` and keep a smaller one beside it",
                pytrace=False,
            )
        return result
