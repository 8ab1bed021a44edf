"""What is asked for is checked, and the message says what is accepted."""

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import coopsim
from coopsim.errors import CrowdedWarning, InvalidValueError, UnknownNameError
from coopsim.world.scenario import SCENARIOS, make_scenario
from coopsim.world.world import World


@pytest.mark.parametrize(
    ("numbers", "message"),
    [
        ({"connected_cars": 9, "vehicles": 10}, r"at most the number of cars, which is 8 \(10 vehicles less 2 trucks"),
        ({"vehicles": -1}, "vehicles must be an integer >= 0, got -1"),
        ({"pedestrians": -3}, "pedestrians must be an integer >= 0, got -3"),
        ({"rsus": 1.5}, "rsus must be an integer >= 0, got 1.5"),
        ({"truck_share": 1.2}, r"truck_share must be in \[0, 1\], got 1.2"),
        ({"connected_cars": 0, "rsus": 0}, "at least one agent"),
        ({"penetration": 1.5}, r"penetration must be in \[0, 1\], got 1.5"),
        ({"penetration": 0.0, "rsus": 0}, "at least one agent"),
        ({"buses": -1}, "buses must be an integer >= 0, got -1"),
        ({"bicycles": 2}, "bicycles must be at most 0 in 'highway', got 2"),
        ({"rsus": 5}, "rsus must be at most 4 in 'highway', got 5"),
        ({"pedestrians": 1}, "pedestrians must be at most 0 in 'highway', got 1"),
    ],
)
def test_bad_number(numbers: dict[str, Any], message: str) -> None:
    with pytest.raises(InvalidValueError, match=message):
        make_scenario("highway", **numbers)


@pytest.mark.parametrize(
    ("name", "numbers", "message"),
    [
        ("crosing", {}, "unknown scenario 'crosing'. Did you mean 'crossing'"),
        (
            "crossing",
            {"pedestrian": 2},
            "unknown number of scenario 'crossing' 'pedestrian'. Did you mean 'pedestrians'",
        ),
    ],
)
def test_unknown_name_comes_with_a_suggestion(name: str, numbers: dict[str, Any], message: str) -> None:
    with pytest.raises(UnknownNameError, match=message):
        make_scenario(name, **numbers)


def test_a_full_place_is_accepted_and_one_more_is_left_out_with_a_warning() -> None:
    layout = make_scenario("crossing").layout
    assert layout.footways is not None and 100 < layout.footways.capacity < 1000
    for name, room in {"vehicles": len(layout.slots), "pedestrians": layout.footways.capacity}.items():
        assert getattr(make_scenario("crossing", **{name: room}).population, name) == room
        with pytest.warns(CrowdedWarning, match=rf"room for {room} of {room + 1} .*{name}={room}"):
            scenario = make_scenario("crossing", **{name: room + 1})
        assert getattr(scenario.population, name) == room


def test_what_shares_the_room_is_counted_together() -> None:
    room = len(make_scenario("crossing").layout.slots)
    with pytest.warns(CrowdedWarning, match=f"room for {room} of {room + 12}"):
        population = make_scenario("crossing", vehicles=room, buses=4, vans=8, connected_cars=30).population
    assert sum(population.on_roads.values()) == room
    assert (population.vans, population.buses) == (8, 4)
    assert population.connected == population.cars == 27  # no more than there are


@pytest.mark.parametrize("agents", [{"connected_cars": 187}, {"penetration": 1.0}])
def test_connected_cars_without_room_are_named(agents: dict[str, Any]) -> None:
    with pytest.warns(CrowdedWarning, match="vehicles=44, .*; only 37 of 187 connected cars are there$"):
        assert make_scenario("crossing", vehicles=220, **agents).population.connected == 37
    with pytest.warns(CrowdedWarning) as warned:
        assert make_scenario("crossing", vehicles=220).population.connected == 3
    assert "connected" not in str(warned[0].message)


