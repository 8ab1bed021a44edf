"""Ids that outlast a tracker's own: through replays of the same moments, and between agents."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np

from coopsim.geometry.assignment import nearest_pairs
from coopsim.geometry.iou import center_distance_bev
from coopsim.types import NS_PER_S, Ints, Tracks

_SAME_M = 2.0
"""Greatest distance over ground of two tracks of one object at one moment."""

_MEMORY_NS = 60 * NS_PER_S


class LastingIds:
    """Ids under which tracks were first reported; they count from 1 and are never used twice."""

    def __init__(self) -> None:
        self._next = 1
        self._ids: dict[int, tuple[int, int]] = {}  # by the tracker's id: the reported one, and when last
        self._reported = Tracks.empty()

    def forget(self, ids: Iterable[int]) -> None:
        """Forget tracks, by the tracker's ids, that it may now give to other objects."""
        for each in ids:
            self._ids.pop(each, None)

    def carry_over(self, again: Tracks, time_ns: int) -> None:
        """Give tracks that are new to their tracker the ids of the same objects in the last report.

        `again` are the tracks of the last report's time, after the tracker has tracked it again.
        """
        new = again[np.array([each not in self._ids for each in again.id.tolist()], dtype=np.bool_)]
        kept = [reported for reported, _ in self._ids.values()]
        lost = self._reported[~np.isin(self._reported.id, kept)]
        apart_m = -center_distance_bev(lost.boxes.array, new.boxes.array)
        apart_m[np.not_equal.outer(lost.label, new.label)] = np.inf
        for row, column in zip(*nearest_pairs(apart_m, _SAME_M), strict=True):
            self._ids[int(new.id[column])] = int(lost.id[row]), time_ns

    def name(self, tracks: Tracks, time_ns: int) -> Tracks:
        """Return tracks under their lasting ids."""
        self._ids = {each: known for each, known in self._ids.items() if known[1] >= time_ns - _MEMORY_NS}
        self._reported = replace(tracks, id=self._named(tracks.id, time_ns))
        return self._reported

    def _named(self, ids: Ints, time_ns: int) -> Ints:
        for each in ids.tolist():
            known = self._ids.get(each)
            self._ids[each] = (self._next if known is None else known[0]), time_ns
            self._next += known is None
        return np.array([self._ids[each][0] for each in ids.tolist()], dtype=np.int64)


_UNKNOWN = np.iinfo(np.int64).max
_LOCAL_BITS = 40  # of a key; the rest is the number of the agent

ABSENT = -1
"""An agent's id for an object that it does not track."""


class PublicIds:
    """Public ids of objects that several agents track, each under its own id, by all the (agent, id) pairs.

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
