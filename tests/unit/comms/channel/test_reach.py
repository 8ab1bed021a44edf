"""Who is out of range is decided for all pairs at once as for each by itself."""

from __future__ import annotations

import numpy as np
import pytest

from coopsim.comms.channel.channel import out_of_range


@pytest.mark.parametrize("range_m", [0.0, 5.0, 300.0, np.inf])
def test_pairs_are_compared_with_the_range(range_m: float) -> None:
    rng = np.random.default_rng(0)
    places = rng.uniform(-300, 300, (40, 3))
    places[:8] = np.round(places[:8] / 100) * 3  # some of them at a distance that is a whole number, some at the same
    places[:8, 1] *= 4 / 3
    expected = np.array([[np.linalg.norm(other - place) > range_m for other in places] for place in places])
    np.testing.assert_array_equal(out_of_range(places, range_m), expected)
