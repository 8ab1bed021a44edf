"""Descriptions in memory are read as files are, and errors name the keys that lead to a mistake."""

import numpy as np
import pytest

from coopsim.config.checked_entry import DataEntry, plain
from coopsim.errors import InvalidValueError


def entry(value: object) -> DataEntry:
    return DataEntry(plain(value), "place", InvalidValueError)


def test_plain_data_is_a_copy_in_pythons_own_types() -> None:
    given = {"a": (1, np.float64(2.5)), 3: {"b": [np.int64(4), None, True]}}
    made = plain(given)
    assert repr(made) == "{'a': [1, 2.5], '3': {'b': [4, None, True]}}"
    made["a"].append(0)
    assert len(given["a"]) == 2


def test_points_of_floats_and_of_other_numbers_are_the_same() -> None:
    fast, slow = entry([[1.0, 2.0], [3.0, 4.0]]).points(2), entry([[1, 2], [3, 4]]).points(2)
    assert fast.tobytes() == slow.tobytes() and fast.dtype == slow.dtype == np.float64


@pytest.mark.parametrize(
    ("value", "message"),
    [
        ([[1.0, 2.0], [1.0, "x"]], r"^outline\[1\]\[1\]: outline must be a finite number, got 'x'"),
        ([[1.0, 2.0], [1.0]], r"^outline\[1\]: outline must be 2 numbers, got \[1.0\]"),
        ([[1.0, 2.0], 3], r"^outline\[1\]: outline must have points \[x, y\], got 3"),
        ([[1.0, float("nan")], [1.0, 2.0]], r"^outline\[0\]\[1\]: outline must be a finite number, got nan"),
        ([[1.0, 2.0]], r"^outline: outline must be at least 2 points \[x, y\], got 1"),
        (5, r"^outline: outline must be a list, got 5"),
    ],
)
def test_mistakes_are_said_with_the_keys_that_lead_to_them(value: object, message: str) -> None:
    with pytest.raises(InvalidValueError, match=message):
        entry({"outline": value}).fields(("outline",))["outline"].points(2)


def test_flags_and_fractions_are_no_names() -> None:
    names = entry([3, "b", True, 1.5]).entries()
    assert [name.text() for name in names[:2]] == ["3", "b"]
    for name in names[2:]:
        with pytest.raises(InvalidValueError, match="place must be a name"):
            name.text()
