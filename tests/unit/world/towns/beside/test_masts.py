import numpy as np
import pytest

from coopsim.world.towns.beside.town_blocks import dress_streets
from coopsim.world.towns.streets.street_plan import draw_plan
from coopsim.world.towns.streets.town_options import TownOptions


@pytest.mark.parametrize("junctions", [1, 2, 4])
def test_every_town_has_a_mast_where_connected_cars_meet(junctions):
    for seed in range(12):
        plan = draw_plan(seed, TownOptions(junctions=junctions))
        first = dress_streets(plan, seed)["rsus"][0]
        junction = plan.junctions[plan.meeting]
        assert first["look_at"] == junction.centre.tolist()
        assert np.linalg.norm(first["at"] - junction.centre) < junction.stop_m + 15.0
