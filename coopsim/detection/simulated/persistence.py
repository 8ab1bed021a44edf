"""Errors that persist: a detector errs about an object in the same way, frame after frame."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.special import ndtri

from coopsim.errors import InvalidValueError
from coopsim.geometry.se3 import Floats
from coopsim.support.arrays import look_up
from coopsim.support.checks import require_positive, require_probability
from coopsim.support.rng import uniform_draws
from coopsim.types import Ints

_FRAMES = 2**32  # so many per object before two would share a draw
_TINY = 2.0**-54  # keeps a draw of 0 from being infinitely far out


@dataclass(frozen=True, slots=True)
class Persistence:
    """Correlation over time of an error that is a standard normal number in every frame, for one agent and object.

    The number is the sum of a constant, a first-order autoregressive process and white noise. Its autocorrelation after
    the time t > 0 is `constant` + `lasting` * exp(-t / `lasting_s`).

    Attributes:
        constant: share of the variance that never changes, in [0, 1].
        lasting: share of the autoregressive part, in [0, 1]; the rest of the variance is white.
        lasting_s: time in which the autoregressive part loses its correlation to 1/e.
    """

    constant: float = 0.0
    lasting: float = 0.0
    lasting_s: float = 1.0

    def __post_init__(self) -> None:
        require_probability(constant=self.constant, lasting=self.lasting)
        require_positive(lasting_s=self.lasting_s)
        if self.constant + self.lasting > 1:
            raise InvalidValueError(
                f"constant and lasting must be at most 1 together, got {self.constant!r} and {self.lasting!r}"
            )


class PersistentNormals:
    """Standard normal numbers for every object, correlated over time; asked once in each frame, in order.

    An object's numbers depend only on the seed, the owner, the object's id and the number of frames, so that one more
    object does not shift the others' numbers. An object that comes back after a pause has its constant part again.

    Args:
        seed: the episode's seed.
        owner: name of the purpose and the agent that the numbers are for.
        kinds: K, the persistence of each number.
        dt_s: time between two frames.
    """

    def __init__(self, seed: int, owner: str, kinds: tuple[Persistence, ...], dt_s: float) -> None:
        self._seed, self._owner, self._count = seed, owner, len(kinds)
        constant = np.array([kind.constant for kind in kinds])
        lasting = np.array([kind.lasting for kind in kinds])
        self._weights = np.sqrt(constant), np.sqrt(lasting), np.sqrt(np.maximum(1 - constant - lasting, 0.0))
        self._kept = np.array([math.exp(-dt_s / kind.lasting_s) for kind in kinds])
        self._fresh = np.sqrt(1 - self._kept**2)
        self._frame = 0
        self._ids = np.zeros(0, dtype=np.int64)
        self._constant, self._lasting = (np.zeros((0, self._count)) for _ in range(2))

    def step(self, ids: Ints) -> Floats:
        """Return this frame's numbers (N, K) for the objects `ids` (N,), distinct ints in [0, 2^31)."""
        self._frame += 1
        drawn = self._draw(ids, self._frame)
        walk, white = drawn[:, : self._count], drawn[:, self._count :]
        place, known = look_up(self._ids, ids)
        constant, lasting = np.empty_like(walk), np.empty_like(walk)
        constant[known] = self._constant[place[known]]
        lasting[known] = self._kept * self._lasting[place[known]] + self._fresh * walk[known]
        if not known.all():
            constant[~known] = self._draw(ids[~known], 0)[:, : self._count]
            lasting[~known] = walk[~known]
        order = np.argsort(ids)
        self._ids, self._constant, self._lasting = ids[order], constant[order], lasting[order]
        by_constant, by_lasting, by_white = self._weights
        normals: Floats = by_constant * constant + by_lasting * lasting + by_white * white
        return normals

    def _draw(self, ids: Ints, frame: int) -> Floats:
        drawn: Floats = ndtri(uniform_draws(self._seed, self._owner, ids * _FRAMES + frame, 2 * self._count) + _TINY)
        return drawn
