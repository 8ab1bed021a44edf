"""Workers that are Ray actors, on this machine or a cluster."""

from __future__ import annotations

import pickle
from collections import deque
from collections.abc import Sequence
from typing import Any, ClassVar

from coopsim.envs.vector.group import EnvironmentGroup, Order, Reply, failure
from coopsim.envs.vector.worker import RemoteWorker, Worker, WorkerDiedError
from coopsim.errors import InvalidValueError
from coopsim.support.ray_cluster import import_ray, ray_environment, start_ray
from coopsim.support.threads import limit_threads


class RayWorkers:
    """Starts workers on Ray. A Ray that the caller has started is used, and left running; ours ends with its last user.

    Every machine of a cluster needs coopsim, and the packages and scenario files that the environments use.

    Args:
        workers: number of workers.
        address: of a cluster, as `ray.init` takes it; None: `RAY_ADDRESS`, or else this machine alone.

    Raises:
        MissingDependencyError: Ray is not installed.
        InvalidValueError: there is no cluster at the address, or it has fewer free cores than `workers`.
    """

    _ours: ClassVar[int] = 0
    """Number of users of the Ray that was started here; 0: it is the caller's, or there is none."""

    def __init__(self, workers: int, address: str | None) -> None:
        self._ray = import_ray()
        if not self._ray.is_initialized():
            start_ray(self._ray, workers, address)
            RayWorkers._ours = 1
        elif RayWorkers._ours:
            RayWorkers._ours += 1
        self._ends = RayWorkers._ours > 0
        free = int(self._ray.available_resources().get("CPU", 0))
        if free < workers:  # the others would wait for ever
            self.stop()
            raise InvalidValueError(f"workers must be <= {free}, the number of cores that Ray has free, got {workers}")

    def start(self, recipe: bytes, indices: Sequence[int]) -> Worker:
        """Start a worker."""
        return RayWorker(self._ray, recipe, indices, {} if RayWorkers._ours else {"runtime_env": ray_environment()})

    def stop(self) -> None:
        """Stop Ray, unless it has other users."""
        RayWorkers._ours -= min(RayWorkers._ours, 1)
        if self._ends and not RayWorkers._ours:
            self._ray.shutdown()


class RayWorker(RemoteWorker):
    """Environments in a Ray actor."""

    def __init__(self, ray: Any, recipe: bytes, indices: Sequence[int], options: dict[str, Any]) -> None:
        self._ray = ray
        self._actor = ray.remote(num_cpus=1, **options)(_Actor).remote()
        self._promise = self._actor.make.remote(recipe, tuple(indices))
        self._replies: deque[Reply] = deque()

    def give(self, orders: Sequence[Order]) -> None:
        self._promise = self._actor.obey.remote(pickle.dumps(orders, protocol=5))

    def wait(self) -> None:
        if not self._replies:
            self._replies.extend(self._receive())

    def take(self) -> Reply:
        return self._replies.popleft()

    def end(self) -> None:
        if self._ray.is_initialized():
            self._ray.kill(self._actor)

    def _receive(self) -> Any:
        try:
            return pickle.loads(self._ray.get(self._promise))
        except self._ray.exceptions.RayError as error:
            raise WorkerDiedError(type(error).__name__) from None


class _Actor:
    """The other end. Contents are bytes: Ray's own arrays would be read-only."""

    def make(self, recipe: bytes, indices: Sequence[int]) -> bytes:
        limit_threads(1)
        try:
            self._group = EnvironmentGroup(recipe, indices)
            return pickle.dumps(self._group.describe(), protocol=5)
        except BaseException as error:  # of a user's environment or option, as SystemExit
            return pickle.dumps(failure(error))

    def obey(self, orders: bytes) -> bytes:
        return pickle.dumps([self._group.do(order) for order in pickle.loads(orders)], protocol=5)
