"""Contents that are taken apart and put together again are the same."""

from __future__ import annotations

import pickle
from typing import Any

import numpy as np
import pytest

from coopsim.envs.vector.contents import arrays_from, parts_of, put_together, taken_apart
from coopsim.envs.vector.group import Order, Transition


def returned(content: Any) -> Any:
    skeleton, arrays = taken_apart(content)
    shapes, small, large = parts_of(arrays)
    joined = b"".join(large)
    skeleton, shapes = pickle.loads(pickle.dumps((skeleton, shapes), protocol=5))
    return put_together(skeleton, arrays_from(shapes, memoryview(small), memoryview(joined)))


def assert_alike(one: Any, other: Any) -> None:
    assert type(one) is type(other)
    if isinstance(one, dict):
        assert list(one) == list(other)
        for key in one:
            assert_alike(one[key], other[key])
    elif isinstance(one, (list, tuple)):
        assert len(one) == len(other)
        for left, right in zip(one, other, strict=True):
            assert_alike(left, right)
    elif isinstance(one, np.ndarray):
        assert one.dtype == other.dtype and one.shape == other.shape
        np.testing.assert_array_equal(one, other)
    else:
        assert one == other


@pytest.mark.parametrize("code", [*"?bBhHiIlLefd", "F", "U3", "O", "M8[s]"])
def test_any_type_and_shape(code: str) -> None:
    numbers = np.arange(2 * 3 * 5).reshape(2, 3, 5)
    dtype = np.dtype(code)
    array = numbers.astype("i8").astype(dtype) if code != "O" else numbers.astype(object)
    contents = [array, array[:, :0], array[0, 0, 0], array[1, 2, 3:4].reshape(()), array.T, array[:, ::2], array[::-1]]
    assert_alike(contents, returned(contents))


def test_nested_contents_with_small_and_large_arrays() -> None:
    rng = np.random.default_rng(0)
    content = [
        Order(3, "step", ({"a": {"tracks": rng.random((4, 7)), "maneuver": 2}}, None)),
        Transition(
            {"a": {"points": rng.random((5000, 5)).astype("f4"), "odd": np.arange(3, dtype="u1"), "none": None}},
            {"a": 0.5},
            {},
            {},
            {"a": {"counts": {"tp": np.int64(3)}, "name": "x", "more": (np.zeros(2), [np.ones((0, 7))], ())}},
            over=False,
            final=(np.arange(10**5), {}),
        ),
        np.float64(2.5),
    ]
    got = returned(content)
    assert_alike(content, got)
    assert isinstance(content[1].observation["a"]["odd"], np.ndarray)  # the sender's is as it was
    received = got[1].observation["a"]
    for array in (received["points"], received["odd"], got[0].arguments[0]["a"]["tracks"]):
        assert array.flags.writeable and array.flags.aligned and array.flags.c_contiguous
    assert not np.shares_memory(received["points"], received["odd"])
