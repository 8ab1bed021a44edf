"""Described places with curved lanes: read, refused, laid, driven."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from curved_roads import oval

from coopsim.envs.simulated.scenario_file import load_scenario_file, write_scenario_file
from coopsim.errors import InvalidValueError
from coopsim.world.custom.groundworks import carriageways
from coopsim.world.custom.place import place_from
from coopsim.world.furniture.free_ground import middle_of
from coopsim.world.places.description import MapLane, PlaceDescription
from coopsim.world.places.polyline import PolylineLane
from coopsim.world.scenario import make_scenario
from coopsim.world.traffic.traffic import Traffic
from coopsim.world.world import World


def test_a_curved_lane_is_one_lane_in_files_too(tmp_path) -> None:
    place = place_from(oval(), "oval")
    lanes = place.make_layout().network.lanes
    assert len(lanes) == 2 and all(isinstance(lane, PolylineLane) for lane in lanes.values())
    path = write_scenario_file(tmp_path / "oval.yaml", place.description, population={"vehicles": 2})
    assert load_scenario_file(path).scenario.description == place.description


def test_vehicles_of_all_lengths_follow_a_tight_curve() -> None:
    scenario = make_scenario(place_from(oval(12.0, 60.0, 8, speed_m_s=12), "oval"), vehicles=4, buses=1, rsus=0)
    world, lanes = World(scenario, 3), list(scenario.layout.network.lanes.values())
    asides_m, speeds_m_s = [], []
    for _ in range(300):
        world.step(0.1)
        asides_m += [min(abs(lane.local_coordinates(at)[1]) for lane in lanes) for at in world.fleet.position]
        speeds_m_s += world.fleet.rows["speed"].tolist()
    assert world.crashed() == () and max(asides_m) < 1.3
    assert max(speeds_m_s) > 11 and min(speeds_m_s[-40:]) < 8  # they slow down in the bend, which allows 4.9 m/s


def test_starts_are_on_straight_parts() -> None:
    layout = place_from(oval(20.0), "oval").make_layout()
    lanes = layout.network.lanes
    assert layout.slots and all(abs(lanes[slot.lane].position(slot.along_m, 0.0)[0]) < 50 for slot in layout.slots)


def test_surfaces_follow_the_curve() -> None:
    layout = place_from(replace(oval(20.0, width_m=3.5), crown=0.02, kerb_m=0.1), "oval").make_layout()
    ways = carriageways(layout.network, [("b", "a")])
    bent = np.vstack([way.line for way in ways])
    radius_m = np.hypot(np.abs(bent[:, 0]) - 50.0, bent[:, 1])[np.abs(bent[:, 0]) > 51]
    assert len(radius_m) > 10 and np.allclose(radius_m, 20.0, atol=0.3)
    assert {way.half_m for way in ways} == {1.75}
    assert all(len(middle_of(lane)) == 14 for lane in layout.network.lanes.values())
    assert len(layout.road_map.lanes) > 2 * 13


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"via": ((0, -30), (0.05, -30))}, "points of a curved lane must be 0.1 m apart or more"),
        (
            {"via": ((0, -30), (0, 10))},
            "a curved lane must turn by 45 degrees at most at each point, got 90",
        ),
        ({"turn": "around"}, "a bend has both centre and turn"),
        ({"widths_m": (3, 3)}, "widths_m must be 14 numbers"),
    ],
)
def test_mistakes_are_named(change: dict[str, object], message: str) -> None:
    given = oval()
    lanes = (replace(given.roads[0], **change), given.roads[1])
    with pytest.raises(InvalidValueError, match=r"roads\[0\]") as caught:
        place_from(replace(given, roads=lanes), "wrong")
    assert message in str(caught.value)


def test_highway_env_is_refused_for_curved_lanes() -> None:
    scenario = make_scenario(place_from(oval(), "oval"), vehicles=2)
    with pytest.raises(InvalidValueError, match='traffic must be "arrays" where lanes are curved'):
        Traffic(scenario.layout, scenario.population, scenario.models, 0, engine="highway-env")


def test_widths_change_along_a_curved_lane() -> None:
    roads = (
        MapLane("a", "b", ((30.0, 0.0),), curved=True, widths_m=(3.0, 3.0, 5.0)),
        MapLane("b", "c", turn="around"),
        MapLane("c", "d"),
        MapLane("d", "a", turn="around"),
    )
    nodes = {"a": (0.0, 0.0), "b": (60.0, 0.0), "c": (60.0, 5.0), "d": (0.0, 5.0)}
    layout = place_from(PlaceDescription(nodes=nodes, roads=roads), "funnel").make_layout()
    lane = layout.network.get_lane(("a", "b", 0))
    np.testing.assert_allclose(lane.widths_at(np.array([0.0, 15.0, 45.0, 60.0])), [3.0, 3.0, 4.0, 5.0])
    assert max(outline[:, 1].min() for outline in layout.road_map.lanes) > -2.6
