"""Traffic lights of drawn towns: where they are, what they say, and who obeys."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from coopsim.errors import InvalidValueError
from coopsim.world.drawn_options import PlaceSeeds, TownOptions
from coopsim.world.places.description import PlaceDescription
from coopsim.world.scenario import Place
from coopsim.world.towns.planning import draw_plan
from coopsim.world.towns.scenarios import TownScenarios
from coopsim.world.towns.town import describe_streets, draw_place
from coopsim.world.world import World

LIT = TownOptions(junctions=1, lanes=2, traffic_lights=True)


@pytest.fixture(scope="module")
def lit() -> Place:
    return draw_place(3, LIT)


def test_towns_have_lights_only_where_asked_and_are_else_the_same() -> None:
    bare, lit = (describe_streets(3, replace(LIT, traffic_lights=flag)) for flag in (False, True))
    assert bare.signals == () and len(lit.signals) == 1 and "signals" not in bare.plain
    assert replace(lit, signals=()) == bare
    assert lit == describe_streets(3, LIT)
    with pytest.raises(InvalidValueError, match="traffic_lights must be True or False"):
        TownOptions(traffic_lights="yes")  # type: ignore[arg-type]


def test_each_way_and_crosswalk_of_main_junctions_has_a_light_and_roundabouts_have_none() -> None:
    for seed in range(6):
        options = TownOptions(traffic_lights=True)
        plan, town = draw_plan(seed, options), describe_streets(seed, options)
        main = [
            junction
            for junction in plan.junctions
            if junction.kind != "roundabout"
            and (junction.kind == "priority" or junction.lanes > 1 or junction.number == plan.meeting)
        ]
        assert len(town.signals) == len(main)
        for signal, junction in zip(town.signals, main, strict=True):
            arms = {street.number for street in plan.streets} & {arm.street for arm in junction.arms}
            assert {_street(road[0]) for road in signal.roads} == {_street(road[1]) for road in signal.roads} == arms
            assert 2 <= len(signal.crosswalks) <= len(arms)
            assert all(len(phase.state) == len(signal.roads) + len(signal.crosswalks) for phase in signal.phases)


def _street(node: str) -> int:
    return int(node[1:].split("f")[0].split("b")[0])


def test_each_approach_has_one_head_with_three_lamps(lit: Place) -> None:
    description = lit.description
    assert isinstance(description, PlaceDescription) and description.furniture is not None
    heads = [piece for piece in description.furniture if piece.kind == "traffic_light"]
    arms = {_street(road[0]) for road in description.signals[0].roads}
    lamps = [part.lamp for part in lit.make_layout().furnishing if part.lamp is not None]
    assert len(heads) == len(arms) and len(lamps) == 3 * len(heads)
    shown = [description.signals[0].roads[number] for number in {lamp[0] for lamp in lamps}]
    assert {_street(road[0]) for road in shown} == arms
    assert {road[0].split(".")[0][-1] for road in shown} == {"1"}  # of the outer lane, beside which the head stands


def test_a_town_with_lights_is_the_same_from_a_file(lit: Place) -> None:
    from coopsim.world.custom.place import place_from

    again = place_from(lit.description.plain, "again").make_layout()  # type: ignore[union-attr]
    layout = lit.make_layout()
    assert again.signals == layout.signals
    assert [part.lamp for part in again.furnishing] == [part.lamp for part in layout.furnishing]


def test_nobody_drives_or_walks_at_red() -> None:
    scenarios = TownScenarios(PlaceSeeds(3), LIT, 1.0, None, {})
    world = World(scenarios.of(3), 3)
    network, people = world._traffic._network, world._people[0]
    roads = [road for signal in world._signals for road in signal.roads]
    light = {network.road_number[road]: k for k, road in enumerate(roads)}
    before, passed, begun = dict[int, int](), 0, people._goes.copy()
    for _ in range(450):
        world.step(0.1)
        rows = world.fleet.rows
        road = network.arrays.lanes["road"][rows["target_lane"]]
        for number, here in zip(rows["id"].tolist(), road.tolist(), strict=True):
            if here in light and before.get(number) not in light:
                passed += 1
                assert world.map.lights[light[here]] != "r"
            before[number] = here
        starts = people._goes & ~begun & people._itinerary.crosses()
        assert not (starts & people._itinerary.is_on(world._red)).any()
        begun = people._goes.copy()
    assert passed >= 5 and world.crashed() == ()


def test_vehicles_that_start_near_a_line_can_stop_there() -> None:
    """Seed 11 has a vehicle 14 m before a light that turns red within a second."""
    options = TownOptions(traffic_lights=True)
    world = World(TownScenarios(PlaceSeeds(11), options, 1.0, None, {}).of(11), 11)
    lines = np.array(world.map.stop_lines)
    rows = world.fleet.rows
    across = lines[:, 1] - lines[:, 0]
    ahead = np.column_stack([across[:, 1], -across[:, 0]]) / np.linalg.norm(across, axis=1)[:, None]
    offset = lines.mean(axis=1) - np.column_stack([rows["x"], rows["y"]])[:, None]
    away_m, aside_m = (offset * ahead).sum(axis=2), np.abs(offset[..., 0] * ahead[:, 1] - offset[..., 1] * ahead[:, 0])
    same = np.cos(rows["heading"])[:, None] * ahead[:, 0] + np.sin(rows["heading"])[:, None] * ahead[:, 1] > 0.99
    near = same & (aside_m < 1.5) & (away_m > 0) & (away_m < 30) & (rows["target_speed"] > 0)[:, None]
    vehicle, line = np.nonzero(near)
    front_m = away_m[vehicle, line] - rows["length"][vehicle] / 2
    assert len(front_m) and (rows["speed"][vehicle] ** 2 <= 2 * 2.5 * front_m).all()
