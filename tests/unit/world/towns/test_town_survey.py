"""Tests of the survey of towns: jams, crashes, faults."""

from dataclasses import replace

import numpy as np
import pytest
from town_survey import Diary, find_faults, fingerprint, held_by_wrecks, survey_traffic

from coopsim.envs.simulated.scenario_file import load_scenario_file
from coopsim.geometry.se3 import SE3
from coopsim.world.scenario import Place, Scenario, make_scenario
from coopsim.world.towns.town import describe_town, draw_place
from coopsim.world.traffic.fleet import PARKED, TOWN, VEHICLE


def fleet(*spots):
    """Return vehicles at these x, y; all stand."""
    rows = np.zeros(len(spots), VEHICLE)
    rows["id"] = np.arange(1, len(spots) + 1)
    rows["driver"] = TOWN
    rows["x"], rows["y"] = np.transpose(spots)
    return rows


def drive(rows, seconds, speeds=None):
    """Note a fleet for a while; `speeds` maps a step to what changes."""
    diary = Diary(rows)
    for step in range(round(seconds / 0.1)):
        for name, row, value in (speeds or {}).get(step, []):
            rows[name][row] = value
        diary.note(rows, (step + 1) * 0.1)
    return diary.summary(rows)


def test_vehicle_that_stands_too_long_is_a_jam():
    rows = fleet((0, 0), (100, 7))
    rows["speed"][0] = 5.0
    survey = drive(rows, 40.0)
    assert [(jam.vehicle, jam.x_m, jam.y_m, jam.since_s) for jam in survey.jams] == [(2, 100.0, 7.0, 0.0)]
    assert max(survey.waits_s) == pytest.approx(40.0)
    assert survey.vehicle_hours == pytest.approx(80 / 3600)
    assert survey.speed_m_s == pytest.approx(2.5)


def test_jam_is_a_deadlock_only_where_nobody_moves():
    rows = fleet((0, 0), (30, 0), (500, 0), (505, 0))
    rows["speed"][1] = 2.0
    survey = drive(rows, 40.0)
    assert [jam.vehicle for jam in survey.jams] == [1, 3, 4]
    assert [jam.vehicle for jam in survey.jams if jam.is_deadlock] == [3, 4]
    others_pass = drive(fleet((0, 0), (30, 0)), 50.0, {100: [("speed", 1, 2.0)], 150: [("speed", 1, 0.0)]})
    assert [(jam.vehicle, jam.for_s, jam.frozen_s) for jam in others_pass.jams] == [(1, 50.0, 35.0), (2, 35.0, 35.0)]


def test_waits_begin_anew_after_moving():
    survey = drive(fleet((0, 0)), 40.0, {200: [("speed", 0, 3.0)], 210: [("speed", 0, 0.4)]})
    assert survey.waits_s == (20.0, 19.0)
    assert not survey.jams


def test_parked_vehicles_and_wrecks_do_not_wait():
    rows = fleet((0, 0), (100, 0))
    rows["driver"][0] = PARKED
    survey = drive(rows, 40.0, {0: [("crashed", 1, True)]})
    assert not survey.waits_s
    assert survey.vehicle_hours == 0.0
    assert survey.vehicles == 1


def test_vehicles_that_touch_each_other_are_one_crash():
    together = [("crashed", k, True) for k in (0, 1, 3)]
    survey = drive(fleet((0, 0), (5, 0), (200, 0), (100, 0)), 2.0, {4: together, 9: [("crashed", 2, True)]})
    assert [(crash.time_s, crash.vehicles) for crash in survey.crashes] == [(0.5, (1, 2)), (0.5, (4,)), (1.0, (3,))]


def test_person_who_walks_into_a_parked_vehicle_is_told_from_a_crash():
    rows = fleet((0, 0), (100, 0), (105, 0))
    rows["driver"][[0, 1]] = PARKED
    survey = drive(rows, 2.0, {0: [("crashed", k, True) for k in range(3)]})
    assert [(crash.vehicles, crash.parked) for crash in survey.crashes] == [((1,), True), ((2, 3), False)]


def test_queue_at_a_wreck_is_held_by_it_and_others_are_not():
    rows = fleet((0, 0), (20, 0), (32, 0), (44, 0), (80, 0))
    rows["crashed"][0] = True
    assert held_by_wrecks(rows).tolist() == [False, True, True, True, False]
    rows["speed"][2] = 2.0  # the queue is interrupted
    assert held_by_wrecks(rows).tolist() == [False, True, False, False, False]


def test_real_traffic_drives_and_waits():
    place = load_scenario_file("village.yaml").scenario
    assert isinstance(place, Place)
    survey = survey_traffic(make_scenario(place), 0, 20.0)
    assert survey.vehicles == place.population.vehicles
    assert survey.vehicle_hours == pytest.approx(survey.vehicles * 20 / 3600)
    assert 1.0 < survey.speed_m_s < 11.0
    assert not survey.crashes


CROSSING = make_scenario("crossing")


def with_mast(x_m: float, y_m: float) -> Scenario:
    layout = replace(CROSSING.layout, rsus=(SE3.from_xyz_yaw([x_m, y_m, 0.0], 0.0),))
    return Scenario("crossing", layout, CROSSING.population)


def test_places_differ_and_a_place_stays_the_same():
    """Few, as each takes a while; `scripts/survey_towns.py --only-draw` compares as many as one likes."""
    first, other = (fingerprint(describe_town(place).plain) for place in (0, 1))
    draw_place.cache_clear()
    again = fingerprint(describe_town(0).plain)
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
