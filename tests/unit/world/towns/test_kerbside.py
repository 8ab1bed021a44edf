import numpy as np

from coopsim.world.towns.street_plan import draw_plan
from coopsim.world.towns.town_blocks import dress_streets
from coopsim.world.towns.town_options import TownOptions


def test_vehicles_park_along_streets_in_the_direction_of_the_lane_beside_them():
    plan = draw_plan(3, TownOptions())
    street = next(street for street in plan.streets if street.parking_left and street.length_m > 60)
    along = np.linspace(*street.span_m, 200)
    aside = street.half_m(along) + 1.3
    left, heading = street.position(along, aside), np.degrees(street.heading(along)) + 180.0
    bays = dress_streets(plan, 3)["parked"]
    near = [
        (bay, int(np.linalg.norm(left - bay["at"], axis=1).argmin()))
        for bay in bays
        if np.linalg.norm(left - bay["at"], axis=1).min() < 0.6
    ]
    assert len(near) >= 2
    for bay, k in near:
        assert abs((bay["heading_deg"] - heading[k] + 180.0) % 360.0 - 180.0) < 3.0


def test_some_towns_have_humps_and_puddles():
    towns = [dress_streets(draw_plan(seed, TownOptions(junctions=3)), seed) for seed in range(12)]
    for key in ("humps", "wet"):
        assert sum(key in town for town in towns) > 0
    assert any("wet" not in town for town in towns)
    assert all(0.07 <= hump["height_m"] <= 0.1 for town in towns for hump in town.get("humps", []))
