"""Which place belongs to which episode."""

import pickle
from typing import Any

import numpy as np
import pytest

from coopsim.errors import InvalidValueError
from coopsim.world.towns.place_seeds import PlaceSeeds


@pytest.mark.parametrize(
    ("place_seed", "places"),
    [
        (None, [0, 1, 2, 7]),
        (5, [5, 5, 5, 5]),
        (np.int64(5), [5, 5, 5, 5]),
        ("5", [5, 5, 5, 5]),
        (range(1000, 1003), [1000, 1001, 1002, 1001]),
        ("1000-1002", [1000, 1001, 1002, 1001]),
        ([4, 9], [4, 9, 4, 9]),
        (np.array([4, 9]), [4, 9, 4, 9]),
    ],
)
def test_the_place_of_an_episode(place_seed: Any, places: list[int]) -> None:
    seeds = PlaceSeeds(place_seed)
    assert [seeds.of(seed) for seed in (0, 1, 2, 7)] == places
    assert pickle.loads(pickle.dumps(seeds)) == seeds


def test_a_thousand_places_are_each_taken_once() -> None:
    seeds = PlaceSeeds(range(1000, 2000))
    assert sorted(seeds.of(seed) for seed in range(1000)) == list(range(1000, 2000))
    assert seeds.of(2**62 + 1) in range(1000, 2000)


@pytest.mark.parametrize(
    "wrong",
    [
        -1,
        1.0,
        True,
        "",
        "3-1",
        "a",
        "-4",
        [],
        range(0),
        range(-2, 3),
        [1, None],
        {},
        2**62,
        range(10**30),
        "0-9999999999999999999",
    ],
)
def test_a_wrong_one_is_refused(wrong: Any) -> None:
    with pytest.raises(InvalidValueError, match="place_seed must be an integer >= 0, a range or a list of these"):
        PlaceSeeds(wrong)
