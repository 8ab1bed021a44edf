"""Clips made ahead by Ray, on this machine or on many."""

from __future__ import annotations

from typing import Any, Self

from coopsim.learn.clips.clip import Clip
from coopsim.learn.clips.clip_store import ClipSource
from coopsim.support.ray_cluster import import_ray, ray_environment, start_ray


class ClipsOnRay:
    """The clips of a source, made ahead by Ray tasks for one who asks for one after the other.

    A Ray that the caller has started is used, and left running. Every machine needs coopsim.

    Args:
        source: of the clips; picklable.
        ahead: clips that are made ahead.

    Raises:
        MissingDependencyError: Ray is not installed.
        InvalidValueError: there is no cluster at `RAY_ADDRESS`.
    """

    def __init__(self, source: ClipSource, ahead: int) -> None:
        self._ray = import_ray()
        self._ours = not self._ray.is_initialized()
        if self._ours:
            start_ray(self._ray, None, None)
        environment = {} if self._ours else {"runtime_env": ray_environment()}
        self._make = self._ray.remote(num_cpus=1, **environment)(_clip)
        self._source, self._ahead = self._ray.put(source), ahead
        self._coming: dict[int, Any] = {}

    def clip(self, index: int) -> Clip:
        """Return a clip, and have the next ones made."""
        for each in [each for each in self._coming if not index <= each < index + self._ahead]:
            self._ray.cancel(self._coming.pop(each))
        for each in range(index, index + self._ahead):
            if each not in self._coming:
                self._coming[each] = self._make.remote(self._source, each)
        clip: Clip = self._ray.get(self._coming.pop(index))
        return clip

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exception: object) -> None:
        for each in self._coming.values():
            self._ray.cancel(each)
        if self._ours:
            self._ray.shutdown()


def _clip(source: ClipSource, index: int) -> Clip:
    return source.clip(index)
