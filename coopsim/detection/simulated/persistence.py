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
        known = self._known
        owner, place, drawn = _draw(
            self._keys, self._frame, self._count, asked, start, ids, wanted, known.start, known.ids
        )
        ndtri(drawn, out=drawn)
        constant, lasting, mixed = _carry(
            owner, place, drawn, wanted, known.constant, known.lasting, self._kept, self._fresh, self._weights
        )
        self._known = known.replaced(asked, start, ids, constant, lasting)
        return mixed


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
        if len(asked) == len(self.start) - 1 and (asked == np.arange(len(asked))).all():
            return _Known(start, ids, constant, lasting)
        old, new = ((self.ids, self.constant, self.lasting), (ids, constant, lasting))
        parts = {k: [column[self.start[k] : self.start[k + 1]] for column in old] for k in range(len(self.start) - 1)}
        parts |= {k: [column[start[row] : start[row + 1]] for column in new] for row, k in enumerate(asked.tolist())}
        columns = [np.concatenate(column) for column in zip(*parts.values(), strict=True)]
        return _Known(np.cumsum([0, *(len(part[0]) for part in parts.values())]), *columns)


@njit(cache=True, nogil=True)
def _draw(
    keys: NDArray[np.uint64],
    frame: Ints,
    count: int,
    asked: Ints,
    start: Ints,
    ids: Ints,
    wanted: Ints,
    known_start: Ints,
    known: Ints,
) -> tuple[Ints, Ints, Floats]:
    """Draw the uniform numbers in (0, 1) of a frame: (N + N' + M, K), of `uniform_numbers`' 2 K columns.

    The first N rows are of all objects, the next N' of those that were not `known`, the last M of those `wanted`. Also
    returned are the owner (N,) of each object, and its row (N,) among those known of its owner; -1: it was not.
    """
    owner, place, found = np.empty(len(ids), np.int64), np.full(len(ids), -1), 0
    for row in range(len(asked)):
        first, end = known_start[asked[row]], known_start[asked[row] + 1]
        guess = first  # as the objects mostly come in the same order, each is looked for behind the one before
        for n in range(start[row], start[row + 1]):
            owner[n] = asked[row]
            for _ in range(first, end):
                guess = guess if guess < end else first
                guess += 1
                if known[guess - 1] == ids[n]:
                    place[n] = guess - 1
                    found += 1
                    break
    drawn = np.empty((2 * len(ids) - found + len(wanted), count))
    new = len(ids)
    for n in range(len(ids)):
        _fill(drawn[n], keys[owner[n]], ids[n], frame[owner[n]], 0)
        if place[n] < 0:
            _fill(drawn[new], keys[owner[n]], ids[n], 0, 0)
            new += 1
    for m in range(len(wanted)):
        n = wanted[m]
        _fill(drawn[new + m], keys[owner[n]], ids[n], frame[owner[n]], count)
    return owner, place, drawn


@njit(cache=True, nogil=True)
def _fill(drawn: Floats, key: np.uint64, identity: int, frame: int, first: int) -> None:
    """Fill in uniform numbers (K,) in (0, 1) of an object in a frame: of 2 K columns those from `first` on."""
    place = np.uint64(identity * _FRAMES + frame)
    for column in range(len(drawn)):
        drawn[column] = _TINY + uniform_at(key, place, np.uint64(2 * len(drawn)), np.uint64(first + column))


@njit(cache=True, nogil=True)
def _carry(
    owner: Ints,
    place: Ints,
    normal: Floats,
    wanted: Ints,
    old_constant: Floats,
    old_lasting: Floats,
    kept: Floats,
    fresh: Floats,
    weights: Floats,
) -> tuple[Floats, Floats, Floats]:
    """Return the constant and the autoregressive parts (N, K) in this frame, and the numbers (M, K) of those `wanted`.

    Rows of `normal` are as `_draw` has them, by now standard normal.
    """
    count = normal.shape[1]
    constant, lasting, mixed = (
        np.empty((len(owner), count)),
        np.empty((len(owner), count)),
        np.empty((len(wanted), count)),
    )
    new = len(owner)
    for n in range(len(owner)):
        if place[n] < 0:
            constant[n], lasting[n] = normal[new], normal[n]
            new += 1
            continue
        for k in range(count):
            constant[n, k] = old_constant[place[n], k]
            lasting[n, k] = kept[owner[n], k] * old_lasting[place[n], k] + fresh[owner[n], k] * normal[n, k]
    for m in range(len(wanted)):
        for k in range(count):
            parts = weights[0, k] * constant[wanted[m], k] + weights[1, k] * lasting[wanted[m], k]
            mixed[m, k] = parts + weights[2, k] * normal[new + m, k]
    return constant, lasting, mixed
