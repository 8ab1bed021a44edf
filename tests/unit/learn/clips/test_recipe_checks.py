from __future__ import annotations

import pytest

from coopsim.errors import InvalidValueError
from coopsim.learn.clips.ranges import as_count_range, as_range
from coopsim.learn.clips.world_recipe import as_lidar_weights


def test_ends_of_ranges_become_numbers_of_one_kind() -> None:
    assert [type(end) for end in as_range("start_s", [0, 25], 0, 100)] == [float, float]
    assert as_count_range("cars", [1, 1]) == (1, 1)
    assert as_lidar_weights({"HDL-64E": 2}, allowed=False) == {"HDL-64E": 2.0}


@pytest.mark.parametrize("given", [[1], [2, 1], [1, 2, 3], [0, 101], "12", 3, [], [0, float("nan")], [True, 2]])
def test_what_is_no_range_is_refused(given: object) -> None:
    with pytest.raises(InvalidValueError, match="start_s must be"):
        as_range("start_s", given, 0, 100)
