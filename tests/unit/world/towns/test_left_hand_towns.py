"""Towns with traffic on the left are those on the right in a mirror, and what stands and drives in them is, too."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import coopsim
from coopsim.cli import main
from coopsim.errors import UnknownNameError
from coopsim.geometry.se3 import Floats
from coopsim.world.drawn_options import TownOptions
from coopsim.world.drawn_places import choose_scenarios
from coopsim.world.places.road_network import StraightLane
from coopsim.world.scenario import Scenario
from coopsim.world.towns.town import describe_town, mirrored
from coopsim.world.world import World

SMALL = TownOptions(junctions=1)
LEFT = replace(SMALL, traffic_side="left")
ALONE = {"pedestrians": 0, "children": 0, "bicycles": 0, "scooters": 0, "place_seed": 3, "junctions": 1}


def town(side: str) -> Scenario:
    return choose_scenarios("town", traffic_side=side, **ALONE).of(3)


def reflected(points: Any) -> Floats:
    """Return points (..., 2) or more with -y for y."""
    found = np.array(points, dtype=np.float64)
    found[..., 1] *= -1
    return found


def test_the_description_is_that_of_the_right_in_a_mirror() -> None:
    right, left = describe_town(3, SMALL), describe_town(3, LEFT)
    assert (right.traffic_side, left.traffic_side) == ("right", "left")
    assert "traffic_side" not in right.plain and left.plain["traffic_side"] == "left"
    again = mirrored(left)
    assert replace(again, furniture=None) == replace(right, furniture=None)
    for one, other in zip(right.furniture or (), again.furniture or (), strict=True):
        turned_deg = (one.heading_deg or 0.0) - (other.heading_deg or 0.0)  # headings beyond half a turn are wrapped
        assert replace(one, heading_deg=None) == replace(other, heading_deg=None) and abs(turned_deg % 360.0) < 1e-9
    assert {each.turn for each in left.roads} >= {None, "left", "right", "around"}
    for name, at in right.nodes.items():
        assert left.nodes[name] == (at[0], -at[1])


def test_vehicles_move_as_in_the_mirror() -> None:
    worlds = [World(town(side), 5) for side in ("right", "left")]
    for _ in range(80):
        for world in worlds:
            world.step(0.1)
    right, left = (world.actors() for world in worlds)
    assert len(right) > 10 and np.abs(right.velocity).max() > 3.0
    np.testing.assert_allclose(left.boxes.center, reflected(right.boxes.center), atol=1e-9)
    np.testing.assert_allclose(left.velocity, reflected(right.velocity), atol=1e-9)
    np.testing.assert_allclose(np.sin(left.boxes.yaw), -np.sin(right.boxes.yaw), atol=1e-9)
    np.testing.assert_array_equal(left.model, right.model)


@pytest.mark.parametrize(("side", "sign"), [("right", 1), ("left", -1)])
def test_oncoming_traffic_is_on_the_inner_side(side: str, sign: int) -> None:
    layout, found = town(side).layout, []
    assert (layout.road_map.traffic_side, layout.outer_side) == (side, -sign)
    lanes = [lane for lane in layout.network.lanes.values() if isinstance(lane, StraightLane)]
    for lane in lanes:
        here, ahead = lane.position(lane.length / 2, 0.0), lane.direction
        for other in lanes:
            along, aside = other.local_coordinates(here)
            if 0 < along < other.length and abs(aside) < 5.0 and ahead @ other.direction < -0.99:
                found.append(np.sign(aside))  # the oncoming lane sees this one on the same side
    assert len(found) > 4 and set(found) == {sign}


def test_buildings_and_masts_stand_in_the_mirror_and_roads_look_up() -> None:
    right, left = (town(side) for side in ("right", "left"))
    walls = [[part.vertices for part in each.static if part.name == "building"] for each in (right, left)]
    assert len(walls[0]) > 10
    for one, other in zip(*walls, strict=True):
        np.testing.assert_allclose(np.sort(reflected(other)[:, :2], axis=0), np.sort(one[:, :2], axis=0), atol=1e-9)
    road = next(part for part in left.static if part.name == "road")
    a, b, c = (road.vertices[road.faces[:, k]] for k in range(3))
    assert (np.cross(b - a, c - a)[:, 2] > 0).all()
    for one, other in zip(right.layout.rsus, left.layout.rsus, strict=True):
        np.testing.assert_allclose(other.translation, reflected(one.translation[None])[0])
        np.testing.assert_allclose(other.rotation[:2, 0], one.rotation[:2, 0] * [1, -1], atol=1e-9)


def test_the_environment_tells_the_side() -> None:
    env = coopsim.parallel_env("town", traffic_side="left", place_seed=3, junctions=1, lidar=None)
    assert env.road_map.traffic_side == "left"
    env.close()


@pytest.mark.parametrize("wrong", ["up", "Left", 1, None])
def test_a_word_that_is_no_side_is_refused(wrong: Any) -> None:
    with pytest.raises(UnknownNameError, match=r"unknown traffic_side .*Accepted: left, right") as error:
        TownOptions(traffic_side=wrong)
    assert "\n" not in str(error.value)


def test_the_command_writes_a_town_on_the_left(tmp_path: Path) -> None:
    file = tmp_path / "town.yaml"
    assert main(["town", "draw", "3", "--junctions", "1", "--traffic-side", "left", "--out", str(file)]) == 0
    assert "traffic_side: left" in file.read_text()
