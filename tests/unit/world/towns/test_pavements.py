import numpy as np
import pytest

from coopsim.world.drawn_options import TownOptions
from coopsim.world.towns.pavements import PeopleWays, describe_ways
from coopsim.world.towns.planning import draw_plan
from coopsim.world.towns.town import dress_streets


@pytest.mark.parametrize("seed", [1, 3, 10])
def test_every_arm_has_a_crosswalk(seed):
    plan = draw_plan(seed, TownOptions())
    walks = dress_streets(plan, seed)["walks"]
    middles = np.array([np.mean([walks.nodes[name] for name in pair], axis=0) for pair in walks.crosswalks])
    assert plan.junctions
    for junction in plan.junctions:
        for arm in junction.arms:
            out = np.array([np.cos(arm.heading_rad), np.sin(arm.heading_rad)])
            along_m = (middles - junction.centre) @ out
            aside_m = np.abs((middles - junction.centre) @ [-out[1], out[0]])
            assert ((along_m > 3.0) & (along_m < junction.stop_m + 8.0) & (aside_m < 4.0)).any()


def test_crosswalks_are_square_to_their_street():
    plan = draw_plan(3, TownOptions())
    walks = dress_streets(plan, 3)["walks"]
    headings = [arm.heading_rad for junction in plan.junctions for arm in junction.arms]
    assert len(walks.crosswalks) >= len(headings) > 2
    for pair in walks.crosswalks[: len(headings)]:
        across = np.subtract(*(walks.nodes[name] for name in pair))
        turns = [abs(np.cos(np.arctan2(across[1], across[0]) - heading)) for heading in headings]
        assert min(turns) < 0.02


def test_ways_have_nodes_at_the_ends_of_crosswalks():
    square = np.array([[0.0, 0.0], [0.0, 4.0], [0.0, 8.0], [8.0, 8.0], [8.0, 0.0]])
    walks = describe_ways(PeopleWays((square,), [((0, 1.5), (0, 3.5))]))
    assert walks.crosswalks == (("w1", "w4"),)
    assert walks.nodes["w1"] == (0.0, 6.0)
    assert walks.nodes["w4"] == (8.0, 4.0)
    assert walks.ways == (("w0", "w1", "w2", "w3", "w4", "w5", "w0"),)
