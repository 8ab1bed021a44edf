"""Workers that are processes of this machine."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Sequence
from typing import Any

from coopsim.envs.vector.arena import Arena
from coopsim.envs.vector.group import Order, Reply
from coopsim.envs.vector.line import Line
from coopsim.envs.vector.worker import RemoteWorker, WorkerDiedError
from coopsim.support.processes import cause_of_end, start_python

_PROGRAM = "from coopsim.envs.vector.serve import serve; serve()"


class Process(RemoteWorker):
    """Environments in a process of their own, which ends when this one does, in any way (see `serve`)."""

    def __init__(self, recipe: bytes, indices: Sequence[int]) -> None:
        self._owner = os.getpid()
        inbox, outbox = Arena.new(), Arena.new()
        orders, writer = os.pipe()
        ends = (orders, outbox.descriptor, inbox.descriptor)  # as the worker sees them
        self._process = start_python(_PROGRAM, *map(str, ends), pass_fds=ends)
        os.close(orders)
        assert self._process.stdout is not None
        self._writer = writer
        self._line = Line(self._process.stdout.fileno(), writer, inbox, outbox)
        with contextlib.suppress(BrokenPipeError):  # `describe` says so
            self._line.send((recipe, tuple(indices)))

    def give(self, orders: Sequence[Order]) -> None:
        with contextlib.suppress(BrokenPipeError):  # `take` says so
            self._line.send(orders)

    def wait(self) -> None:
        self._line.wait()

    def take(self) -> Reply:
        reply: Reply = self._receive()
        return reply

    def end(self) -> None:
        if self._writer < 0 or os.getpid() != self._owner:  # ended, or a fork of the process whose worker it is
            return
        self._process.kill()
        self._process.wait()
        self._line.close()
        os.close(self._writer)
        self._writer = -1
        for pipe in (self._process.stdin, self._process.stdout):
            if pipe is not None:
                pipe.close()

    def _receive(self) -> Any:
        try:
            return self._line.receive()
        except EOFError:
            raise WorkerDiedError(cause_of_end(self._process.wait())) from None
