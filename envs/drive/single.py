"""`coopsim/drive-v1` for one car: gymnasium's API."""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np
from numpy.typing import NDArray

from coopsim.envs.drive.observation import Observed
from coopsim.envs.drive.parallel import DriveParallel
from coopsim.errors import InvalidValueError
from coopsim.support.rng import require_seed

EGO = "cav_0"


class DriveEnv(gymnasium.Env[Observed, Observed]):
    """Environment of one car that is steered along a route through traffic; `DriveParallel` describes it.

    `reset` without a seed draws the next episode's seed from `np_random`.

    Attributes:
        parallel: the environment around the same world.

    Args:
        **options: options of `DriveParallel`, except `cars`.
    """

    metadata: dict[str, Any] = DriveParallel.metadata

    def __init__(self, **options: Any) -> None:
        if options.get("cars", 1) != 1:
            raise InvalidValueError(f"cars must be 1 in gymnasium's API, got {options['cars']!r}: use DriveParallel")
        self.parallel = DriveParallel(**options)
        self.render_mode = self.parallel.render_mode
        self.metadata = self.parallel.metadata
        self.observation_space = self.parallel.observation_space(EGO)
        self.action_space = self.parallel.action_space(EGO)

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Observed, Any]:
        """Begin an episode; return the observation and the infos, which have the episode's `seed`."""
        if seed is not None:
            require_seed(seed)
        super().reset(seed=seed)
        of_episode = int(self.np_random.integers(2**32)) if seed is None else int(seed)
        observations, infos = self.parallel.reset(of_episode)
        return observations[EGO], infos[EGO]

    def step(self, action: Any) -> tuple[Observed, float, bool, bool, dict[str, Any]]:
        """Drive for a step; see `DriveParallel.step`."""
        seen, rewards, terminated, truncated, infos = self.parallel.step({EGO: action})
        return seen[EGO], rewards[EGO], terminated[EGO], truncated[EGO], infos[EGO]

    def render(self) -> NDArray[np.uint8] | None:
        """Draw the world from above; see `DriveParallel.render`."""
        return self.parallel.render()

    def close(self) -> None:
        """Close the window."""
        self.parallel.close()
