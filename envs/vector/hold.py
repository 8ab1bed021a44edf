"""Ctrl-C only where it does no harm."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable
from typing import Any


class Hold:
    """Holds Ctrl-C back within a `with` block, but for waits; what came meanwhile is raised in the next, or at the end.

    So an interrupt never comes between reading a message and noting what it says.
    """

    def __init__(self) -> None:
        self._before: Callable[..., Any] | None = None
        self._swapped = self._open = self._pending = False

    def wait(self, waits: Callable[[], object] | None = None) -> None:
        """Let Ctrl-C through while a function waits, which must be such as can be called again."""
        self._open = True
        try:
            if self._pending:
                self._raise()
            if waits is not None:
                waits()
        finally:
            self._open = False

    def __enter__(self) -> None:
        self._swapped = False
        if threading.current_thread() is not threading.main_thread():  # others are never interrupted
            return
        now = signal.getsignal(signal.SIGINT)
        if callable(now):
            if now != self._note:  # as it is after an exception of another signal's handler
                self._before = now
            self._open, self._swapped = False, True
            signal.signal(signal.SIGINT, self._note)

    def __exit__(self, *_: object) -> None:
        if self._swapped:
            signal.signal(signal.SIGINT, self._before)
            if self._pending:
                self._raise()

    def _note(self, *_: object) -> None:
        self._pending = True
        if self._open:
            self._raise()

    def _raise(self) -> None:
        self._pending = False
        if self._before is not None:
            self._before(signal.SIGINT, None)
