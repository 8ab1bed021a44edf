import numpy as np

from coopsim.viz import palette
from coopsim.viz.portrait import draw_overhead
from coopsim.world.scenario import make_scenario
from coopsim.world.world import World


def test_north_is_up_and_agents_are_ringed():
    world = World(make_scenario("crossing", vehicles=0, pedestrians=0, connected_cars=0), seed=0)
    (unit,) = world.agents().values()
    at = unit.world_SE3_base.translation[:2]
    picture = draw_overhead(world, at + np.array([20.0, -30.0]), 120.0, 240)  # two pixels a metre
    assert picture.shape == (240, 240, 3)
    rows, columns = np.nonzero((picture == palette.AGENT).all(axis=2))
    assert np.allclose([columns.mean(), rows.mean()], [120 - 40, 120 - 60], atol=1.0)


def test_buildings_are_where_the_map_has_them():
    world = World(make_scenario("crossing", vehicles=0, pedestrians=0, connected_cars=0), seed=0)
    footprint = world.map.buildings[0]
    picture = draw_overhead(world, footprint.mean(axis=0), float(np.ptp(footprint, axis=0).min()) / 2, 40)
    assert len(np.unique(picture.reshape(-1, 3), axis=0)) == 1, "nothing but a roof"
