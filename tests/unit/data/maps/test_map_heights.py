"""From heights of a map's lanes to those of a place's ground."""

from __future__ import annotations

import numpy as np
from test_levels import lane, street_map, way

from coopsim.data.maps.place.heights import APART_M, heights_of


def test_heights_of_lanes_and_ways_are_kept_every_few_metres() -> None:
    slope = lane("slope", (0, 0, 10), (160, 0, 18))
    flat = way("flat", (160, 0, 18), (200, 0, 18))
    high = lane("path", (0, 9, 90), (100, 9, 90), kind="walk")
    found = np.array(heights_of(street_map(slope, high, ways=(flat,))))
    assert found[:, 2].min() == 0 and 7.8 < found[:, 2].max() <= 8
    assert np.allclose(found[:, 2], np.interp(found[:, 0], [0, 160, 200], [0, 8, 8]), atol=0.25)
    assert np.diff(np.sort(found[:, 0])).max() < 1.5 * APART_M and len(found) == 26


def test_flat_maps_and_empty_ones_have_none() -> None:
    assert heights_of(street_map(lane("flat", (0, 0, 70), (160, 0, 70.1)))) == ()
    assert heights_of(street_map()) == ()
