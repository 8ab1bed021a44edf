"""What `frozen` gives out: never writeable, and the caller's own array as it was; and what `look_up` finds."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from coopsim.errors import InvalidValueError
from coopsim.support.arrays import frozen, look_up


@pytest.mark.parametrize("given", [np.zeros((3, 2)), np.zeros((3, 2), int), [[0, 0], [0, 0], [0, 0]]])
def test_the_result_is_read_only_and_the_callers_array_is_not(given: object) -> None:
    array = frozen(given, (None, 2), np.float64, "rows")
    assert array.dtype == np.float64 and array.shape == (3, 2)
    with pytest.raises(ValueError, match="read-only"):
        array[0, 0] = 1.0
    if isinstance(given, np.ndarray):
        given[0, 0] = 1


def test_what_is_frozen_is_handed_on_as_it_is() -> None:
    once = frozen(np.zeros(3), (3,), np.float64, "row")
    assert frozen(once, (None,), np.float64, "row") is once


@pytest.mark.parametrize("given", [np.ma.masked_array([1.0, 2.0], [True, False]), np.array([1.0, 2.0], ">f8")])
def test_what_only_looks_like_an_array_of_the_type_becomes_one(given: np.ndarray) -> None:
    array = frozen(given, (2,), np.float64, "row")
    assert type(array) is np.ndarray and array.dtype == np.dtype(np.float64) and array.tolist()[1] == 2.0


@pytest.mark.parametrize("writeable", [True, False])
@pytest.mark.parametrize("shape", [(2,), (None,), (3, None), (2, 2), (None, 3), (3, 2, None)])
def test_another_shape_is_refused(shape: tuple[int | None, ...], writeable: bool) -> None:
    given = np.zeros((3, 2))
    given.flags.writeable = writeable
    if shape == (3, None):
        assert frozen(given, shape, np.float64, "rows").shape == (3, 2)
        return
    with pytest.raises(InvalidValueError, match=r"rows must have shape .*, got \(3, 2\)"):
        frozen(given, shape, np.float64, "rows")


IDS = st.lists(st.integers(0, 12), max_size=12)


@given(IDS, IDS)
def test_ids_are_found_where_they_are(some: list[int], wanted: list[int]) -> None:
    rising, asked = np.unique(np.array(some, dtype=np.int64)), np.array(wanted, dtype=np.int64)
    place, there = look_up(rising, asked)
    assert there.tolist() == [each in some for each in wanted]
    assert (rising[place[there]] == asked[there]).all()
    assert all((rising[:k] < each).all() and (rising[k:] >= each).all() for k, each in zip(place, asked, strict=True))
