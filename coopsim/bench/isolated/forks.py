"""Processes for policies, forked from one server process that has imported coopsim and knows nothing else.

So each agent has a process of its own for milliseconds instead of a second. The server holds no seed, salt or policy.
"""

from __future__ import annotations

import atexit
import gc
import importlib
import json
import os
import signal
import socket
import struct
import sys
import threading
import time
from collections.abc import Mapping, Sequence
from typing import Any

from coopsim.bench.isolated.confine import close_memory, confine, other_user_reads
from coopsim.bench.isolated.parcels import Pipe
from coopsim.geometry import exact
from coopsim.support.processes import cause_of_end, start_python
from coopsim.support.threads import limit_threads

_PROGRAM = "from coopsim.bench.isolated.forks import serve; serve()"
_LENGTH = struct.Struct("<I")
_GRACE_S = 5.0

_KEPT = ("PATH", "HOME", "TMPDIR", "VIRTUAL_ENV", "COOPSIM_PRECISION")
_KEPT_BEGINNINGS = ("LANG", "LC_", "LD_", "DYLD_", "XDG_", "NUMBA_", "NPY_", "OPENBLAS_", "CUDA_")
"""What decides where programs are and how they calculate; not where recordings are, nor what salts seeds."""


class GuestProcess:
    """A process that obeys the orders of `coopsim.bench.isolated.guest`.

    Attributes:
        pipe: carries orders there, and answers back.

    Args:
        readable: files and folders that it may read.
        number: number of the process, which decides its user where it has one of its own.
    """

    def __init__(self, readable: Sequence[str], number: int) -> None:
        (there, orders), (answers, back) = os.pipe(), os.pipe()
        told: dict[str, Any] = {"environment": _least_environment(), "path": _path(), "folder": os.getcwd()}
        told |= {"readable": list(readable), "number": number}
        self._server = _running_server()
        self._pid = int(self._server.ask(told, (there, back)))
        os.close(there)
        os.close(back)
        self.pipe = Pipe(answers, orders)
        self._ends: tuple[int, ...] = (orders, answers)
        self._cause = ""

    @property
    def is_alive(self) -> bool:
        """True until `end`."""
        return bool(self._ends)

    def end(self, grace_s: float = 0.0) -> str:
        """End the process, which has some time to do so by itself. Return how it ended."""
        if self._ends:
            for end in self._ends:
                os.close(end)
            self._ends = ()
            self._cause = str(self._server.ask({"end": self._pid, "grace_s": grace_s}))
        return self._cause


class _Server:
    """The server process; it ends when this process does."""

    def __init__(self) -> None:
        close_memory()
        ours, theirs = socket.socketpair()
        with theirs:
            fd = theirs.fileno()
            self.process = start_python(_PROGRAM, str(fd), pass_fds=(fd,), environment=_least_environment())
        self._socket, self._lock, self.owner = ours, threading.Lock(), os.getpid()
        atexit.register(self.close)

    @property
    def is_alive(self) -> bool:
        """True while it runs, and is a child of this process."""
        return self.owner == os.getpid() and self.process.poll() is None

    def close(self) -> None:
        """End the server, and with it its processes."""
        self._socket.close()
        if self.owner == os.getpid():
            self.process.kill()
            self.process.communicate()

    def ask(self, told: Mapping[str, Any], files: Sequence[int] = ()) -> Any:
        """Tell the server something, hand over open files, and return its answer."""
        with self._lock:
            try:
                _send(self._socket, told, files)
                return _receive(self._socket)[0]
            except (OSError, EOFError):
                return f"with its server: {cause_of_end(self.process.wait())}" if "end" in told else -1


_server: _Server | None = None


def _running_server() -> _Server:
    """Return this process's server, which is started if need be."""
    global _server
    if _server is None or not _server.is_alive:
        if _server is not None:
            _server.close()
        _server = _Server()
    return _server


def serve() -> None:
    """Fork and end processes as told, until the process that tells is gone."""
    close_memory()
    for module in ("coopsim.bench.isolated.guest", "coopsim.agents.boxes", "coopsim.agents.networks"):
        importlib.import_module(module)
    exact.sin(0.0)  # at a process's first call of any kernel numba reads all that it knows of types, for 0.2 s
    own_user = other_user_reads()
    gc.freeze()  # so that the processes share this memory
    orders = socket.socket(fileno=int(sys.argv[1]))
    while True:
        try:
            told, files = _receive(orders)
        except (EOFError, OSError):
            os._exit(0)
        if "end" in told:
            _send(orders, _end(told["end"], told["grace_s"]))
            continue
        pid = os.fork()
        if pid == 0:
            try:
                _become_guest(told, files, own_user=own_user)
            finally:
                os._exit(1)
        for file in files:
            os.close(file)
        _send(orders, pid)


def _become_guest(told: Mapping[str, Any], files: Sequence[int], *, own_user: bool) -> None:
    """Be a policy's process: two open files, no environment but what calculates, confined."""
    from coopsim.bench.isolated.guest import Guest
    from coopsim.support.kernels import keep_no_kernels

    server, null = os.getppid(), os.open(os.devnull, os.O_RDWR)
    orders, replies = (os.dup2(os.dup(file), 200 + k) for k, file in enumerate(files))
    for k, file in enumerate((orders, null, null, replies)):
        os.dup2(file, k)
    os.closerange(4, 4096)
    os.chdir(told["folder"])
    os.environ.clear()
    os.environ.update(told["environment"])
    sys.path[:], sys.argv[:] = told["path"], [""]
    keep_no_kernels()
    limit_threads(1)
    confinement = confine(told["readable"], told["number"], own_user=own_user)
    threading.Thread(target=_end_with, args=(server,), daemon=True).start()  # rights are of threads, so it comes last
    Guest(confinement).serve(Pipe(0, 3))


def _end_with(parent: int) -> None:
    while os.getppid() == parent:
        time.sleep(1.0)
    os._exit(0)


def _end(pid: int, grace_s: float) -> str:
    """Wait for a process, kill it after a time, and return how it ended."""
    end_s = time.monotonic() + grace_s
    while True:
        ended, status = os.waitpid(pid, os.WNOHANG)
        if ended:
            return cause_of_end(os.waitstatus_to_exitcode(status))
        if time.monotonic() >= end_s:
            os.kill(pid, signal.SIGKILL)
            end_s = float("inf")
        time.sleep(0.002)


def _send(to: socket.socket, content: Any, files: Sequence[int] = ()) -> None:
    block = json.dumps(content).encode()
    socket.send_fds(to, [_LENGTH.pack(len(block))], list(files))
    to.sendall(block)


def _receive(source: socket.socket) -> tuple[Any, list[int]]:
    head, files, _, _ = socket.recv_fds(source, _LENGTH.size, 2)
    if len(head) < _LENGTH.size:
        raise EOFError
    (length,), block = _LENGTH.unpack(head), b""
    while len(block) < length:
        part = source.recv(length - len(block))
        if not part:
            raise EOFError
        block += part
    return json.loads(block), files


def _path() -> list[str]:
    return [place or os.getcwd() for place in sys.path]


def _least_environment() -> dict[str, str]:
    return {name: value for name, value in os.environ.items() if name in _KEPT or name.startswith(_KEPT_BEGINNINGS)}
