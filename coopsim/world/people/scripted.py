"""Scripted people, who walk their paths whatever comes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from coopsim.geometry import exact
from coopsim.geometry.se3 import Floats
from coopsim.support.rng import stream
from coopsim.world.models.catalogue import draw_models, models_of
from coopsim.world.models.model import Model
from coopsim.world.script import WalkRole


class ScriptedPeople:
    """N people of a script; their attributes are those of `coopsim.world.people.people.People`.

    Args:
        roles: N of them.
        models: shapes to choose from.
        seed: seed of the episode.
    """

    def __init__(self, roles: Sequence[WalkRole], models: Sequence[Model], seed: int) -> None:
        self._roles, self._time_s = roles, 0.0
        self._reached_m = [np.append(0.0, np.cumsum(exact.norm(np.diff(each.path, axis=0), axis=1))) for each in roles]
        self.model = np.array(
            [
                draw_models(stream(seed, "scripted person", str(k)), models, models_of(models, role.label), 1)[0]
                for k, role in enumerate(roles)
            ],
            dtype=np.int64,
        )
        self._size_m = np.array([models[k].size_m[:2] for k in self.model]).reshape(-1, 2)
        self.travelled_m = self._walked_m()
        self.position, self.yaw = self._place()
        speed = np.array([role.speed_m_s * (role.starts_s <= 0) for role in roles])
        self.velocity = speed[:, None] * np.column_stack([exact.cos(self.yaw), exact.sin(self.yaw)])

    def __len__(self) -> int:
        return len(self._roles)

    def describe(self, bodies: NDArray[Any]) -> None:
        """Fill bodies (N,) `BODY` that are zero, as vehicles see them."""
        bodies["x"], bodies["y"] = self.position[:, 0], self.position[:, 1]
        bodies["heading"], bodies["speed"] = self.yaw, exact.norm(self.velocity, axis=1)
        bodies["length"], bodies["width"] = self._size_m.T

    def step(self, dt_s: float) -> None:
        """Advance by `dt_s`."""
        if not len(self):
            return
        self._time_s += dt_s
        before = self.position
        self.travelled_m = self._walked_m()
        self.position, self.yaw = self._place()
        self.velocity = (self.position - before) / dt_s

    def _walked_m(self) -> Floats:
        """Return how far people have walked (N,), m."""
        walked = np.array([role.speed_m_s * (self._time_s - role.starts_s) for role in self._roles])
        limited: Floats = np.clip(walked, 0.0, np.array([reached[-1] for reached in self._reached_m]))
        return limited

    def _place(self) -> tuple[Floats, Floats]:
        """Return where people are (N, 2) m and where they face (N,) rad, by how far they have walked."""
        position, yaw = np.zeros((len(self), 2)), np.zeros(len(self))
        for k, (role, reached_m) in enumerate(zip(self._roles, self._reached_m, strict=True)):
            walked_m = self.travelled_m[k]
            piece = min(int(np.searchsorted(reached_m, walked_m, side="right")), len(reached_m) - 1) - 1
            start, end = role.path[piece], role.path[piece + 1]
            share = (walked_m - reached_m[piece]) / (reached_m[piece + 1] - reached_m[piece])
            position[k] = start + share * (end - start)
            yaw[k] = exact.arctan2(*(end - start)[::-1])
        return position, yaw
