"""A worker: a process with environments of a vector, as the calling process has it, and its far end."""

from __future__ import annotations

import contextlib
import os
import pickle
import sys
import threading
from collections.abc import Sequence
from multiprocessing import Pipe
from multiprocessing.connection import Connection
from typing import Any

from coopsim.envs.vector.environments import Description, EnvironmentGroup, Failure, failure
from coopsim.envs.vector.shared_blocks import SharedBlocks
from coopsim.errors import LostEnvironmentsError
from coopsim.support.processes import cause_of_end, start_python
from coopsim.support.threads import limit_threads

_PROGRAM = "from coopsim.envs.vector.worker import serve; serve()"


class WorkerDiedError(Exception):
    """A worker is gone, and its environments with it; the message says how it ended."""


class Worker:
    """A process with a block of environments, which ends when this one does, in any way (see `serve`)."""

    def __init__(self, recipe: bytes, indices: Sequence[int]) -> None:
        self._indices = indices
        self._replies = SharedBlocks.new()
        self._connection, theirs = Pipe()
        ends = theirs.fileno(), self._replies.file
        self._process = start_python(_PROGRAM, *map(str, ends), pass_fds=ends)
        theirs.close()
        self.send(pickle.dumps((recipe, tuple(indices)), protocol=5))

    def describe(self) -> Description:
        """Wait until the environments are made, and describe them; to be called first.

        Raises:
            LostEnvironmentsError: the worker died.
            Exception: an error in making them.
        """
        try:
            made: Description | Failure = self.receive()
        except WorkerDiedError as death:
            report = f"the worker died ({death}) while it made its environments\n"
            raise LostEnvironmentsError(dict.fromkeys(self._indices, report)) from None
        if isinstance(made, Failure):
            raise made.exception
        return made

    def send(self, pickled: bytes) -> None:
        """Send a content; a worker that is gone says so in `receive`."""
        with contextlib.suppress(OSError):
            self._connection.send((pickled, self._replies.released()))

    def receive(self) -> Any:
        """Wait for the next content, and return it; its large arrays are views of shared memory.

        Raises:
            WorkerDiedError: it is gone.
        """
        try:
            blocks = self._connection.recv()
        except (EOFError, OSError):
            raise WorkerDiedError(cause_of_end(self._process.wait())) from None
        return self._replies.read(blocks)

    def kill(self) -> None:
        """End the process at once."""
        self._process.kill()
        self._process.wait()

    def close(self) -> None:
        """Let go of pipes and memory."""
        self._connection.close()
        self._replies.close()
        for pipe in (self._process.stdin, self._process.stdout):
            if pipe is not None:
                pipe.close()


def serve() -> None:
    """Be a worker: make environments, then read orders and write replies until the parent process is gone.

    The arguments are file descriptors: the connection, and the memory of replies.
    """
    threading.Thread(target=_end_with_parent, daemon=True).start()
    os.dup2(2, 1)  # nobody reads what environments print to a pipe
    limit_threads(1)
    connection, memory = sys.argv[1:]
    try:
        _obey(Connection(int(connection)), SharedBlocks(int(memory)))
    except (EOFError, BrokenPipeError, ConnectionResetError):
        os._exit(0)


def _obey(connection: Connection, replies: SharedBlocks) -> None:
    def receive() -> Any:
        pickled, released = connection.recv()
        replies.reuse(released)
        return pickle.loads(pickled)

    try:
        group = EnvironmentGroup(*receive())
        made: Description | Failure = group.describe()
    except BaseException as error:  # of a user's environment or option, as SystemExit
        made = failure(error)
    connection.send(replies.write(made))
    while not isinstance(made, Failure):
        # One message for all: a message costs as much as a step of the fastest environments.
        connection.send(replies.write([group.do(order) for order in receive()]))


def _end_with_parent() -> None:
    """Wait for the end of the standard input, which the parent holds and never writes to; then exit at once."""
    os.read(0, 1)
    os._exit(0)
