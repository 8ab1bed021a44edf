"""WithoutInfos: infos that are empty, for libraries that take numbers of the same names in every frame alone."""

from __future__ import annotations

from typing import Any

import gymnasium
from pettingzoo import ParallelEnv
from pettingzoo.utils import BaseParallelWrapper

from coopsim.envs.wrappers.forms import cooperative_env
from coopsim.envs.wrappers.parallel_wrappers import ByAgent, Stepped
from coopsim.errors import InvalidValueError


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
