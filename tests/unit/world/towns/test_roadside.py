"""Roadside units, parked vehicles, humps and puddles of drawn towns."""

import numpy as np
import pytest

from coopsim.world.drawn_options import TownOptions
from coopsim.world.towns.planning import draw_plan
from coopsim.world.towns.town import dress_streets


def test_vehicles_park_along_streets_in_the_direction_of_the_lane_beside_them():
    turns = []
    for seed in range(4):
        plan = draw_plan(seed, TownOptions(junctions=3))
        places = np.array([bay.at for bay in dress_streets(plan, seed)["parked"]])
        headings = np.array([bay.heading_deg for bay in dress_streets(plan, seed)["parked"]])
        for street in plan.streets:
            along = np.linspace(*street.span_m, 200)
            left, lane_deg = street.position(along, street.half_m(along) + 1.3), np.degrees(street.heading(along)) + 180
            apart_m = np.linalg.norm(left[:, None] - places, axis=2)
            beside = np.flatnonzero(apart_m.min(axis=0) < 0.5)
            turns += list((headings[beside] - lane_deg[apart_m[:, beside].argmin(axis=0)] + 180.0) % 360.0 - 180.0)
    assert len(turns) > 10
    assert np.abs(turns).max() < 5.0


def test_some_towns_have_humps_and_puddles():
    towns = [dress_streets(draw_plan(seed, TownOptions(junctions=3)), seed) for seed in range(12)]
    for key in ("humps", "wet"):
        assert sum(key in town for town in towns) > 0
    assert any("wet" not in town for town in towns)
    assert all(0.07 <= hump.height_m <= 0.1 for town in towns for hump in town.get("humps", []))


@pytest.mark.parametrize("junctions", [1, 2, 4])
def test_every_town_has_a_mast_where_connected_cars_meet(junctions):
    for seed in range(12):
        plan = draw_plan(seed, TownOptions(junctions=junctions))
        first = dress_streets(plan, seed)["rsus"][0]
        junction = plan.junctions[plan.meeting]
        assert list(first.look_at) == junction.centre.tolist()
        assert np.linalg.norm(first.at - junction.centre) < junction.stop_m + 15.0
