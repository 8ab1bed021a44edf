"""Returns are counted by actor."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from coopsim.errors import InvalidValueError
from coopsim.sensors.lidar.returns import count_returns
from coopsim.types import Sweep


def sweep(returns: dict[int, int]) -> Sweep:
    instance = np.repeat(list(returns), list(returns.values())).astype(int)
    count = len(instance)
    return Sweep(np.zeros((count, 3)), np.zeros(count), np.zeros(count), instance)


def test_count_returns_by_id_over_sweeps() -> None:
    sweeps = {"a": sweep({9: 4, 0: 100, 77: 3, -1: 2}), "b": sweep({9: 1, 3: 2})}
    np.testing.assert_array_equal(count_returns(sweeps, np.array([9, 6, 3])), [5, 0, 2])
    assert count_returns(sweeps, np.zeros(0, dtype=int)).shape == (0,)


@given(ids=st.sets(st.integers(1, 2 * 10**9), max_size=20), seed=st.integers(0, 2**32 - 1))
def test_returns_are_counted_as_by_hand(ids: set[int], seed: int) -> None:
    rng = np.random.default_rng(seed)
    asked = rng.permutation(np.array(sorted(ids), dtype=int))
    instance = np.repeat(rng.choice([*ids, -1, 0, 7, 2 * 10**9 + 1], 50), rng.integers(0, 4, 50)).astype(int)
    count = len(instance)
    sweeps = {"lidar": Sweep(np.zeros((count, 3)), np.zeros(count), np.zeros(count), instance)}
    assert count_returns(sweeps, asked).tolist() == [instance.tolist().count(who) for who in asked]


def test_sweep_without_instances_is_refused() -> None:
    blind = Sweep(np.zeros((1, 3)), np.zeros(1), np.zeros(1))
    with pytest.raises(InvalidValueError, match="no instance ids"):
        count_returns({"lidar": blind}, np.array([1]))
