import numpy as np
from corner_sights import FARTHEST_M, are_hidden, corner_sights, hiding_edges

from coopsim.world.drawn_options import TownOptions
from coopsim.world.places.description import MapBuilding, MapWall
from coopsim.world.towns.planning import draw_plan
from coopsim.world.towns.town import dress_streets


def test_wall_hides_what_is_behind_it():
    edge = np.array([[5.0, -1.0]]), np.array([[5.0, 1.0]])
    places = np.array([[4.0, 0.0], [6.0, 0.0], [10.0, 1.9], [10.0, 2.1], [-6.0, 0.0]])
    assert are_hidden(np.zeros(2), places, *edge).tolist() == [False, True, True, False, False]


def test_low_walls_hide_nothing():
    items = {
        "walls": (MapWall(((0, 0), (1, 0)), 0.6), MapWall(((0, 0), (1, 0), (1, 1)), 1.8)),
        "buildings": (MapBuilding(((0, 0), (1, 0), (1, 1), (0, 1)), 4),),
    }
    assert [len(ends) for ends in hiding_edges(items)] == [6, 6]


def test_nothing_hides_in_an_empty_town():
    assert (corner_sights(draw_plan(3, TownOptions()), {}) == FARTHEST_M).all()


def test_open_towns_have_longer_sights():
    plans = [draw_plan(seed, TownOptions()) for seed in range(8)]
    closed, between, wide = (
        np.concatenate([corner_sights(plan, dress_streets(plan, seed, open_)) for seed, plan in enumerate(plans)])
        for open_ in (0.0, 0.5, 1.0)
    )
    assert np.median(closed) < np.median(between) < np.median(wide)
    assert np.quantile(closed, 0.1) <= 5.0
    assert np.quantile(wide, 0.9) >= 100.0
