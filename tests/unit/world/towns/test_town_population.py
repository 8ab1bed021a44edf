"""Tests of the usual population of towns."""

from __future__ import annotations

from coopsim.world.places.highway import make_highway
from coopsim.world.places.junctions import make_crossing
from coopsim.world.towns.town_population import FEWEST, MOST, count_junctions, usual_population


def test_a_crossing_is_one_junction_and_a_highway_none() -> None:
    assert count_junctions(make_crossing()) == 1
    assert count_junctions(make_highway()) == 0


def test_the_usual_population_is_between_fewest_and_most() -> None:
    population = usual_population(make_crossing())
    assert FEWEST.vehicles <= population.vehicles <= MOST.vehicles
    assert population.connected_cars == 3
