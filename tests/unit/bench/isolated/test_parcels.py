"""Plain data come back as they were, and foreign bytes raise one error."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import array_shapes, arrays

from coopsim.bench.isolated.parcels import pack_parcel, unpack_parcel
from coopsim.errors import InvalidValueError

NUMBERS = st.sampled_from([np.bool_, np.uint8, np.int64, np.float32, np.float64])
LEAVES = st.none() | st.booleans() | st.integers() | st.text() | st.floats(allow_nan=False)
PLAIN = st.recursive(
    LEAVES | arrays(NUMBERS, array_shapes(min_dims=0, min_side=0)),
    lambda part: st.lists(part, max_size=4) | st.dictionaries(st.text(), part, max_size=4),
    max_leaves=12,
)


def require_equal(one: Any, other: Any) -> None:
    assert type(one) is type(other) or np.isscalar(one)
    if isinstance(one, np.ndarray):
        assert one.dtype == other.dtype
        np.testing.assert_array_equal(one, other)
    elif isinstance(one, dict):
        assert list(one) == list(other)
        for key, value in one.items():
            require_equal(value, other[key])
    elif isinstance(one, list):
        assert len(one) == len(other)
        for a, b in zip(one, other, strict=True):
            require_equal(a, b)
    else:
        assert one == other


@given(PLAIN)
def test_plain_data_come_back(content: object) -> None:
    require_equal(content, unpack_parcel(pack_parcel(content)))


@given(PLAIN, st.data())
def test_damaged_parcels_are_plain_data_or_one_error(content: object, data: st.DataObject) -> None:
    parcel = bytearray(pack_parcel(content))
    place = data.draw(st.integers(0, len(parcel) - 1))
    parcel[place] = data.draw(st.integers(0, 255))
    for damaged in (bytes(parcel), bytes(parcel[:place])):
        try:
            unpack_parcel(damaged)
        except InvalidValueError:
            continue


@pytest.mark.parametrize(
    "header",
    [
        b'{"array": ["|O", [1], 0]}',
        b'{"array": ["<f8", [1099511627776], 0]}',
        b'{"array": ["<f8", [-1], 0]}',
        b'{"array": ["<f8", [1], -8]}',
        b'{"dict": 3}',
        b"[" * 100_000,
        b"",
    ],
)
def test_what_is_no_parcel_is_refused(header: bytes) -> None:
    with pytest.raises(InvalidValueError, match="the bytes are no parcel"):
        unpack_parcel(len(header).to_bytes(4, "little") + header)


@pytest.mark.parametrize("value", [object(), {1: 2}, np.array([None]), {"a": [print]}])
def test_code_and_objects_are_not_sent(value: object) -> None:
    with pytest.raises(InvalidValueError, match="data between processes must be plain"):
        pack_parcel(value)
