"""Errors that last: what their docstrings promise of distribution, time and independence."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from coopsim.detection.simulated.persistence import Persistence, PersistentNormals
from coopsim.errors import InvalidValueError

KIND = Persistence(constant=0.3, lasting=0.5, lasting_s=0.5)
WHITE = Persistence()


def walk(ids: np.ndarray, frames: int, *kinds: Persistence, seed: int = 0, owner: str = "cav_0") -> np.ndarray:
    """(F, N, K)."""
    normals = PersistentNormals(seed, owner, kinds or (KIND,), dt_s=0.1)
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
    one, other = (PersistentNormals(3, "rsu_0", (KIND, WHITE), 0.1) for _ in range(2))
    for present in frames:
        ids = np.array(sorted(present - {newcomer}), dtype=np.int64)
        crowd = np.append(ids[::-1], newcomer)
        np.testing.assert_array_equal(one.step(ids), other.step(crowd)[:-1][::-1])


def test_who_comes_back_has_its_constant_part_again() -> None:
    normals = PersistentNormals(0, "cav_0", (Persistence(1.0),), 0.1)
    ids = np.array([7, 9])
    before = normals.step(ids)
    normals.step(ids[:1])
    np.testing.assert_array_equal(normals.step(ids), before)


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
