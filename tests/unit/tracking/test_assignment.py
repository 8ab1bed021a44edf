"""Matchings are optimal or greedy as named, and never cross a gate."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from coopsim.tracking.assignment import greedy, hungarian

shapes = st.tuples(st.integers(0, 6), st.integers(0, 6))
numbers = st.floats(-1, 1) | st.sampled_from([-np.inf, np.nan])
matrices = shapes.flatmap(lambda shape: arrays(np.float64, shape, elements=numbers))


@pytest.mark.parametrize("assign", [hungarian, greedy])
@given(affinity=matrices, gate=st.floats(-1, 1))
def test_one_to_one_and_above_the_gate(assign, affinity: np.ndarray, gate: float) -> None:  # type: ignore[no-untyped-def]
    rows, columns = assign(affinity, gate)
    assert len(set(rows)) == len(rows) == len(columns) == len(set(columns))
    assert (affinity[rows, columns] >= gate).all()
    assert np.isfinite(affinity[rows, columns]).all()


@given(affinity=shapes.flatmap(lambda shape: arrays(np.float64, shape, elements=st.floats(0, 1))))
def test_hungarian_finds_the_largest_sum(affinity: np.ndarray) -> None:
    rows, columns = hungarian(affinity, -2.0)
    wide = affinity if affinity.shape[0] <= affinity.shape[1] else affinity.T
    count = wide.shape[0]
    best = max(sum(wide[k, c] for k, c in enumerate(p)) for p in itertools.permutations(range(wide.shape[1]), count))
    np.testing.assert_allclose(affinity[rows, columns].sum(), best, atol=1e-9)


def test_greedy_takes_the_best_first() -> None:
    affinity = np.array([[0.9, 0.8], [0.85, 0.1]])
    assert list(zip(*greedy(affinity, 0.0), strict=True)) == [(0, 0), (1, 1)]
    assert sorted(zip(*hungarian(affinity, 0.0), strict=True)) == [(0, 1), (1, 0)]
