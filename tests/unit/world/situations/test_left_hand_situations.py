"""Situations in a place with traffic on the left are those on the right in a mirror."""

import numpy as np
import pytest

from coopsim.world.drawn_options import TownOptions
from coopsim.world.situations.situation import SITUATIONS
from coopsim.world.towns.town import draw_place
from coopsim.world.world import World


@pytest.mark.parametrize(("name", "town"), [("child_between_cars", 2), ("overtaking", 2), ("crossing_path", 3)])
def test_all_move_as_in_the_mirror(name: str, town: int) -> None:
    found = []
    for side in ("right", "left"):
        place = draw_place(town, TownOptions(traffic_side=side))
        scenario = SITUATIONS.get(name)(place=place, penetration=1.0).of(0)
        world = World(scenario, 0)
        for _ in range(25):
            world.step(0.1)
        found.append(world.actors())
    right, left = found
    assert len(right) > 4 and np.abs(right.velocity).max() > 4.0
    np.testing.assert_allclose(left.boxes.center, right.boxes.center * [1, -1, 1], atol=1e-6)
    np.testing.assert_allclose(np.sin(left.boxes.yaw), -np.sin(right.boxes.yaw), atol=1e-6)
    np.testing.assert_array_equal(left.label, right.label)
