"""Crowns of trees from above: of leaves alone, as wide as these, and in the map of a place as it is in detail."""

from __future__ import annotations

import numpy as np

from coopsim.world.places.crowns import crowns_of
from coopsim.world.scenario import make_scenario
from coopsim.world.snapshot import StaticPart
from coopsim.world.world import World

LEAVES = np.array([[2.0, 5.0, 3.0], [8.0, 7.0, 3.0], [5.0, 9.0, 6.0], [5.0, 6.0, 4.0]])


def part(name: str, opacity: float) -> StaticPart:
    return StaticPart(name, LEAVES, np.array([[0, 1, 2]]), (0, 0, 0), 0.3, opacity=opacity)


def test_a_crown_is_as_wide_as_its_leaves_and_stems_and_bushes_have_none() -> None:
    crowns = crowns_of([part("tree", 0.7), part("tree", 1.0), part("bush", 0.7), part("leaves", 1.0)])
    assert len(crowns) == 2
    for crown in crowns:
        assert crown.shape == (8, 2)
        np.testing.assert_allclose(crown.min(axis=0), [2.0, 5.0])
        np.testing.assert_allclose(crown.max(axis=0), [8.0, 9.0])


def test_a_map_has_the_trees_that_stand_there() -> None:
    plain, full = (make_scenario("crossing", detail=detail) for detail in ("plain", "full"))
    assert plain.road_map.trees == () and len(full.road_map.trees) > 10
    np.testing.assert_array_equal(World(full, 0).map.trees, full.road_map.trees)
