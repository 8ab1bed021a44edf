"""Jobs by processes on this machine.

Processes of our own and not `multiprocessing`'s: those import the caller's script again, which then needs a guard
around whatever it does, and one that dies takes the whole pool with it.
"""

from __future__ import annotations

import os
import pickle
import selectors
import signal
import subprocess
import sys
from collections.abc import Generator, Iterator
from itertools import islice

from coopsim.bench.engine.job import ONE_THREAD, Job, Outcome, died

_PROGRAM = "from coopsim.bench.engine.worker import main; main()"


def run_locally(jobs: Iterator[Job], workers: int) -> Generator[Outcome]:
    """Outcomes, in the order in which they come; closing the iterator ends the processes.

    A job whose process died is done once more before it counts as failed: it may have been killed from outside, as
    when memory ran out or everything was killed, and then this process had only not been killed yet.

    Args:
        jobs: the next is taken when a worker has nothing to do.
        workers: processes at once.
    """
    crew: set[_Worker] = set()
    repeated: set[Job] = set()
    try:
        with selectors.DefaultSelector() as replies:

            def give(job: Job, worker: _Worker | None = None) -> None:
                if worker is None:
                    crew.add(worker := _Worker())
                    replies.register(worker.replies, selectors.EVENT_READ, worker)
                worker.give(job)

            for job in islice(jobs, workers):
                give(job)
            while replies.get_map():
                for ready, _ in replies.select():
                    worker: _Worker = ready.data
                    outcome = worker.take()
                    alive = worker.process.returncode is None
                    if alive or outcome.job in repeated:
                        yield outcome
                        following = next(jobs, None)
                    else:
                        repeated.add(following := outcome.job)
                    if not alive or following is None:
                        replies.unregister(worker.replies)
                        worker.end()
                        crew.remove(worker)
                    if following is not None:
                        give(following, worker if alive else None)
    finally:
        for worker in crew:
            worker.end()


class _Worker:
    """A process that does one job after another; it ends when we do, however we end (see
    `coopsim.bench.engine.worker`).
    """

    def __init__(self) -> None:
        # It finds what we find, and does not get our terminal's Ctrl-C: we end it.
        path = os.pathsep.join(place or os.getcwd() for place in sys.path)  # "" is where an interpreter was started
        environment = {**os.environ, **ONE_THREAD, "PYTHONPATH": path}
        self.process = subprocess.Popen(
            [sys.executable, "-P", "-c", _PROGRAM],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            env=environment,
            start_new_session=True,
        )
        assert self.process.stdin is not None and self.process.stdout is not None
        self._orders, self.replies = self.process.stdin, self.process.stdout
        self._job: Job

    def give(self, job: Job) -> None:
        """Have it do a job."""
        self._job = job
        try:
            pickle.dump(job, self._orders)
            self._orders.flush()
        except BrokenPipeError:  # it died; `take` says so
            return

    def take(self) -> Outcome:
        """What came of the job."""
        try:
            outcome: Outcome = pickle.load(self.replies)
        except (EOFError, pickle.UnpicklingError):
            return died(self._job, _how(self.process.wait()))
        return outcome

    def end(self) -> None:
        """End the process, whatever it does."""
        self.process.kill()
        self.process.wait()
        for pipe in (self._orders, self.replies):
            try:
                pipe.close()
            except BrokenPipeError:  # of what it had not read
                continue


def _how(status: int) -> str:
    return f"exit status {status}" if status >= 0 else signal.Signals(-status).name
