"""The seeds of an environment's episodes in a vector."""

from __future__ import annotations

from typing import NamedTuple, Self

from coopsim.support.rng import stream


class Course(NamedTuple):
    """Where an environment of a vector is in its course of episodes; their seeds do not depend on workers.

    Attributes:
        env: index of the environment.
        seed: that `reset` was given.
        exact: the first episode's seed is `seed` itself, which was given for this environment alone.
        episode: number of the next episode.
    """

    env: int
    seed: int
    exact: bool = False
    episode: int = 0

    @property
    def next_seed(self) -> int:
        """Seed of the next episode: a named stream's, by seed, index and episode."""
        if self.exact and self.episode == 0:
            return self.seed
        return int(stream(self.seed, "vector", str(self.env), str(self.episode)).integers(2**63))

    @property
    def advanced(self) -> Self:
        """The course when the next episode has begun."""
        return self._replace(episode=self.episode + 1)
