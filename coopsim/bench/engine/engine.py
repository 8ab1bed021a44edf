"""Engines that run a benchmark's jobs: worker processes of this machine, or Ray tasks, here or on a cluster.

The pools of the standard library, joblib and loky do not fit: `multiprocessing`'s import the caller's script again,
which then needs a guard, and in all of them the death of one process fails every job without telling which one killed
it.
"""

from __future__ import annotations

import os
import pickle
import sys
import threading
from collections.abc import Generator, Iterator
from dataclasses import dataclass
from itertools import islice
from multiprocessing.connection import wait
from queue import SimpleQueue
from typing import Any, Generic, Protocol, TypeVar

from coopsim.errors import InvalidValueError
from coopsim.support.checks import require_choice, require_count
from coopsim.support.memory import release_freed_memory
from coopsim.support.processes import cause_of_end, cores, import_ray, ray_environment, start_python, start_ray
from coopsim.support.registrations import pack_registrations, register_packed

DoneT = TypeVar("DoneT")
DoneT_co = TypeVar("DoneT_co", covariant=True)


class Work(Protocol[DoneT_co]):
    """A piece of work as plain data, which runs in any process. It is hashable, by identity."""

    def run(self) -> DoneT_co:
        """Do the work. An exception is part of the outcome, not raised."""

    def died(self, how: str) -> DoneT_co:
        """Return the outcome where the process died; `how` differs between engines."""

    def lost(self, how: str) -> DoneT_co:
        """Return the outcome where the work could not be done for no fault of its own, as where a machine died."""


def run_work(work: Work[DoneT], registrations: bytes | None = None) -> DoneT:
    """Do a piece of work, and release its memory: policies refer to themselves, and their maps are large.

    It is a function, which can be sent to other processes, with what the caller has registered.
    """
    if registrations is not None:
        register_packed(registrations)
    done = work.run()
    release_freed_memory()
    return done


_OF_THE_WORK = ("WorkerCrashedError", "OutOfMemoryError", "RayTaskError")
"""Errors of Ray that the work itself may have caused; the others are of machines and of the cluster."""


def run_on_ray(jobs: Iterator[Work[DoneT]], workers: int | None, address: str | None) -> Generator[DoneT]:
    """Run jobs as Ray tasks, and yield outcomes as they come; closing the generator cancels the remaining ones.

    A Ray that the caller has started is used, and left running. Every machine of a cluster needs coopsim, and the
    packages and scenario files that jobs name; a policy's file is sent with the job. Without `address` it is the
    cluster of `RAY_ADDRESS`, or else this machine, with `workers` jobs at once.

    Raises:
        MissingDependencyError: Ray is not installed.
        InvalidValueError: there is no cluster at the address.
    """
    ray = import_ray()
    ours = not ray.is_initialized()
    if ours:
        start_ray(ray, workers, address)
    try:
        # Ray starts processes before there are tasks; a task with its own environment could not use them.
        do = ray.remote(num_cpus=1, **({} if ours else {"runtime_env": ray_environment()}))(run_work)
        known = pack_registrations()
        # Twice as many as run, so that a free core has its next job; no more, so that the order can still change.
        at_once = 2 * max(1, int(ray.cluster_resources().get("CPU", 1)))
        running = {do.remote(job, known): job for job in islice(jobs, at_once)}
        try:
            while running:
                (done,), _ = ray.wait(list(running), num_returns=1)
                yield _outcome(ray, done, running.pop(done))
                running.update((do.remote(job, known), job) for job in islice(jobs, 1))
        finally:
            for unfinished in running:
                ray.cancel(unfinished, force=True)
    finally:
        if ours:
            ray.shutdown()


def _outcome(ray: Any, reference: Any, job: Work[DoneT]) -> DoneT:
    try:
        outcome: DoneT = ray.get(reference)
    except ray.exceptions.RayError as error:  # after Ray's own retries
        how = type(error).__name__
        return job.died(how) if how in _OF_THE_WORK else job.lost(how)
    return outcome


_PROGRAM = "from coopsim.bench.engine.engine import serve; serve()"


def run_locally(jobs: Iterator[Work[DoneT]], workers: int) -> Generator[DoneT]:
    """Run jobs in worker processes, and yield outcomes as they come; closing the generator ends the processes.

    A job whose process died is run once more before it counts as failed: the process may have been killed from outside,
    as when memory runs out. The next job is taken when a worker is free.
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
        self._send(pack_registrations())
        self.give(job)

    @property
    def alive(self) -> bool:
        """True if the process was still running at the last `take`."""
        return self._process.returncode is None

    def give(self, job: Work[DoneT]) -> None:
        """Hand over a job."""
        self.job = job
        self._send(job)

    def _send(self, content: object) -> None:
        try:
            pickle.dump(content, self._orders)
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
    """Be a worker: read registrations, then jobs, from the standard input and write outcomes to the standard output.

    When the parent process is gone the input ends, and this process exits at once, during a job or not.
    """
    replies = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # a policy's prints must not get among the outcomes
    jobs: SimpleQueue[Any] = SimpleQueue()
    threading.Thread(target=_listen, args=(jobs,), daemon=True).start()
    register_packed(jobs.get())
    while True:
        pickle.dump(run_work(jobs.get()), replies)
        replies.flush()


def _listen(jobs: SimpleQueue[Any]) -> None:
    try:
        while True:
            jobs.put(pickle.load(sys.stdin.buffer))
    except (EOFError, pickle.UnpicklingError):  # between two jobs, or in the middle of one
        os._exit(0)


ENGINES = ("local", "ray")


@dataclass(frozen=True, slots=True)
class Engine:
    """Engine that runs cells.

    Attributes:
        name: "local" (processes of this machine) or "ray".
        workers: number of cells at once; None: as many as there are cores.
        address: address of a Ray cluster; None: `RAY_ADDRESS`, or else a Ray of this machine alone.

    Raises:
        CoopsimError: there is no such engine, a value is not accepted, or "local" is asked for without POSIX processes.
    """

    name: str = "local"
    workers: int | None = None
    address: str | None = None

    def __post_init__(self) -> None:
        require_choice("engine", self.name, ENGINES)
        if self.name == "local" and os.name != "posix":
            raise InvalidValueError(f"engine must be 'ray' here: 'local' needs Linux or macOS, this is {sys.platform}")
        if self.workers is not None:
            require_count(1, workers=self.workers)
        if self.address is not None and self.name != "ray":
            raise InvalidValueError(
                f"address is of a Ray cluster and needs engine 'ray', got {self.address!r} for {self.name!r}"
            )

    @property
    def at_once(self) -> int:
        """Cells at once on this machine."""
        return self.workers or cores()

    def run(self, jobs: Iterator[Work[DoneT]]) -> Generator[DoneT]:
        """Run jobs, and yield outcomes as they come; closing the generator ends the running ones."""
        if self.name == "ray":
            return run_on_ray(jobs, self.workers, self.address)
        return run_locally(jobs, self.at_once)
