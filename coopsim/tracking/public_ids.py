"""Public ids: one id for an object that several agents track, each under its own id."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from coopsim.types import Ints

_UNKNOWN = np.iinfo(np.int64).max
_LOCAL_BITS = 40  # of a key; the rest is the number of the agent

ABSENT = -1
"""An agent's id for an object that it does not track."""


class PublicIds:
    """A memory of the public id of each object, by all its (agent, id) pairs.

    An object keeps its public id while any pair stays. Objects with different ids that turn out to be one go on under
    the oldest id; of an object that turns out to be two, the first in order keeps the id. Ids count from 1 and are
    never used twice.

    Args:
        memory_ns: time for which a pair is kept after its last use.
    """

    def __init__(self, memory_ns: int) -> None:
        self._memory_ns, self._next, self._next_agent = memory_ns, 1, 0
        self._agents: dict[str, int] = {}
        self._keys, self._public, self._used_ns = (np.zeros(0, dtype=np.int64) for _ in range(3))

    def __len__(self) -> int:
        """Return the number of remembered (agent, id) pairs."""
        return len(self._keys)

    def assign(self, agents: Sequence[str], members: Ints, now_ns: int) -> Ints:
        """Return the public ids (N,) of N objects, unique among them.

        Args:
            agents: A names.
            members: (N, A) each agent's id for each object, in 0..2^40 - 1, or `ABSENT`; unique per agent.
            now_ns: must not go back.
        """
        self._forget(now_ns - self._memory_ns)
        numbers = np.array([self._number(agent) for agent in agents], dtype=np.int64)
        keys = (numbers << _LOCAL_BITS) + members
        present = members != ABSENT
        public: Ints = np.where(present, self._known(keys), _UNKNOWN).min(axis=1, initial=_UNKNOWN)
        fresh = public == _UNKNOWN
        fresh |= ~np.isin(np.arange(len(public)), np.unique(public, return_index=True)[1])
        public[fresh] = self._next + np.arange(np.count_nonzero(fresh))
        self._next += int(np.count_nonzero(fresh))
        self._remember(keys[present], np.broadcast_to(public[:, None], keys.shape)[present], now_ns)
        return public

    def _number(self, agent: str) -> int:
        if agent not in self._agents:
            self._agents[agent] = self._next_agent
            self._next_agent += 1
        return self._agents[agent]

    def _known(self, keys: Ints) -> Ints:
        """Return the public ids last used for keys of any shape, or `_UNKNOWN`."""
        if not len(self._keys):
            return np.full(keys.shape, _UNKNOWN)
        at = np.minimum(np.searchsorted(self._keys, keys), len(self._keys) - 1)
        return np.where(self._keys[at] == keys, self._public[at], _UNKNOWN)

    def _remember(self, keys: Ints, public: Ints, now_ns: int) -> None:
        used_ns = np.full(len(keys), now_ns)
        # Of equal keys `unique` points to the first, which is the new one.
        self._keys, newest = np.unique(np.concatenate([keys, self._keys]), return_index=True)
        self._public = np.concatenate([public, self._public])[newest]
        self._used_ns = np.concatenate([used_ns, self._used_ns])[newest]

    def _forget(self, oldest_ns: int) -> None:
        recent = self._used_ns >= oldest_ns
        if recent.all():
            return
        self._keys, self._public, self._used_ns = self._keys[recent], self._public[recent], self._used_ns[recent]
        known = set((self._keys >> _LOCAL_BITS).tolist())
        self._agents = {agent: number for agent, number in self._agents.items() if number in known}
