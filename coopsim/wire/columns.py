"""Spaces that observations and actions share."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import Any, TypeVar

import numpy as np
from gymnasium import spaces

from coopsim.support.checks import require_choice

COUNTER = 2**62
"""Limit of counters (nanoseconds, ids): it fits an int64 and leaves room to add."""


def real_space(*shape: int, low: float = -np.inf, dtype: Any = np.float64) -> spaces.Box:
    """Return a space of arrays of this shape, bounded by `low` below."""
    return spaces.Box(low, np.inf, shape, dtype)


def rows_space(**columns: spaces.Space[Any]) -> spaces.Sequence:
    """Return a space of any number of rows, as a dict of stacked columns."""
    return spaces.Sequence(spaces.Dict(columns), stack=True)


def box_space() -> spaces.Box:
    """Return a new space of boxes: x, y, z, l, w, h, yaw; sizes are positive.

    A space is never shared: it would be seeded once for all its uses.
    """
    return spaces.Box(np.array([-np.inf] * 3 + [0.0] * 3 + [-np.inf]), np.full(7, np.inf), dtype=np.float64)


AgentSpace = TypeVar("AgentSpace")


def space_of(agent: str, by_agent: Mapping[str, AgentSpace]) -> AgentSpace:
    """Return an agent's space.

    Raises:
        UnknownNameError: there is no such agent; the message lists those that there are.
    """
    try:
        return by_agent[agent]
    except (KeyError, TypeError):  # learners ask for spaces in every step: a name that is there costs no check
        require_choice("agent", agent, by_agent)
        raise


class LaterSpaces:
    """Spaces of agents, each made when it is first asked for.

    Most episodes of policies ask for none, and to make all took a twelfth of a short one.
    """

    def __init__(self, agents: Iterable[str], make: Callable[[str], spaces.Dict]) -> None:
        self._made: dict[str, spaces.Dict | None] = dict.fromkeys(agents)
        self._make = make

    def of(self, agent: str) -> spaces.Dict:
        """Return an agent's space, always the same object; see `space_of` for other names."""
        made = space_of(agent, self._made)
        if made is None:
            made = self._made[agent] = self._make(agent)
        return made
