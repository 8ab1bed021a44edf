"""The first connected cars and masts are near each other."""

from __future__ import annotations

import numpy as np
import pytest
from town_survey import find_faults

from coopsim.world.drawn_options import PlaceSeeds, TownOptions
from coopsim.world.places.description import MapLane, MapStart, MapUnit
from coopsim.world.towns.scenarios import TownScenarios
from coopsim.world.towns.starts import bring_near, off_roads
from coopsim.world.towns.town import describe_streets, draw_place


def _brought_near(cars: list[list[float]], masts: list[list[float]]) -> tuple[list[int], list[list[float]]]:
    starts = [MapStart((), float(k), connected=k + 1) for k in range(len(cars))]
    found, units = bring_near(starts, np.array(cars), [_mast(*at) for at in masts])
    assert [start.connected for start in found] == list(range(1, len(cars) + 1))
    return [int(start.at_m) for start in found], [list(unit.at) for unit in units]


def _mast(x: float, y: float) -> MapUnit:
    return MapUnit((x, y), (0.0, 0.0))


def test_masts_near_the_cars_come_first_and_near_each_other() -> None:
    order, masts = _brought_near(
        [[0.0, 0.0], [40.0, 0.0], [20.0, 0.0]], [[120.0, 0.0], [-30.0, 0.0], [60.0, 0.0], [20.0, 10.0]]
    )
    assert order == [0, 1, 2]
    # The third is 90 m from the second, which is taken before it.
    assert masts == [[-30.0, 0.0], [20.0, 10.0], [120.0, 0.0], [60.0, 0.0]]


def test_other_cars_come_first_where_the_usual_ones_are_too_far_apart() -> None:
    cars = [[0.0, 60.0], [0.0, 80.0], [0.0, 100.0], [0.0, 40.0], [10.0, 30.0]]
    order, masts = _brought_near(cars, [[0.0, 0.0], [20.0, 0.0]])
    assert sorted(order[:3]) == [0, 3, 4] and masts == [[0.0, 0.0], [20.0, 0.0]]


def test_where_none_are_near_each_other_all_stay() -> None:
    cars = [[0.0, 0.0], [200.0, 0.0], [400.0, 0.0]]
    order, masts = _brought_near(cars, [[900.0, 0.0]])
    assert order == [0, 1, 2] and masts == [[900.0, 0.0]]


@pytest.mark.parametrize("place", [259, 472])  # where the cars next to the middle are too far from the masts
def test_agents_of_awkward_towns_start_near_each_other(place: int) -> None:
    scenario = TownScenarios(PlaceSeeds(place), TownOptions(), 1.0, None, {}).of(place)
    assert find_faults(scenario, place) == []


NODES = {"a": (0.0, 0.0), "b": (20.0, 0.0), "c": (40.0, 20.0)}
ROADS = [MapLane("a", "b"), MapLane("b", "c", centre=(20.0, 20.0), turn="left")]


def test_masts_on_lanes_are_left_out() -> None:
    beside = [_mast(10.0, 2.3), _mast(34.0, 12.0), _mast(20.0, 40.0)]
    on = [_mast(10.0, 2.0), _mast(20.0 + 20.0 * 0.6, 20.0 - 20.0 * 0.8)]
    assert off_roads([*beside, *on], NODES, ROADS) == beside


def test_a_town_with_a_wide_turn_can_be_read() -> None:
    assert len(describe_streets(5549).rsus) >= 2
    assert len(draw_place(5549).make_layout().rsus) >= 2
