"""Worker processes: interpreters of their own with one thread each, the reason of their end, and Ray's start."""

from __future__ import annotations

import importlib
import os
import platform
import signal
import subprocess
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from coopsim.errors import InvalidValueError, MissingDependencyError
from coopsim.support.precision import PRECISION, arithmetic

_POOLS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS", "VECLIB_MAXIMUM_THREADS")

ONE_THREAD: Mapping[str, str] = dict.fromkeys(_POOLS, "1")
"""Environment variables of a worker process: there are as many workers as cores, so each uses one thread."""


def cores() -> int:
    """Return the number of cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def processor_name() -> str:
    """Return the processor's name, as far as the system says it."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        lines = []
    named = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return named[0] if named else platform.processor() or platform.machine()


def start_python(
    program: str, *arguments: str, pass_fds: Sequence[int] = (), environment: Mapping[str, str] | None = None
) -> subprocess.Popen[bytes]:
    """Start a Python process that runs `program`, with pipes as its standard input and output.

    It begins anew, without the caller's script (as `multiprocessing` would, which then needs a guard) and without the
    threads and locks that a fork copies. The terminal's Ctrl-C does not reach it: its parent ends it. `environment` is
    besides the variables of one thread and of the path; None: ours.
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


def ray_environment() -> dict[str, Any]:
    """Return Ray's "runtime environment" of tasks and actors: one thread, and our arithmetic on any machine."""
    return {"env_vars": {**ONE_THREAD, PRECISION: arithmetic()}}


def import_ray() -> Any:
    """Return the module `ray`; raise `MissingDependencyError` without it."""
    try:
        return importlib.import_module("ray")
    except ImportError as error:
        raise MissingDependencyError("Ray needs the package ray: pip install 'coopsim[ray]'") from error


def start_ray(ray: Any, workers: int | None, address: str | None) -> None:
    """Start Ray on this machine with these processes (None: one for each core), or in the cluster at an address.

    Without an address, `RAY_ADDRESS` names the cluster. Raises `InvalidValueError` if there is none.
    """
    address = address or os.environ.get("RAY_ADDRESS") or "local"
    # What is stored is small, and Ray's default would take a third of the machine's memory.
    here = {"num_cpus": workers, "include_dashboard": False, "object_store_memory": 100 * 2**20}
    try:
        ray.init(
            address=address,
            runtime_env=ray_environment(),
            log_to_driver=False,
            logging_level="ERROR",
            **(here if address == "local" else {}),
        )
    except (ConnectionError, ValueError, RuntimeError) as error:
        raise InvalidValueError(f"address must be that of a Ray cluster, got {address!r}: {error}") from error
