"""Worker processes that are forked from one that has imported the library: to import it takes each of them seconds.

They speak to tests as workers do that start anew. What only a new interpreter shows, such as a worker that lacks an
import, is shown by tests that ask for `started_anew`, and by all with `--start-anew`, as `make check-long` does.
Policies in processes of their own have a server in the library, which begins anew here, too.
"""

from __future__ import annotations

import atexit
import ctypes
import fcntl
import gc
import importlib
import os
import pickle
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
import traceback
import types
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import pytest

from coopsim.support import processes

STARTING = ("coopsim.bench.engine.engine", "coopsim.envs.vector.worker", "coopsim.learn.clips.ahead")
"""Modules that start workers."""

IMPORTED = ("coopsim.bench.engine.job", "coopsim.agents.boxes", "coopsim.envs.vector.environments", *STARTING,
            "coopsim.learn.samples.batches_ahead", "coopsim.learn.clips.simulated")  # fmt: skip
_SUBREAPER, _FIRST_FREE = 36, 200

_COMMAND = "import runpy; runpy.run_module('coopsim', run_name='__main__')"

_anew = 0


@pytest.fixture(scope="session", autouse=True)
def quick_starts(request: pytest.FixtureRequest) -> Iterator[None]:
    """Fork the workers of all tests, but of those that ask for `started_anew`."""
    global _anew
    _anew = int(request.config.getoption("start_anew"))
    with pytest.MonkeyPatch.context() as patch:
        for module in STARTING:
            patch.setattr(f"{module}.start_python", start_python)
        yield


@pytest.fixture
def started_anew() -> Iterator[None]:
    """Start workers as users' are."""
    global _anew
    _anew += 1
    yield
    _anew -= 1


def start_python(program: str, *arguments: str, pass_fds: Sequence[int] = ()) -> Any:
    """Do as `coopsim.support.processes.start_python`, with a process that has imported the library."""
    if _anew:
        return processes.start_python(program, *arguments, pass_fds=pass_fds)
    return _server().start(program, arguments, pass_fds)


def run_python(
    program: str, *arguments: str, folder: Path | None = None, found: Path | None = None
) -> subprocess.CompletedProcess[str]:
    """Run a program in a folder, for a test that is not about its start; it finds the packages of `found`."""
    path = [*([str(found)] if found else []), *(place or os.getcwd() for place in sys.path)]
    where = str(folder or os.getcwd())
    if _anew:
        command, environment = [sys.executable, "-c", program, *arguments], {**os.environ, "PYTHONPATH": ":".join(path)}
        return subprocess.run(command, cwd=where, env=environment, capture_output=True, text=True, check=False)
    with tempfile.TemporaryFile() as out, tempfile.TemporaryFile() as err, open(os.devnull) as nothing:
        files = [nothing.fileno(), out.fileno(), err.fileno()]
        pid = _server().fork((program, arguments, (), where, dict(os.environ), path), files)
        status = os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1])
        said = [file.seek(0) or file.read().decode() for file in (out, err)]
    return subprocess.CompletedProcess(arguments, status, *said)


def start_command(*command: str, **options: Any) -> subprocess.Popen[str]:
    """Start `coopsim` with arguments; the options are those of `subprocess.Popen`."""
    start = subprocess.Popen if _anew else _ForkedCommand
    return start([sys.executable, "-m", "coopsim", *command], text=True, **options)


class _ForkedCommand(subprocess.Popen[str]):
    """A process that was forked, with all of `subprocess.Popen`, for `python -m coopsim` with arguments."""

    def _execute_child(self, args: Sequence[str], *told: Any) -> None:  # type: ignore[override]
        """Start the process: the one step in which it differs. Of `told`, the folder and the pipes are needed."""
        folder, pipes = told[4] or os.getcwd(), told[9:15]
        theirs = (pipes[0], pipes[3], pipes[5])
        files = [file if file >= 0 else usual for usual, file in enumerate(theirs)]
        path = [place or os.getcwd() for place in sys.path]
        self.pid = _server().fork((_COMMAND, args[3:], (), str(folder), dict(os.environ), path), files)
        self._child_created = True
        self._close_pipe_fds(*pipes)  # type: ignore[attr-defined]


class Forked:
    """A process that was forked, with the part of `subprocess.Popen` that workers need."""

    def __init__(self, pid: int, stdin: int, stdout: int) -> None:
        self.pid, self.returncode, self._lock = pid, None, threading.Lock()
        self.stdin, self.stdout, self.stderr = os.fdopen(stdin, "wb"), os.fdopen(stdout, "rb"), None

    def poll(self) -> int | None:
        with self._lock:
            if self.returncode is None and (ended := os.waitpid(self.pid, os.WNOHANG))[0]:
                self.returncode = os.waitstatus_to_exitcode(ended[1])
            return self.returncode

    def wait(self) -> int:
        while self.poll() is None:
            time.sleep(0.001)
        return self.returncode

    def kill(self) -> None:
        if self.poll() is None:
            os.kill(self.pid, signal.SIGKILL)