@pytest.mark.parametrize(("penetration", "connected"), [(0.0, 0), (0.5, 8), (1.0, 17)])
def test_penetration_is_a_share_of_the_cars(penetration: float, connected: int) -> None:
    scenario = make_scenario("crossing", vehicles=20, penetration=penetration)
    assert scenario.population.cars == 17
    agents = World(scenario, 0).agents().values()
    assert sum(agent.kind == "cav" for agent in agents) == connected


def test_trucks_are_given_by_number_or_by_share() -> None:
    by_number = make_scenario("crossing", vehicles=20, trucks=5).population
    by_share = make_scenario("crossing", vehicles=20, truck_share=0.25).population
    assert by_number.on_roads == by_share.on_roads and by_number.cars == 15
    assert make_scenario("crossing", vehicles=20, trucks=5, density=2.0).population.cars == 30


@pytest.mark.parametrize(
    ("numbers", "message"),
    [
        ({"connected_cars": 2, "penetration": 0.1}, "penetration takes the place of connected_cars"),
        ({"truck_share": 0.2, "trucks": 3}, "trucks takes the place of truck_share"),
        ({"trucks": -1}, "trucks must be an integer >= 0, got -1"),
        ({"trucks": 31}, "trucks must be at most vehicles, which is 30, got 31"),
    ],
)
def test_numbers_that_exclude_each_other(numbers: dict[str, Any], message: str) -> None:
    with pytest.raises(InvalidValueError, match=message):
        make_scenario("crossing", **numbers)


def test_where_there_are_few_cars_the_usual_number_of_connected_ones_is_no_request() -> None:
    assert make_scenario("crossing").population.connected == 3
    assert make_scenario("crossing", vehicles=2).population.connected == 2
    assert make_scenario("crossing", density=0.0).population.connected == 0
    assert make_scenario("crossing", truck_share=1.0).population.connected == 0
    with pytest.raises(InvalidValueError, match="connected_cars must be at most the number of cars, which is 0"):
        make_scenario("crossing", density=0.0, connected_cars=3)
    with pytest.raises(InvalidValueError, match="at least one agent"):
        make_scenario("platoon", density=0.0)  # which has no roadside unit


def test_the_card_has_the_numbers_of_every_scenario() -> None:
    card = (Path(__file__).parents[3] / "docs" / "reference" / "scenarios.md").read_text()
    rows = re.findall(r"^\| `(\w+)` \|" + r" (\d+) \|" * 5 + "$", card, flags=re.M)
    expected = []
    for name in SCENARIOS:
        own = make_scenario(name).population
        numbers = (own.vehicles, own.pedestrians, own.parked, own.connected, own.rsus)
        expected.append((name, *map(str, numbers)))
        assert not (own.vans or own.buses or own.motorcycles or own.children or own.bicycles or own.scooters)
    assert sorted(rows) == sorted(expected)


def test_density_counts_in_numpy_as_in_python() -> None:
    assert make_scenario("crossing", vehicles=np.int64(10), density=2.0).population.vehicles == 20


@pytest.mark.parametrize("numbers", [{"penetration": 0.5}, {"trucks": 4}, {"connected_cars": 1, "truck_share": 0.5}])
def test_a_population_is_made_again_from_its_numbers(numbers: dict[str, Any]) -> None:
    population = make_scenario("crossing", **numbers).population
    again = make_scenario("crossing", **population.numbers).population
    assert again.on_roads == population.on_roads and again.connected == population.connected


def test_the_warning_that_it_is_crowded_points_at_who_asked() -> None:
    with pytest.warns(CrowdedWarning) as by_scenario:
        make_scenario("parking_street", parked=1000)
    with pytest.warns(CrowdedWarning) as by_environment:
        coopsim.parallel_env("parking_street", parked=1000).close()
    assert {warning.filename for warning in (*by_scenario, *by_environment)} == {__file__}
