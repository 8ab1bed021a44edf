"""The program of a worker process."""

from __future__ import annotations

import os
import sys
import threading

from coopsim.envs.vector.arena import Arena
from coopsim.envs.vector.group import EnvironmentGroup, failure
from coopsim.envs.vector.line import Line
from coopsim.support.threads import limit_threads


def serve() -> None:
    """Be a worker: make environments, then read orders and write replies until the parent process is gone.

    The arguments are file descriptors: the pipe of orders, and the memory of orders and of replies.
    """
    threading.Thread(target=_end_with_parent, daemon=True).start()
    orders, inbox, outbox = map(int, sys.argv[1:])
    replies = os.dup(1)
    os.dup2(2, 1)  # what environments print must not get among the replies
    limit_threads(1)
    line = Line(orders, replies, Arena(inbox), Arena(outbox))
    try:
        _obey(line)
    except (EOFError, BrokenPipeError):
        os._exit(0)


def _obey(line: Line) -> None:
    recipe, indices = line.receive()
    try:
        group = EnvironmentGroup(recipe, indices)
        made = group.describe()
    except BaseException as error:  # of a user's environment or option, as SystemExit
        line.send(failure(error))
        return
    line.send(made)
    while True:
        orders = line.receive()
        left, due = len(orders), len(orders) // 2
        for order in orders:
            # Replies go in groups, each of half of what is left: the parent wakes seldom, and waits little in the end.
            left -= 1
            line.send(group.do(order), hold=left > due)
            due = left // 2 if left <= due else due


def _end_with_parent() -> None:
    """Wait for the end of the standard input, which the parent holds and never writes to; then exit at once."""
    os.read(0, 1)
    os._exit(0)
