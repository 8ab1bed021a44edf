"""Worker processes: interpreters of their own, with our search path, one thread each, and the reason of their end."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Mapping, Sequence

_POOLS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS", "VECLIB_MAXIMUM_THREADS")

ONE_THREAD: Mapping[str, str] = dict.fromkeys(_POOLS, "1")
"""Environment variables of a worker process: there are as many workers as cores, so each uses one thread."""


def cores() -> int:
    """Return the number of cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def start_python(
    program: str, *arguments: str, pass_fds: Sequence[int] = (), environment: Mapping[str, str] | None = None
) -> subprocess.Popen[bytes]:
    """Start a Python process that runs `program`, with pipes as its standard input and output.

    It begins anew, without the caller's script (as `multiprocessing` would, which then needs a guard) and without the
    threads and locks that a fork copies. The terminal's Ctrl-C does not reach it: its parent ends it.

    Args:
        program: Python code.
        *arguments: its `sys.argv[1:]`.
        pass_fds: file descriptors that it inherits under the same numbers.
        environment: its environment variables, besides those of one thread and of the path; None: ours.
    """
    path = os.pathsep.join(place or os.getcwd() for place in sys.path)  # "" is where an interpreter was started
    return subprocess.Popen(
        [sys.executable, "-P", "-c", program, *arguments],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        env={**(os.environ if environment is None else environment), **ONE_THREAD, "PYTHONPATH": path},
        start_new_session=True,
        pass_fds=pass_fds,
    )


def cause_of_end(status: int) -> str:
    """Return how a process ended, from the status that `Popen.wait` returns: "exit status 1" or "SIGKILL"."""
    if status >= 0:
        return f"exit status {status}"
    try:
        return signal.Signals(-status).name
    except ValueError:  # most real-time signals have no name
        return f"signal {-status}"
