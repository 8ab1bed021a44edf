from dataclasses import replace

import pytest

from coopsim.geometry.se3 import SE3
from coopsim.world.scenario import Scenario, make_scenario
from coopsim.world.towns.drawn_place import describe_town, draw_place
from coopsim.world.towns.validity import find_faults, fingerprint

CROSSING = make_scenario("crossing")


def with_mast(x_m: float, y_m: float) -> Scenario:
    layout = replace(CROSSING.layout, rsus=(SE3.from_xyz_yaw([x_m, y_m, 0.0], 0.0),))
    return Scenario("crossing", layout, CROSSING.population)


def test_places_differ_and_a_place_stays_the_same():
    """Few, as each takes a while; `scripts/survey_towns.py --only-draw` compares as many as one likes."""
    first, other = (fingerprint(describe_town(place)) for place in (0, 1))
    draw_place.cache_clear()
    again = fingerprint(describe_town(0))
    assert first == again != other


def test_fingerprint_depends_on_values_and_not_on_the_order_of_keys():
    assert fingerprint({"a": [1.5, 2], "b": "c"}) == fingerprint({"b": "c", "a": [1.5, 2]})
    assert fingerprint({"a": [1.5, 2]}) != fingerprint({"a": [1.501, 2]})


def test_good_place_has_no_fault():
    assert find_faults(CROSSING, 0) == []


def test_lonely_agent_is_a_fault():
    alone = make_scenario("crossing", connected_cars=1, rsus=0)
    assert find_faults(alone, 0) == ["there are fewer than two agents"]


@pytest.mark.parametrize("fault", ["far from junctions", "in a building"])
def test_mast_in_the_wrong_place_is_a_fault(fault: str):
    spot = [300.0, 300.0] if fault == "far from junctions" else CROSSING.layout.road_map.buildings[0].mean(axis=0)
    found = " ".join(find_faults(with_mast(*spot), 0))
    assert ("m from the nearest junction" if fault == "far from junctions" else "stands in a building") in found
    if fault == "far from junctions":
        assert "m apart" in found
