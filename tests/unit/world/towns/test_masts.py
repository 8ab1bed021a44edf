import numpy as np
import pytest

from coopsim.world.towns.masts import near_first
from coopsim.world.towns.street_plan import draw_plan
from coopsim.world.towns.town_blocks import dress_streets
from coopsim.world.towns.town_options import TownOptions


@pytest.mark.parametrize("junctions", [1, 2, 4])
def test_every_town_has_a_mast_where_connected_cars_meet(junctions):
    for seed in range(12):
        plan = draw_plan(seed, TownOptions(junctions=junctions))
        first = dress_streets(plan, seed)["rsus"][0]
        junction = plan.junctions[plan.meeting]
        assert first["look_at"] == junction.centre.tolist()
        assert np.linalg.norm(first["at"] - junction.centre) < junction.stop_m + 15.0


def test_masts_near_the_cars_come_first_and_near_each_other() -> None:
    cars = np.array([[0.0, 0.0], [40.0, 0.0]])
    at = [[120.0, 0.0], [-30.0, 0.0], [60.0, 0.0], [20.0, 10.0]]
    order = [mast["at"] for mast in near_first([{"at": each} for each in at], cars)]
    # The third is 90 m from the second, which is taken before it.
    assert order == [[-30.0, 0.0], [20.0, 10.0], [120.0, 0.0], [60.0, 0.0]]
