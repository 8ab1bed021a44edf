"""What a user may ask of a drawn town."""

import pickle
from typing import Any

import numpy as np
import pytest

from coopsim.errors import InvalidValueError
from coopsim.world.drawn_options import PlaceSeeds, TownOptions
from coopsim.world.towns.town import describe_streets


def test_numpy_numbers_are_as_good_as_pythons() -> None:
    options = TownOptions(np.int64(2), np.float32(0.5), np.int32(1))  # type: ignore[arg-type]
    assert options == TownOptions(2, 0.5, 1)
    assert describe_streets(3, options) == describe_streets(3, TownOptions(2, 0.5, 1))


@pytest.mark.parametrize(
    "wrong",
    [{"junctions": 0}, {"junctions": 10}, {"lanes": 1.0}, {"lanes": True}, {"openness": 1.1}, {"openness": "low"}],
)
def test_a_wrong_one_is_named(wrong: dict[str, Any]) -> None:
    with pytest.raises(InvalidValueError, match=f"{next(iter(wrong))} must be"):
        TownOptions(**wrong)


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
