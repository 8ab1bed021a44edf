"""The crossing: buildings hide its arms from each other, people keep to the ways made for them, policies can stop."""

import numpy as np
import pytest
from numpy.typing import NDArray
from shapely import LineString, MultiPoint, Polygon, contains_xy, union_all
from worlds import DT_S, frames, make_world, people, speed_of

from coopsim.types.messages import MANEUVERS
from coopsim.world.scenario import make_scenario

MAP = make_scenario("crossing").layout.road_map
BUILDINGS = union_all([Polygon(outline) for outline in MAP.buildings])


def test_buildings_hide_every_arm_from_its_neighbours() -> None:
    for distance_m in (30.0, 60.0):
        arms = distance_m * np.array([[1, 0], [0, 1], [-1, 0], [0, -1]])
        for k in range(4):
            assert LineString([arms[k], arms[(k + 1) % 4]]).intersects(BUILDINGS)
            assert not LineString([arms[k], arms[(k + 2) % 4]]).intersects(BUILDINGS)  # along the road


def test_walls_stand_on_their_footprints() -> None:
    walls = [part for part in make_scenario("crossing").layout.static if part.name == "building"]
    assert walls
    for wall, outline in zip(walls, MAP.buildings, strict=True):
        assert MultiPoint(wall.vertices[:, :2]).convex_hull.equals(Polygon(outline))
        assert wall.vertices[:, 2].min() == 0.0 and wall.vertices[:, 2].max() > 4


@pytest.fixture(scope="module")
def walks() -> NDArray[np.float64]:
    """(T, N, 4) positions and velocities of many people for a minute, among little traffic."""
    world = make_world("crossing", 2, vehicles=3, connected_cars=1, pedestrians=40)
    seen = [people(actors) for actors in frames(world, 600)]
    return np.stack([np.column_stack([actors.boxes.center[:, :2], actors.velocity]) for actors in seen])


def test_people_stay_on_pavements_and_crosswalks(walks: NDArray[np.float64]) -> None:
    x, y = walks[..., 0], walks[..., 1]
    assert not contains_xy(BUILDINGS.buffer(0.3), x, y).any()
    on_road = contains_xy(union_all([Polygon(outline) for outline in MAP.lanes]).buffer(-0.1), x, y)
    # Where a corner is cut for those who turn right, a crosswalk begins up to 0.7 m before its stripes.
    on_crosswalk = contains_xy(union_all([Polygon(outline) for outline in MAP.crosswalks]).buffer(0.7), x, y)
    assert not (on_road & ~on_crosswalk).any()
    assert contains_xy(union_all([Polygon(outline) for outline in MAP.pavements]), x, y).mean() > 0.7


def test_people_cross_roads(walks: NDArray[np.float64]) -> None:
    # Who crosses arm 0 or 2 goes from one side of its middle line to the other, near the crosswalk.
    sides = np.sign(walks[..., 1]) * (np.abs(walks[..., 0]) > 8)
    crossed = ((sides[1:] * sides[:-1]) < 0).any(axis=0)
    assert crossed.sum() >= 5


def test_people_walk_at_walking_speed(walks: NDArray[np.float64]) -> None:
    speeds = np.hypot(walks[1:, :, 2], walks[1:, :, 3])
    assert speeds.max() <= 1.6 + 1e-9
    assert (speeds.max(axis=0) >= 1.0).all()  # everybody gets going
    assert speeds.mean() > 0.8


def test_a_policy_can_stop_at_the_crossing_and_go_on() -> None:
    world = make_world("crossing", 0, vehicles=3, pedestrians=0, connected_cars=1, control="policy")
    reached = []
    for maneuver in ("slower", "faster"):
        for _ in range(40):
            world.step(DT_S, {"cav_0": MANEUVERS.index(maneuver)})
        reached.append(speed_of(world, "cav_0"))
    assert reached[0] < 0.1
    assert 5 < reached[1] < 11.5
