"""Ctrl-C in a command: told in one line, and never lost."""

from __future__ import annotations

import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import TracebackType

_AGAIN_AFTER_S = 0.05


def tell_in_one_line(kind: type[BaseException], error: BaseException, trace: TracebackType | None) -> None:
    """Report an exception that nobody caught; a `sys.excepthook` for commands."""
    if issubclass(kind, KeyboardInterrupt):
        print("coopsim: interrupted", file=sys.stderr)
    else:
        sys.__excepthook__(kind, error, trace)


@contextmanager
def repeated_interrupts() -> Iterator[None]:
    """Send an interrupt again where Python dropped it.

    It drops every exception in a finalizer and in a callback of C code, as those by which numba loads its kernels.
    """
    usual = sys.unraisablehook

    def hook(dropped: sys.UnraisableHookArgs) -> None:
        if issubclass(dropped.exc_type, KeyboardInterrupt) and hasattr(signal, "pthread_kill"):
            main = threading.main_thread().ident
            threading.Timer(_AGAIN_AFTER_S, signal.pthread_kill, (main, signal.SIGINT)).start()
        else:
            usual(dropped)

    sys.unraisablehook = hook
    try:
        yield
    finally:
        sys.unraisablehook = usual
