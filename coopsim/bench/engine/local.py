"""The engine "local": jobs in worker processes of this machine.

The pools of the standard library and joblib do not fit: `multiprocessing`'s import the caller's script again, which
then needs a guard, and in all of them the death of one process fails every job without telling which one killed it.
"""

from __future__ import annotations

import gc
import os
import pickle
import sys
import threading
from collections.abc import Generator, Iterator
from itertools import islice
from multiprocessing.connection import wait
from queue import SimpleQueue
from typing import Any, Generic

from coopsim.bench.engine.work import DoneT, Work
from coopsim.support.processes import cause_of_end, start_python

_PROGRAM = "from coopsim.bench.engine.local import serve; serve()"


def run_locally(jobs: Iterator[Work[DoneT]], workers: int) -> Generator[DoneT]:
    """Run jobs, and yield outcomes as they come; closing the generator ends the processes.

    A job whose process died is run once more before it counts as failed: the process may have been killed from outside,
    as when memory runs out.

    Args:
        jobs: the next one is taken when a worker is free.
        workers: number of processes.
    """
    crew: list[_Worker[DoneT]] = []
    repeated: set[Work[DoneT]] = set()
    try:
        crew += map(_Worker, islice(jobs, workers))
        while crew:
            ready = wait([worker.replies.fileno() for worker in crew])
            for worker in [each for each in crew if each.replies.fileno() in ready]:
                outcome = worker.take()
                if worker.alive or worker.job in repeated:
                    yield outcome
                    following = next(jobs, None)
                else:
                    repeated.add(following := worker.job)
                if worker.alive and following is not None:
                    worker.give(following)
                    continue
                crew.remove(worker)
                worker.end()
                if following is not None:
                    crew.append(_Worker(following))
    finally:
        for worker in crew:
            worker.end()


class _Worker(Generic[DoneT]):
    """A process that runs one job after another. It ends when this process does, in any way (see `serve`)."""

    def __init__(self, job: Work[DoneT]) -> None:
        self._process = start_python(_PROGRAM)
        assert self._process.stdin is not None and self._process.stdout is not None
        self._orders, self.replies = self._process.stdin, self._process.stdout
        self.give(job)

    @property
    def alive(self) -> bool:
        """Whether the process was still running at the last `take`."""
        return self._process.returncode is None

    def give(self, job: Work[DoneT]) -> None:
        """Hand over a job."""
        self.job = job
        try:
            pickle.dump(job, self._orders)
            self._orders.flush()
        except BrokenPipeError:  # it died; `take` says so
            return

    def take(self) -> DoneT:
        """Wait for the outcome of the job."""
        try:
            outcome: DoneT = pickle.load(self.replies)
        except (EOFError, pickle.UnpicklingError):
            return self.job.died(cause_of_end(self._process.wait()))
        return outcome

    def end(self) -> None:
        """Kill the process."""
        self._process.kill()
        self._process.wait()
        for pipe in (self._orders, self.replies):
            try:
                pipe.close()
            except BrokenPipeError:  # of orders that it had not read
                continue


def serve() -> None:
    """Be a worker: read jobs from the standard input and write outcomes to the standard output.

    When the parent process is gone the input ends, and this process exits at once, during a job or not.
    """
    replies = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # a policy's prints must not get among the outcomes
    jobs: SimpleQueue[Work[Any]] = SimpleQueue()
    threading.Thread(target=_listen, args=(jobs,), daemon=True).start()
    while True:
        pickle.dump(jobs.get().run(), replies)
        replies.flush()
        gc.collect()  # policies refer to themselves; until a collection by chance, maps of many episodes pile up


def _listen(jobs: SimpleQueue[Work[Any]]) -> None:
    try:
        while True:
            jobs.put(pickle.load(sys.stdin.buffer))
    except (EOFError, pickle.UnpicklingError):  # between two jobs, or in the middle of one
        os._exit(0)
