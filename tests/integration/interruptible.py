"""Commands as processes that Ctrl-C reaches even where it does not reach us: a shell's background jobs ignore it."""

from __future__ import annotations

import signal
import subprocess
from typing import Any

from fork_server import start_command


def interruptible(*command: str, **options: Any) -> subprocess.Popen[str]:
    """The command `coopsim ...` as a process."""
    ours = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        return start_command(*command, **options)
    finally:
        signal.signal(signal.SIGINT, ours)
