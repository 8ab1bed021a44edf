"""Errors that persist: a detector errs about an object in the same way, frame after frame."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri

from coopsim.errors import InvalidValueError
from coopsim.geometry.se3 import Floats
from coopsim.support.checks import require_positive, require_probability
from coopsim.support.kernels import njit
from coopsim.support.rng import draw_key
from coopsim.types import Ints

_GOLDEN = np.uint64(0x9E3779B97F4A7C15)
_FIRST, _SECOND = np.uint64(0xBF58476D1CE4E5B9), np.uint64(0x94D049BB133111EB)
_30, _27, _31, _11, _1 = (np.uint64(bits) for bits in (30, 27, 31, 11, 1))


@njit(cache=True, nogil=True)
def uniform_at(key: np.uint64, owner: np.uint64, count: np.uint64, column: np.uint64) -> float:
    """Return the number of `uniform_numbers` in a column, for an owner with `count` of them, in compiled loops."""
    state = key + (owner * count + column + _1) * _GOLDEN
    mixed = (state ^ (state >> _30)) * _FIRST
    mixed = (mixed ^ (mixed >> _27)) * _SECOND
    mixed = mixed ^ (mixed >> _31)
    return np.float64(mixed >> _11) * 2.0**-53


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
    """Standard normal numbers for every object of each owner, correlated over time; asked once in each frame, in order.

    An object's numbers depend only on the seed, the owner (the name of a purpose and an agent), the object's id and the
    number of frames, so that one more object does not shift the others' numbers. An object that comes back after a
    pause has its constant part again. `dt_s` (A,) is the time between two frames of each of A owners.
    """

    def __init__(self, seed: int, owners: Sequence[str], kinds: Sequence[Persistence], dt_s: Sequence[float]) -> None:
        self._keys, self._count = np.array([draw_key(seed, owner) for owner in owners], np.uint64), len(kinds)
        constant = np.array([kind.constant for kind in kinds])
        lasting = np.array([kind.lasting for kind in kinds])
        self._weights = np.stack(
            [np.sqrt(constant), np.sqrt(lasting), np.sqrt(np.maximum(1 - constant - lasting, 0.0))]
        )
        kept = [[math.exp(-between_s / kind.lasting_s) for kind in kinds] for between_s in dt_s]
        self._kept = np.array(kept).reshape(-1, self._count)
        self._fresh = np.sqrt(1 - self._kept**2)
        self._frame = np.zeros(len(owners), np.int64)
        none = np.zeros((0, self._count))
        self._known = _Known(np.zeros(len(owners) + 1, np.int64), np.zeros(0, np.int64), none, none)

    def step(self, asked: Ints, start: Ints, ids: Ints, wanted: Ints) -> Floats:
        """Return this frame's numbers (M, K), standard normal, of the rows `wanted` (M,) of objects; the others' go on
        all the same.

        Args:
            asked: (B,) the owners whose frame it is, distinct indices.
            start: (B + 1,) first object of each in `ids`.
            ids: (N,) the objects, of one owner distinct ints in [0, 2^31).
            wanted: (M,) rows of the objects whose numbers are returned.
        """
        self._frame[asked] += 1
        ids = ids.copy()  # some are read-only, for which kernels would be compiled once more
        owner = np.repeat(asked, np.diff(start))
        frames, count = self._frame[owner], self._count
        place = _find(asked, start, ids, self._known.start, self._known.ids)
        walk = self._draw(owner, ids, frames, 0)
        constant = np.empty((len(ids), count))
        new = np.flatnonzero(place < 0)
        if len(new):
            constant[new] = self._draw(owner[new], ids[new], np.zeros(len(new), np.int64), 0)
        lasting = _carry(
            place, owner, walk, constant, self._known.constant, self._known.lasting, self._kept, self._fresh
        )
        self._known = self._known.replaced(asked, start, ids, constant, lasting)
        white = self._draw(owner[wanted], ids[wanted], frames[wanted], count)
        return _mix(self._weights, constant, lasting, wanted, white)

    def _draw(self, owner: Ints, ids: Ints, frame: Ints, first: int) -> Floats:
        """Draw the K of 2 K numbers from `first` on, for objects of a frame: (N, K), standard normal."""
        drawn = _uniform(self._keys, owner, ids, frame, self._count, first)
        normal: Floats = ndtri(drawn, out=drawn)
        return normal


@dataclass(frozen=True, slots=True, eq=False)
class _Known:
    """Objects (N,) of each owner's last frame, from its `start` (A + 1,) on, with constant and autoregressive parts (N,
    K).
    """

    start: Ints
    ids: Ints
    constant: Floats
    lasting: Floats

    def replaced(self, asked: Ints, start: Ints, ids: Ints, constant: Floats, lasting: Floats) -> _Known:
        """Return the objects with those of the owners `asked` replaced; arguments as of `PersistentNormals.step`."""
        if np.array_equal(asked, np.arange(len(self.start) - 1)):
            return _Known(start, ids, constant, lasting)
        old, new = ((self.ids, self.constant, self.lasting), (ids, constant, lasting))
        parts = {k: [column[self.start[k] : self.start[k + 1]] for column in old] for k in range(len(self.start) - 1)}
        parts |= {k: [column[start[row] : start[row + 1]] for column in new] for row, k in enumerate(asked.tolist())}
        columns = [np.concatenate(column) for column in zip(*parts.values(), strict=True)]
        return _Known(np.cumsum([0, *(len(part[0]) for part in parts.values())]), *columns)


@njit(cache=True, nogil=True)
def _find(asked: Ints, start: Ints, ids: Ints, known_start: Ints, known: Ints) -> Ints:
    """Return the rows (N,) of objects among those `known` of their owners; -1 for objects that are not."""
    place = np.full(len(ids), -1)
    for row in range(len(asked)):
        first, end = known_start[asked[row]], known_start[asked[row] + 1]
        guess = first  # as the objects mostly come in the same order, each is looked for behind the one before
        for n in range(start[row], start[row + 1]):
            for _ in range(first, end):
                guess = guess if guess < end else first
                guess += 1
                if known[guess - 1] == ids[n]:
                    place[n] = guess - 1
                    break
    return place


@njit(cache=True, nogil=True)
def _uniform(keys: NDArray[np.uint64], owner: Ints, ids: Ints, frame: Ints, count: int, first: int) -> Floats:
    """Return uniform numbers (N, K) in (0, 1): of `uniform_numbers`' 2 K columns those from `first` on."""
    drawn = np.empty((len(ids), count))
    for n in range(len(ids)):
        place = np.uint64(ids[n] * _FRAMES + frame[n])
        for column in range(count):
            drawn[n, column] = _TINY + uniform_at(
                keys[owner[n]], place, np.uint64(2 * count), np.uint64(first + column)
            )
    return drawn


