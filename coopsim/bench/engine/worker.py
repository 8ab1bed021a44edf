"""The other side of `coopsim.bench.engine.local`: a process that reads jobs and writes outcomes.

When its parent is gone its input ends, and so does the process at once, in the midst of a job or not.
"""

from __future__ import annotations

import os
import pickle
import sys
import threading
from queue import SimpleQueue

from coopsim.bench.engine.job import Job, run_job


def main() -> None:
    """Do jobs until the input ends."""
    replies = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # what a policy prints must not get among the outcomes
    jobs: SimpleQueue[Job] = SimpleQueue()
    threading.Thread(target=_listen, args=(jobs,), daemon=True).start()
    while True:
        pickle.dump(run_job(jobs.get()), replies)
        replies.flush()


def _listen(jobs: SimpleQueue[Job]) -> None:
    try:
        while True:
            jobs.put(pickle.load(sys.stdin.buffer))
    except (EOFError, pickle.UnpicklingError):  # between two jobs, or in the midst of one
        os._exit(0)
