"""Errors that last: what their docstrings promise of distribution, time and independence."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.special import ndtri

from coopsim.detection.simulated.persistence import Persistence, PersistentNormals
from coopsim.errors import InvalidValueError
from coopsim.support.rng import uniform_numbers

KIND = Persistence(constant=0.3, lasting=0.5, lasting_s=0.5)
WHITE = Persistence()


class OneOwner:
    """The numbers of one owner."""

    def __init__(self, seed: int, owner: str, kinds: tuple[Persistence, ...]) -> None:
        self._normals = PersistentNormals(seed, [owner], kinds, [0.1])

    def step(self, ids: np.ndarray) -> np.ndarray:
        return self._normals.step(np.zeros(1, np.int64), np.array([0, len(ids)]), ids, np.arange(len(ids)))


def walk(ids: np.ndarray, frames: int, *kinds: Persistence, seed: int = 0, owner: str = "cav_0") -> np.ndarray:
    """(F, N, K)."""
    normals = OneOwner(seed, owner, kinds or (KIND,))
    return np.stack([normals.step(ids) for _ in range(frames)])


def test_numbers_are_standard_normal_in_every_frame() -> None:
    last = walk(np.arange(20_000), 6)[-1, :, 0]
    assert last.mean() == pytest.approx(0, abs=0.03) and last.std() == pytest.approx(1, abs=0.02)
    assert (np.abs(last) < 1.96).mean() == pytest.approx(0.95, abs=0.01)


@pytest.mark.parametrize("kind", [KIND, WHITE, Persistence(1.0), Persistence(0.0, 1.0, 2.0)])
def test_autocorrelation_is_as_documented(kind: Persistence) -> None:
    course = walk(np.arange(20_000), 12, kind)[..., 0]
    for lag in (1, 4, 10):
        measured = np.mean(course[-1] * course[-1 - lag])
        expected = kind.constant + kind.lasting * np.exp(-0.1 * lag / kind.lasting_s)
        assert measured == pytest.approx(expected, abs=0.03)


def test_kinds_objects_owners_and_seeds_are_independent() -> None:
    ids = np.arange(20_000)
    course = walk(ids, 2, KIND, KIND)[-1]
    others = [walk(ids, 2, KIND, KIND, owner="cav_1"), walk(ids, 2, KIND, KIND, seed=1)]
    columns = [course[:, 0], course[:, 1], np.roll(course[:, 0], 1), *(other[-1][:, 0] for other in others)]
    np.testing.assert_allclose(np.corrcoef(columns), np.eye(len(columns)), atol=0.03)


@settings(max_examples=30)
@given(st.lists(st.sets(st.integers(0, 2**31 - 1), max_size=6), min_size=1, max_size=5), st.integers(0, 2**31 - 1))
def test_one_more_object_and_another_order_shift_nobody(frames: list[set[int]], newcomer: int) -> None:
    one, other = (OneOwner(3, "rsu_0", (KIND, WHITE)) for _ in range(2))
    for present in frames:
        ids = np.array(sorted(present - {newcomer}), dtype=np.int64)
        crowd = np.append(ids[::-1], newcomer)
        np.testing.assert_array_equal(one.step(ids), other.step(crowd)[:-1][::-1])


def test_who_comes_back_has_its_constant_part_again() -> None:
    normals = OneOwner(0, "cav_0", (Persistence(1.0),))
    ids = np.array([7, 9])
    before = normals.step(ids)
    normals.step(ids[:1])
    np.testing.assert_array_equal(normals.step(ids), before)


def slow_step(
    frame: int, ids: np.ndarray, before: dict[int, np.ndarray], seed: int, owner: str, kinds: tuple[Persistence, ...]
) -> np.ndarray:
    """One frame of one owner as the docstrings say it, object by object; `before` is the last frame's walk."""
    rows, walked = [], {}
    for each in ids.tolist():
        drawn, first = (
            ndtri(uniform_numbers(seed, owner, np.array([each * 2**32 + k]), 2 * len(kinds))[0] + 2.0**-54)
            for k in (frame, 0)
        )
        fresh, white = drawn[: len(kinds)], drawn[len(kinds) :]
        kept = np.array([math.exp(-0.1 / kind.lasting_s) for kind in kinds])
        walked[each] = kept * before[each] + np.sqrt(1 - kept**2) * fresh if each in before else fresh
        parts = np.array([[kind.constant, kind.lasting, 1 - kind.constant - kind.lasting] for kind in kinds]).T
        by_constant, by_lasting, by_white = np.sqrt(np.maximum(parts, 0.0))
        rows.append(by_constant * first[: len(kinds)] + by_lasting * walked[each] + by_white * white)
    before.clear()
    before.update(walked)
    return np.array(rows).reshape(-1, len(kinds))


def test_owners_are_stepped_together_or_apart_with_the_same_bits() -> None:
    rng, kinds, owners = np.random.default_rng(0), (KIND, WHITE), ["a", "b", "c"]
    normals = PersistentNormals(5, owners, kinds, [0.1] * 3)
    frames, walks = [0, 0, 0], [{}, {}, {}]
    for asked in ([0, 1, 2], [0, 1, 2], [1], [2, 0], [0, 1, 2], [2, 1, 0]):
        ids = [rng.permutation(12)[: rng.integers(0, 9)] + 1 for _ in asked]
        start = np.cumsum([0, *map(len, ids)])
        wanted = np.flatnonzero(rng.random(start[-1]) < 0.6)
        got = normals.step(np.array(asked), start, np.concatenate(ids), wanted)
        want = []
        for k, present in zip(asked, ids, strict=True):
            frames[k] += 1
            want.append(slow_step(frames[k], present, walks[k], 5, owners[k], kinds))
        np.testing.assert_array_equal(got, np.concatenate(want)[wanted])


@pytest.mark.parametrize(
    ("parts", "match"),
    [
        ((1.1, 0.0, 1.0), r"constant must be in \[0, 1\]"),
        ((0.0, -0.1, 1.0), r"lasting must be in \[0, 1\]"),
        ((0.6, 0.6, 1.0), "at most 1 together"),
        ((0.0, 0.5, 0.0), "lasting_s must be a finite number > 0"),
    ],
)
def test_bad_shares(parts: tuple[float, float, float], match: str) -> None:
    with pytest.raises(InvalidValueError, match=match):
        Persistence(*parts)