@njit(cache=True, nogil=True)
def _carry(
    place: Ints,
    owner: Ints,
    walk: Floats,
    constant: Floats,
    old_constant: Floats,
    old_lasting: Floats,
    kept: Floats,
    fresh: Floats,
) -> Floats:
    """Return the autoregressive parts (N, K) in this frame; `constant` is filled where an object was known."""
    lasting = np.empty_like(walk)
    for n in range(len(place)):
        for k in range(walk.shape[1]):
            if place[n] < 0:
                lasting[n, k] = walk[n, k]
                continue
            before = old_lasting[place[n], k]
            constant[n, k] = old_constant[place[n], k]
            lasting[n, k] = kept[owner[n], k] * before + fresh[owner[n], k] * walk[n, k]
    return lasting


@njit(cache=True, nogil=True)
def _mix(weights: Floats, constant: Floats, lasting: Floats, wanted: Ints, white: Floats) -> Floats:
    """Return the weighted sums (M, K) of the three parts, of the rows `wanted` (M,)."""
    mixed = np.empty_like(white)
    for m in range(len(wanted)):
        for k in range(white.shape[1]):
            parts = weights[0, k] * constant[wanted[m], k] + weights[1, k] * lasting[wanted[m], k]
            mixed[m, k] = parts + weights[2, k] * white[m, k]
    return mixed
