"""Options as plain data, which every process and file can hold."""

import pytest

from coopsim.bench.store.fingerprint import plain_options
from coopsim.errors import InvalidValueError


def test_a_range_of_places_is_short_and_the_same_as_its_text() -> None:
    assert plain_options({"place_seed": range(10**9)}) == {"place_seed": "0-999999999"}
    assert plain_options({"place_seed": range(5, 6)}) == {"place_seed": "5-5"}
    assert plain_options({"place_seed": range(0, 9, 4)}) == {"place_seed": [0, 4, 8]}
    assert plain_options({"reward": {"weights": (1, 2)}, "own": range(2)}) == {
        "reward": {"weights": [1, 2]},
        "own": [0, 1],
    }


def test_lists_without_end_are_refused() -> None:
    with pytest.raises(InvalidValueError, match="place_seed must have at most 1000000 items, got 500000000: for a"):
        plain_options({"place_seed": range(0, 10**9, 2)})
