"""Traffic lights: programs, what they open and close, and who obeys them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from lit_crossing import crossing

from coopsim.errors import InvalidValueError
from coopsim.types.driving import GIVES_WAY
from coopsim.world.custom.place import place_from
from coopsim.world.places.signals import Signal
from coopsim.world.scenario import make_scenario
from coopsim.world.traffic.asked import GRANTED
from coopsim.world.traffic.movements import FIRST, YIELDS
from coopsim.world.traffic.traffic import Traffic
from coopsim.world.world import World


def lit_world(seed: int = 3, control: str = "traffic", **numbers: int) -> World:
    usual = {"vehicles": 14, "buses": 0, "connected_cars": 2, "rsus": 0, "drones": 0, "pedestrians": 6}
    scenario = make_scenario(place_from(crossing(lights=True, cut=False), "lit"), **(usual | numbers))
    return World(scenario, seed, control=control)


def test_a_program_repeats_with_its_offset() -> None:
    signal = Signal((), (), ((2.0, "G"), (1.0, "y"), (3.0, "r")), offset_s=0.5)
    shown = "".join(signal.state(k / 2) for k in range(14))
    assert shown == "r" + "GGGGyyrrrrrr" + "G"
    assert signal.state(600 * 0.1 + 0.5) == "G"  # ten programs later, with the rounding of steps


def test_lights_open_and_close_movements() -> None:
    world = lit_world(vehicles=1, connected_cars=1)
    layout = place_from(crossing(lights=True, cut=False), "lit").make_layout()
    lights, number = world._traffic._engine.lights, {road: k for k, road in enumerate(layout.movements)}
    east, left, north = number["in0", "out2"], number["in0", "out3"], number["in1", "out3"]
    oncoming = number["in2", "out0"]
    now = lights.movements
    assert now.closed[[east, left, north]].tolist() == [False, False, True]
    assert now.role[[east, left]].tolist() == [FIRST, YIELDS] and now.clears.all()
    assert now.yields[left, oncoming] and not now.yields[:, north].any() and not now.yields[east].any()
    assert world.map.lights[layout.signals[0].roads.index(("in0", "out3"))] == "g"
    for _ in range(125):
        world.step(0.1)
    assert lights.movements.closed.all() and "y" in world.map.lights  # yellow
    for _ in range(50):
        world.step(0.1)
    assert not lights.movements.closed[north] and world.map.lights.count("G") == 4
    assert len(world.map.stop_lines) == len(world.map.lights) == 12


def test_nobody_drives_or_walks_at_red_and_all_get_on() -> None:
    world = lit_world()
    layout = place_from(crossing(lights=True, cut=False), "lit").make_layout()
    network, people = world._traffic._network, world._people[0]
    light = {network.road_number[road]: k for k, road in enumerate(layout.signals[0].roads)}
    before, passed, stood_s, begun, crossed = dict[int, int](), 0, dict[int, float](), people._goes.copy(), 0
    for _ in range(1200):
        world.step(0.1)
        rows = world.fleet.rows
        road = network.arrays.lanes["road"][rows["target_lane"]]
        for number, here, speed in zip(rows["id"].tolist(), road.tolist(), rows["speed"].tolist(), strict=True):
            if here in light and before.get(number) not in light:
                passed += 1
                assert world.map.lights[light[here]] != "r"
            before[number] = here
            stood_s[number] = stood_s.get(number, 0.0) + 0.1 if speed < 0.5 else 0.0
        starts = people._goes & ~begun & people._itinerary.crosses()
        crossed += starts.sum()
        assert not (starts & people._itinerary.is_on(world._red)).any()
        begun = people._goes.copy()
        assert max(stood_s.values()) < 102  # three programs: people walk across two arms, too
    assert passed > 15 and crossed > 3 and world.crashed() == ()


def test_a_vehicle_that_can_stop_loses_its_grant_at_yellow_and_one_that_cannot_keeps_it() -> None:
    kept = {}
    for at_m in (30.0, 6.0):
        world = lit_world(vehicles=1, connected_cars=0, pedestrians=0, drones=1)
        lights, row = world._traffic._engine.lights, world.fleet.rows[0]
        for _ in range(118):
            lights.step(0.1)
        lane = world._traffic._network.lane_number["in0.", "in0", 0]
        row["x"], row["y"], row["heading"], row["speed"] = 14.0 + at_m, 1.6, np.pi, 9.0
        row["lane"] = row["target_lane"] = lane
        row["route_length"] = 0
        tickets = []
        for _ in range(4):
            world.step(0.1)
            tickets.append(int(world.fleet.rows["ticket"][0]))
        kept[at_m] = (tickets[0], tickets[-1])
    assert kept[6.0] == (GRANTED, GRANTED) and kept[30.0][0] == GRANTED < kept[30.0][1]


def test_planners_see_red_as_a_limit_and_stop() -> None:
    world = lit_world(vehicles=1, connected_cars=1, pedestrians=0, control="planner")
    row, network = world.fleet.rows[0], world._traffic._network
    row["lane"] = row["target_lane"] = network.lane_number["in1.", "in1", 0]
    row["x"], row["y"], row["heading"], row["speed"], row["route_length"] = -1.6, 50.0, -np.pi / 2, 8.0, 0
    route = world.car_ahead("cav_0").route
    red = np.flatnonzero(route.speed_limit_m_s == 0.0)
    stop_m = 50 - 14 - row["length"] / 2 - 1  # the front is 1 m before the line then
    assert stop_m - route.spacing_m <= red[0] * route.spacing_m < stop_m and len(red) == len(route.points) - red[0]
    assert (route.right_of_way[red] == GIVES_WAY).all()


def test_a_planned_car_that_stands_at_the_line_stays_there_at_red() -> None:
    """A short car has its middle less than 2 m before the line then."""
    world = lit_world(vehicles=1, connected_cars=1, pedestrians=0, control="planner")
    row, network = world.fleet.rows[0], world._traffic._network
    row["lane"] = row["target_lane"] = network.lane_number["in1.", "in1", 0]
    row["x"], row["y"], row["heading"], row["route_length"] = -1.6, 15.7, -np.pi / 2, 0
    for speed, stops in ((0.0, True), (1.3, True), (8.0, False)):
        row["speed"] = speed
        assert (world.car_ahead("cav_0").route.speed_limit_m_s[0] == 0.0) == stops


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"phases": ()}, "phases must be at least one"),
        ({"roads": (("in0", "out0"),)}, "roads must be a road"),
        ({"crosswalks": (("b", "z"),)}, "node of walks"),
    ],
)
def test_mistakes_are_named(change: dict[str, object], message: str) -> None:
    given = crossing(lights=True)
    with pytest.raises(InvalidValueError, match=message):
        place_from(replace(given, signals=(replace(given.signals[0], **change),)), "wrong")


def test_states_must_fit_and_a_road_has_one_light() -> None:
    given = crossing(lights=True)
    signal, phase = given.signals[0], given.signals[0].phases[0]
    for wrong, message in (
        (replace(phase, state="G"), "state must be 13 of the letters G, g, y, r"),
        (replace(phase, state="x" * 13), "state must be 13 of the letters G, g, y, r"),
        (replace(phase, seconds=0.0), "seconds must be at least 1"),
    ):
        with pytest.raises(InvalidValueError, match=message):
            place_from(replace(given, signals=(replace(signal, phases=(wrong,)),)), "wrong")
    with pytest.raises(InvalidValueError, match="a road has one light"):
        place_from(replace(given, signals=(signal, signal)), "wrong")


def test_highway_env_is_refused() -> None:
    scenario = make_scenario(place_from(crossing(lights=True, cut=False), "lit"), vehicles=2)
    with pytest.raises(InvalidValueError, match='traffic must be "arrays"'):
        Traffic(scenario.layout, scenario.population, scenario.models, 0, engine="highway-env")