class _Server:
    def __init__(self) -> None:
        self.owner, self._lock = os.getpid(), threading.Lock()
        self._orders, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        with theirs:
            fd = theirs.fileno()
            self._process = processes.start_python("import fork_server; fork_server.serve()", str(fd), pass_fds=(fd,))
        atexit.register(self._process.communicate)
        atexit.register(self._orders.close)  # which comes first, and ends it

    def start(self, program: str, arguments: Sequence[str], pass_fds: Sequence[int]) -> Forked:
        (their_in, stdin), (stdout, their_out) = os.pipe(), os.pipe()
        path = [place or os.getcwd() for place in sys.path]
        told = program, arguments, pass_fds, os.getcwd(), {**os.environ, **processes.ONE_THREAD}, path
        pid = self.fork(told, [their_in, their_out, 2, *pass_fds])
        os.close(their_in)
        os.close(their_out)
        return Forked(pid, stdin, stdout)

    def fork(self, told: tuple[Any, ...], files: Sequence[int]) -> int:
        """Return the number of the process that does what it is told, see `_become`."""
        with self._lock, _adopting():
            socket.send_fds(self._orders, [pickle.dumps(told)], files)
            return int(self._orders.recv(100))


_running: _Server | None = None


def _server() -> _Server:
    global _running
    if _running is None or _running.owner != os.getpid():
        _running = _Server()
    return _running


@contextmanager
def _adopting() -> Iterator[None]:
    """Make this process the parent of descendants whose own has ended, so that it learns how they end."""
    libc = ctypes.CDLL(None)
    libc.prctl(_SUBREAPER, 1, 0, 0, 0)
    try:
        yield
    finally:
        libc.prctl(_SUBREAPER, 0, 0, 0, 0)


def serve() -> None:
    """Fork processes as told, until the process that tells is gone."""
    orders = socket.socket(fileno=int(sys.argv[1]))
    for module in IMPORTED:
        with suppress(ImportError):  # without torch
            importlib.import_module(module)
    _warm_up()
    gc.freeze()
    while True:
        told, files, _, _ = socket.recv_fds(orders, 2**18, 64)
        if not told:
            os._exit(0)
        outlet, inlet = os.pipe()
        if (between := os.fork()) == 0:
            if child := os.fork():
                os.write(inlet, str(child).encode())
                os._exit(0)  # and the child is adopted
            for fd in (orders.detach(), outlet, inlet):
                os.close(fd)
            _become(files, *pickle.loads(told))
        os.waitpid(between, 0)
        orders.send(os.read(outlet, 100))
        for fd in (*files, outlet, inlet):
            os.close(fd)


def _warm_up() -> None:
    """Have what the first frames of most runs load: parts, plug-ins' names, and compiled kernels, a second's worth."""
    import coopsim  # here, because tests import this module before they measure what is imported

    coopsim.evaluate("late_fusion", seed=0, max_cycles=3, vehicles=6, lidar="VLP-16", lidar_columns=64)


def _become(
    files: Sequence[int], program: str, arguments: Sequence[str], pass_fds: Sequence[int], folder: str,
    environment: dict[str, str], path: list[str],
) -> None:  # fmt: skip
    """Be a new interpreter that runs a program."""
    os.setsid()
    kept = [fcntl.fcntl(fd, fcntl.F_DUPFD, _FIRST_FREE) for fd in files]
    for fd in files:
        os.close(fd)
    for fd, wanted in zip(kept, (0, 1, 2, *pass_fds), strict=True):
        os.dup2(fd, wanted)
        os.close(fd)
    os.chdir(folder)
    os.environ.clear()
    os.environ.update(environment)
    sys.path[:], sys.argv = path, ["-c", *arguments]
    importlib.invalidate_caches()
    signal.signal(signal.SIGINT, signal.default_int_handler)
    sys.modules["__main__"] = main = types.ModuleType("__main__")
    code: Any = 0
    try:
        exec(program, main.__dict__)
    except SystemExit as end:
        code = end.code
    except BaseException:
        traceback.print_exc()
        code = 1
    threading._shutdown()  # type: ignore[attr-defined]
    atexit._run_exitfuncs()
    with suppress(BrokenPipeError):
        sys.stdout.flush()
    os._exit(code if isinstance(code, int) else int(code is not None))
