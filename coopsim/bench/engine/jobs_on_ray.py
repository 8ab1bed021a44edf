"""The engine "ray": jobs as Ray tasks, on this machine or a cluster."""

from __future__ import annotations

from collections.abc import Generator, Iterator
from itertools import islice
from typing import Any

from coopsim.bench.engine.work import DoneT, Work, run_work
from coopsim.support.ray_cluster import import_ray, ray_environment, start_ray

_OF_THE_WORK = ("WorkerCrashedError", "OutOfMemoryError", "RayTaskError")
"""Errors of Ray that the work itself may have caused; the others are of machines and of the cluster."""


def run_on_ray(jobs: Iterator[Work[DoneT]], workers: int | None, address: str | None) -> Generator[DoneT]:
    """Run jobs, and yield outcomes as they come; closing the generator cancels the remaining ones.

    A Ray that the caller has started is used, and left running. Every machine of a cluster needs coopsim, and the
    packages and scenario files that jobs name; a policy's file is sent with the job.

    Args:
        jobs: taken a few at a time, as cores become free.
        workers: jobs at once on this machine; None, or on a cluster: one for each core.
        address: of a cluster, as `ray.init` takes it; None: `RAY_ADDRESS`, or else this machine alone.

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
        # Twice as many as run, so that a free core has its next job; no more, so that the order can still change.
        at_once = 2 * max(1, int(ray.cluster_resources().get("CPU", 1)))
        running = {do.remote(job): job for job in islice(jobs, at_once)}
        try:
            while running:
                (done,), _ = ray.wait(list(running), num_returns=1)
                yield _outcome(ray, done, running.pop(done))
                running.update((do.remote(job), job) for job in islice(jobs, 1))
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
