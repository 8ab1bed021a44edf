"""What a user may ask of a drawn town."""

from typing import Any

import numpy as np
import pytest

from coopsim.errors import InvalidValueError
from coopsim.world.towns.drawn_place import describe_streets
from coopsim.world.towns.streets.town_options import TownOptions


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
