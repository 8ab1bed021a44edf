"""The agents are the same in all towns; all else fits its town."""

from __future__ import annotations

import warnings
from typing import Any

import pytest

from coopsim.errors import CrowdedWarning, InvalidValueError, UnknownNameError
from coopsim.world.drawn_options import PlaceSeeds, TownOptions
from coopsim.world.places.crossings import make_crossing
from coopsim.world.places.highway import make_highway
from coopsim.world.population import Population
from coopsim.world.scenario import rooms
from coopsim.world.towns.scenarios import TownScenarios
from coopsim.world.towns.town import FEWEST, FEWEST_STARTS, MOST, count_junctions, usual_population

SMALL = TownOptions(junctions=1, lanes=1)
PLACES = 4


def towns(options: TownOptions = SMALL, density: float = 1.0, **numbers: Any) -> TownScenarios:
    return TownScenarios(PlaceSeeds(), options, density, None, numbers)


@pytest.mark.parametrize("options", [SMALL, TownOptions(junctions=2)])
def test_what_every_town_has_room_for_is_there(options: TownOptions) -> None:
    for seed in range(PLACES):
        town = towns(options).of(seed)
        assert town.place_seed == seed and town.detail == "full" and town.name == "town"
        assert len(town.layout.slots) >= FEWEST_STARTS
        assert len(town.layout.rsus) >= FEWEST.rsus and len(town.layout.flights) >= FEWEST.drones
        assert FEWEST.vehicles <= town.population.vehicles <= MOST.vehicles


@pytest.mark.parametrize(
    ("numbers", "agents"),
    [
        ({}, (3, 2, 0)),
        ({"connected_cars": 5, "rsus": 1, "drones": 2}, (5, 1, 2)),
        ({"vehicles": 2}, (2, 2, 0)),
        ({"vehicles": 8, "truck_share": 0.0, "penetration": 0.5}, (4, 2, 0)),
        ({"trucks": FEWEST.vehicles - 2}, (2, 2, 0)),
    ],
)
def test_the_agents_are_the_same_in_all_places(numbers: dict[str, Any], agents: tuple[int, int, int]) -> None:
    for seed in range(PLACES):
        found = towns(**numbers).of(seed).population
        assert (found.connected, found.rsus, found.drones) == agents


def test_what_was_not_asked_for_is_quietly_less_and_what_was_is_not() -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error", CrowdedWarning)
        crowded = towns(density=50.0)
        populations = [crowded.of(seed).population for seed in range(PLACES)]
        vans = [towns(vans=12).of(seed).population for seed in range(PLACES)]
    assert [each.vans for each in vans] == [12] * PLACES
    assert {each.connected for each in populations} == {3}
    for seed, population in enumerate(populations):
        for room, names in rooms(crowded.of(seed).layout):
            assert sum(getattr(population, name) for name in names) <= room
    with pytest.warns(CrowdedWarning, match="there is room for"):
        towns(parked=1000)


def test_no_town_has_more_actors_than_are_told() -> None:
    for numbers in ({}, {"bicycles": 30}, {"density": 0.5}):
        scenarios = towns(**numbers)
        assert scenarios.most_actors is not None
        for seed in range(PLACES):
            population = scenarios.of(seed).population
            there = sum((*population.on_roads.values(), *population.people.values(), population.parked))
            assert there <= scenarios.most_actors


@pytest.mark.filterwarnings("ignore::coopsim.errors.CrowdedWarning")
def test_a_wish_that_no_town_fulfils_makes_no_larger_state() -> None:
    crowd = towns(vehicles=10**6, vans=10**6, parked=10**6, pedestrians=10**6, children=10**6)
    assert crowd.most_actors == 500 + 150 + 4000
    assert crowd.of(0).population.parked <= len(crowd.of(0).layout.bays)
    assert towns(vehicles=40).most_actors == towns(vehicles=30).most_actors + 10


@pytest.mark.parametrize(
    ("numbers", "message"),
    [
        ({"rsus": 3}, r"rsus must be at most 2 in 'town', got 3: .* smallest has no more places for them"),
        ({"drones": 5}, "drones must be at most 4 in 'town'"),
        ({"connected_cars": 12}, "connected_cars must be at most 8 in 'town', got 12: .* smallest has no more cars"),
        ({"vehicles": 100, "connected_cars": 40}, "connected_cars must be at most 18 in 'town'"),
        ({"penetration": 0.5}, "penetration needs vehicles in 'town'"),
        ({"connected_cars": 0, "rsus": 0}, "at least one agent"),
        ({"connected_cars": None}, "connected_cars must be an integer >= 0, got None"),
        ({"vehicles": -1}, "vehicles must be an integer >= 0, got -1"),
        ({"trucks": 13}, "trucks must be at most vehicles, which is 9, got 13"),
    ],
)
def test_what_not_all_towns_can_have_is_refused(numbers: dict[str, Any], message: str) -> None:
    with pytest.raises(InvalidValueError, match=message):
        towns(**numbers)
    with pytest.raises(UnknownNameError, match=r"unknown option of towns 'junction'. Did you mean 'junctions'"):
        towns(junction=3)


def test_the_usual_population_is_the_towns_own() -> None:
    assert isinstance(towns().of(1).population, Population)
    assert len({towns(TownOptions()).of(seed).population.vehicles for seed in range(3)}) > 1


def test_a_crossing_is_one_junction_and_a_highway_none() -> None:
    assert count_junctions(make_crossing()) == 1
    assert count_junctions(make_highway()) == 0


def test_the_usual_population_is_between_fewest_and_most() -> None:
    population = usual_population(make_crossing())
    assert FEWEST.vehicles <= population.vehicles <= MOST.vehicles
    assert population.connected_cars == 3
