"""Matchings are optimal or greedy as named, and never cross a gate."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.optimize import linear_sum_assignment

from coopsim.geometry.assignment import greedy, hungarian

shapes = st.tuples(st.integers(0, 6), st.integers(0, 6))
numbers = st.floats(-1, 1) | st.sampled_from([-np.inf, np.inf, np.nan])
# Few different numbers, so that many pairs are equally good.
grades = st.sampled_from([-np.inf, np.nan, -1.0, 0.0, 1.0])
matrices = shapes.flatmap(lambda shape: arrays(np.float64, shape, elements=numbers | grades))
gates = st.floats(-1, 1) | st.just(-np.inf)


def pairs(matched: tuple[np.ndarray, np.ndarray]) -> list[tuple[int, int]]:
    return list(zip(*(side.tolist() for side in matched), strict=True))


def one_by_one(affinity: np.ndarray, gate: float) -> list[tuple[int, int]]:
    """Greedy as it is defined: the best of what is left, again and again."""
    left = np.where(np.isfinite(affinity) & (affinity >= gate), affinity, -np.inf)
    taken = []
    while left.size and left.max() > -np.inf:
        row, column = np.unravel_index(np.argmax(left), left.shape)
        taken.append((int(row), int(column)))
        left[row] = left[:, column] = -np.inf
    return taken


@pytest.mark.parametrize("assign", [hungarian, greedy])
@given(affinity=matrices, gate=gates)
def test_one_to_one_and_above_the_gate(assign, affinity: np.ndarray, gate: float) -> None:  # type: ignore[no-untyped-def]
    before = affinity.copy()
    rows, columns = assign(affinity, gate)
    assert rows.dtype == columns.dtype == np.int64
    assert len(set(rows)) == len(rows) == len(columns) == len(set(columns))
    assert (affinity[rows, columns] >= gate).all()
    assert np.isfinite(affinity[rows, columns]).all()
    np.testing.assert_array_equal(affinity, before)


@pytest.mark.parametrize("assign", [hungarian, greedy])
@pytest.mark.parametrize("shape", [(0, 0), (0, 3), (3, 0), (3, 2), (200, 300)])
@pytest.mark.parametrize("impossible", [-np.inf, np.nan])
def test_nothing_possible_matches_nothing(assign, shape: tuple[int, int], impossible: float) -> None:  # type: ignore[no-untyped-def]
    assert pairs(assign(np.full(shape, impossible), -np.inf)) == []


@pytest.mark.parametrize("assign", [hungarian, greedy])
def test_a_row_without_possible_pairs_stays_alone(assign) -> None:  # type: ignore[no-untyped-def]
    affinity = np.array([[-np.inf, -np.inf], [np.nan, 0.5], [0.2, np.nan]])
    assert sorted(pairs(assign(affinity, 0.0))) == [(1, 1), (2, 0)]


@given(affinity=shapes.flatmap(lambda shape: arrays(np.float64, shape, elements=st.floats(0, 1))))
def test_hungarian_finds_the_largest_sum(affinity: np.ndarray) -> None:
    rows, columns = hungarian(affinity, -2.0)
    wide = affinity if affinity.shape[0] <= affinity.shape[1] else affinity.T
    count = wide.shape[0]
    best = max(sum(wide[k, c] for k, c in enumerate(p)) for p in itertools.permutations(range(wide.shape[1]), count))
    np.testing.assert_allclose(affinity[rows, columns].sum(), best, atol=1e-9)


@pytest.mark.parametrize("levels", [3, 10**9], ids=["many ties", "no ties"])
@pytest.mark.parametrize("shape", [(150, 200), (200, 150)])
def test_hungarian_of_many_mostly_impossible_pairs(shape: tuple[int, int], levels: int) -> None:
    """Large sparse matrices take another solver, which must find as good a matching."""
    rng = np.random.default_rng(levels)
    value = rng.integers(-levels, levels + 1, shape) / levels
    for share in (0.002, 0.01, 0.09):
        affinity = np.where(rng.random(shape) < share, value, -np.inf)
        rows, columns = hungarian(affinity, -np.inf)
        expected = linear_sum_assignment(np.where(np.isfinite(affinity), affinity, -1e4), maximize=True)
        best = affinity[expected]
        assert len(set(rows)) == len(rows) == len(set(columns)) == np.isfinite(best).sum()
        np.testing.assert_allclose(affinity[rows, columns].sum(), best[np.isfinite(best)].sum())
        assert (affinity[hungarian(affinity, 0.5)] >= 0.5).all()


def test_greedy_takes_the_best_first() -> None:
    affinity = np.array([[0.9, 0.8], [0.85, 0.1]])
    assert pairs(greedy(affinity, 0.0)) == [(0, 0), (1, 1)]
    assert sorted(pairs(hungarian(affinity, 0.0))) == [(0, 1), (1, 0)]


@given(affinity=matrices, gate=gates)
def test_greedy_is_what_its_name_says(affinity: np.ndarray, gate: float) -> None:
    assert pairs(greedy(affinity, gate)) == one_by_one(affinity, gate)


def test_greedy_of_many_is_what_its_name_says() -> None:
    rng = np.random.default_rng(0)
    common = rng.random(120)[:, None] + rng.random(150)  # all rows agree on which column is best
    for affinity in (rng.random((120, 150)), rng.integers(0, 4, (120, 150)).astype(float), common):
        assert pairs(greedy(affinity, 0.1)) == one_by_one(affinity, 0.1)
