"""Episodes of each environment of a vector: their seeds, and which of them a reset begins."""

from __future__ import annotations

import difflib
from collections.abc import Mapping
from typing import Any, NamedTuple, Self

import numpy as np

from coopsim.envs.vector.environments import Transition
from coopsim.errors import InvalidValueError, UnknownNameError
from coopsim.support.rng import fresh_seed, require_seed, stream

MASK = "reset_mask"


class Episodes(NamedTuple):
    """Episodes of one environment; their seeds do not depend on workers.

    Attributes:
        env: index of the environment.
        seed: seed that `reset` was given; negative before the first.
        exact: `seed` is the first episode's own, as it was given for this environment alone.
        number: number of the next episode.
        observation: last observation; None before the first.
        over: none is running.
    """

    env: int
    seed: int
    exact: bool = False
    number: int = 0
    observation: Any = None
    over: bool = True

    @property
    def next_seed(self) -> int:
        """Seed of the next episode: drawn by seed, index and number."""
        if self.exact and self.number == 0:
            return self.seed
        return int(stream(self.seed, "vector", str(self.env), str(self.number)).integers(2**63))

    def after(self, transition: Transition, *, began: bool) -> Self:
        """Return the episodes after a step or a reset, which began another one or did not."""
        # The observation is not copied: at each step that would take longer than sending it does.
        return self._replace(number=self.number + began, observation=transition.observation, over=transition.over)


def first_episodes(seed: object, count: int) -> list[Episodes]:
    """Return the first episodes of all environments by one seed; None is a fresh one.

    Raises:
        InvalidValueError: `seed` is not accepted.
    """
    base = fresh_seed() if seed is None else seed
    require_vector_seed(base)
    return [Episodes(index, int(base)) for index in range(count)]  # type: ignore[call-overload]


def plan_episodes(seed: object, following: list[Episodes]) -> list[Episodes]:
    """Return the episodes that a reset begins.

    Args:
        seed: one for all, one or None for each environment, or None.
        following: where it is None, these.

    Raises:
        InvalidValueError: a seed is not accepted, or there are fewer or more than environments.
    """
    if seed is None:
        return following
    if not isinstance(seed, (list, tuple, np.ndarray)):
        return first_episodes(seed, len(following))
    if len(seed) != len(following):
        raise InvalidValueError(f"seed must have one entry for each of {len(following)} environments, got {len(seed)}")
    for each in seed:
        if each is not None:
            require_vector_seed(each)
    pairs = zip(following, seed, strict=True)
    return [after if each is None else Episodes(after.env, int(each), exact=True) for after, each in pairs]


def require_vector_seed(seed: object) -> None:
    """Raise `InvalidValueError` unless `seed` is an integer >= 0 that all kinds of environments can take."""
    require_seed(seed)
    if int(seed) >= 2**63:  # type: ignore[call-overload]
        raise InvalidValueError(f"seed must be < 2**63 in a vector, got {seed}")


def read_options(options: object, count: int) -> tuple[list[int], dict[str, Any]]:
    """Return the environments that options of `reset` choose by `reset_mask`, and the other options.

    Raises:
        InvalidValueError: the options or the mask are not accepted.
        UnknownNameError: an option is nearly `reset_mask`.
    """
    if options is not None and not isinstance(options, Mapping):
        raise InvalidValueError(f"options of reset must be a mapping, got {options!r}")
    given = dict(options or {})
    for name in given:
        if name != MASK and difflib.get_close_matches(str(name), [MASK], cutoff=0.75):
            raise UnknownNameError("option of reset", name, [MASK])
    mask: Any = given.pop(MASK, None)
    if mask is None:
        return list(range(count)), given
    if not (isinstance(mask, np.ndarray) and mask.dtype == np.bool_ and mask.shape == (count,) and mask.any()):
        raise InvalidValueError(f"{MASK} must be an array ({count},) of bool with at least one True, got {mask!r}")
    return np.flatnonzero(mask).tolist(), given
