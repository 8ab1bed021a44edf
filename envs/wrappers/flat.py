"""Flatten: all arrays of an observation, end to end."""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray
from pettingzoo import ParallelEnv
from pettingzoo.utils import BaseParallelWrapper

from coopsim.envs.wrappers.base_wrappers import AnySpace, ByAgent, ObservationForm, Stepped, cooperative_env, kind_of
from coopsim.errors import InvalidValueError

_PICTURE_AXES = 3


class FlatForm(ObservationForm):
    """All arrays as a single (N,) float32 array, in alphabetical order of names; a picture by itself stays one."""

    def space(self, inner: AnySpace) -> AnySpace:
        parts = [inner] if isinstance(inner, spaces.Box) else _parts(inner)
        if isinstance(inner, spaces.Box) and len(inner.shape) == _PICTURE_AXES:
            return spaces.Box(inner.low, inner.high, dtype=inner.dtype.type)
        low, high = ([getattr(part, side).reshape(-1) for part in parts] for side in ("low", "high"))
        return spaces.Box(np.concatenate(low, dtype=np.float32), np.concatenate(high, dtype=np.float32))

    def observe(self, agent: str, observation: Any) -> NDArray[Any]:
        if isinstance(observation, dict):
            return np.concatenate([observation[name].reshape(-1) for name in sorted(observation)], dtype=np.float32)
        picture: NDArray[Any] = observation
        return picture if picture.ndim == _PICTURE_AXES else picture.reshape(-1).astype(np.float32)


def _parts(space: AnySpace) -> list[spaces.Box]:
    """Return the boxes of a space, by the alphabetical order of their names."""
    parts = [space[name] for name in sorted(space.spaces)] if isinstance(space, spaces.Dict) else [space]
    boxes = [part for part in parts if isinstance(part, spaces.Box)]
    if len(boxes) < len(parts):
        raise InvalidValueError(
            f"env must be wrapped in FixedSize, DrivingRows or BevImage before Flatten: it has {kind_of(space)}"
        )
    return boxes


class WithoutInfos(BaseParallelWrapper[str, Any, Any]):  # type: ignore[misc]  # pettingzoo is untyped
    """The parallel environment with an empty info for each agent, as TorchRL's `PettingZooWrapper` needs it.

    Args:
        env: the environment; put this wrapper around all others.

    Raises:
        InvalidValueError: `env` is no parallel environment of coopsim's.
    """

    def __init__(self, env: ParallelEnv[str, Any, Any]) -> None:
        if isinstance(env, gymnasium.Env):
            raise InvalidValueError("env must be parallel: TorchRL's GymWrapper takes a single-agent one as it is")
        cooperative_env(env)
        super().__init__(env)

    def reset(
        self, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[ByAgent, dict[str, dict[str, Any]]]:
        """Begin an episode; see `CooperativeEnv.reset`."""
        observations, infos = self.env.reset(seed=seed, options=options)
        return observations, {name: {} for name in infos}

    def step(self, actions: ByAgent) -> Stepped:
        """Go to the next frame; see `CooperativeEnv.step`."""
        *stepped, infos = self.env.step(actions)
        return (*stepped, {name: {} for name in infos})
