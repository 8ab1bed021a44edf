"""Expected returns without a LiDAR, against those of a LiDAR."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import shapely
import shapely.affinity
from hypothesis import given, settings
from hypothesis import strategies as st
from sensor_scenes import actors, box_part, ground, triangles

from coopsim.geometry.boxes import Boxes3D
from coopsim.geometry.se3 import SE3
from coopsim.sensors.lidar.expected_returns import ReturnsEstimator
from coopsim.sensors.lidar.lidar import Lidar, LidarConfig
from coopsim.sensors.lidar.patterns import BeamPattern
from coopsim.sensors.lidar.returns import count_returns
from coopsim.sensors.scene import RayScene, SceneGeometry
from coopsim.sensors.weather import Weather
from coopsim.support.rng import stream
from coopsim.world.scenario import make_scenario
from coopsim.world.snapshot import Actors, StaticPart
from coopsim.world.world import World

SENSOR_M = np.array([0.0, 0.0, 2.0])
BEAMS = LidarConfig().beams


def expected(who, static=(), **config):  # type: ignore[no-untyped-def]
    sight = ReturnsEstimator(static, BEAMS, config.get("columns", 1024), config.get("range_m", 120.0))
    return sight.expected_returns(SENSOR_M[None], who, [config.get("own_id")])[0]


@pytest.mark.parametrize("weather", [None, Weather(fog_visibility_m=100.0), Weather(rain_mm_h=20.0)])
@pytest.mark.parametrize("name", ["crossing", "highway"])
def test_agrees_with_the_lidar_in_traffic(name: str, weather: Weather | None) -> None:
    world = World(make_scenario(name), seed=3)
    lidar, geometry = Lidar(LidarConfig(), weather), SceneGeometry(world.models, world.static)
    sight = ReturnsEstimator(world.static, BEAMS, 1024, 120.0, weather)
    want, got = [], []
    for _ in range(5):
        for _ in range(5):
            world.step(0.1)
        who = world.actors()
        scene = RayScene(geometry.triangles(who))
        for body in world.agents().values():
            rng = stream(0, "lidar", body.name)
            sweep = lidar.sense(scene, body.world_SE3_base, body.height_m, body.actor_id, rng)
            want.append(count_returns({"lidar": sweep}, who.id))
            at = body.world_SE3_base.apply(lidar.config.base_SE3_sensor(body.height_m).translation)
            got.append(sight.expected_returns(at[None], who, [body.actor_id])[0])
    real, imagined = np.concatenate(want), np.concatenate(got)
    assert ((real > 0) == (imagined > 0)).mean() > (0.9 if weather is None else 0.85)
    assert 0.8 < imagined.sum() / real.sum() < 1.25
    often = real >= 20
    assert 0.7 < np.median(imagined[often] / real[often]) < 1.4


def tall(rows: np.ndarray) -> Actors:
    """Return actors as high as towers, so that occlusion is that of their footprints: x, y, length, width, yaw."""
    boxes = Boxes3D(
        np.insert(rows[:, :2], 2, 50.0, axis=1), np.insert(rows[:, 2:4], 2, 100.0, axis=1), np.asarray(rows[:, 4])
    )
    zeros = np.zeros(len(rows), dtype=int)
    return Actors(np.arange(1, len(rows) + 1), boxes, np.zeros((len(rows), 2)), zeros, zeros, np.zeros((len(rows), 3)))


def from_above(box: np.ndarray) -> shapely.Polygon:
    x, y, length, width, yaw = box.tolist()
    flat = shapely.box(x - length / 2, y - width / 2, x + length / 2, y + width / 2)
    return shapely.affinity.rotate(flat, yaw, (x, y), use_radians=True)


@settings(max_examples=40)
@given(seed=st.integers(0, 2**32 - 1), count=st.integers(2, 25))
def test_lines_are_blocked_as_shapely_says(seed: int, count: int) -> None:
    rng = np.random.default_rng(seed)
    around = rng.uniform(5.0, 60.0, count), rng.uniform(-np.pi, np.pi, count)
    sizes = rng.uniform(0.5, 12.0, count), rng.uniform(0.5, 3.0, count), rng.uniform(-np.pi, np.pi, count)
    rows = np.column_stack([around[0] * np.cos(around[1]), around[0] * np.sin(around[1]), *sizes])
    shapes, want = [from_above(row) for row in rows], []
    if any(shape.distance(shapely.Point(0, 0)) < 1.0 for shape in shapes):
        return
    for k, (x, y, length, width, yaw) in enumerate(rows):
        distance, aside = np.hypot(x, y), np.arctan2(y, x) - yaw
        across = length * abs(np.sin(aside)) + width * abs(np.cos(aside))
        ends = [(x - y / distance * part * across, y + x / distance * part * across) for part in (-0.4, 0.0, 0.4)]
        others = shapely.union_all(shapes[:k] + shapes[k + 1 :])
        want.append(sum(not shapely.LineString([(0, 0), end]).intersects(others) for end in ends))
    # So many columns that thirds of the returns can be told apart with few beams.
    alone = [int(expected(tall(row[None]), columns=10**6)[0]) for row in rows]
    got = expected(tall(rows), columns=10**6)
    assert np.rint(3 * got / np.array(alone)).tolist() == want


def test_the_count_falls_with_range_and_stops_at_the_last() -> None:
    who = actors([[10.0, 0.0, 0.0], [20.0, 30.0, 0.0], [-80.0, 10.0, 0.0], [-119.0, -30.0, 0.0]])
    near, middle, far, beyond = expected(who)
    assert near > 4 * middle > 16 * far > 0 == beyond
    assert expected(who, range_m=30.0)[2] == 0


def test_the_thicker_the_fog_the_fewer_and_the_nearer_returns() -> None:
    who = actors([[10.0, 0.0, 0.0], [-20.0, 30.0, 0.0], [60.0, 25.0, 0.0]])
    counts = [expected(who)]
    for visibility_m in (500.0, 150.0, 50.0):
        sight = ReturnsEstimator((), BEAMS, 1024, 120.0, Weather(fog_visibility_m=visibility_m))
        counts.append(sight.expected_returns(SENSOR_M[None], who, [None])[0])
    assert (np.diff(counts, axis=0) <= 0).all()
    assert counts[-1][0] > 0.9 * counts[0][0] and counts[-1][2] == 0 < counts[1][2]


def test_twice_the_columns_are_twice_the_returns() -> None:
    who = actors([[10.0, 0.0, 0.0], [20.0, 30.0, 0.5]])
    np.testing.assert_allclose(expected(who, columns=2048), 2 * expected(who), atol=1)


def test_a_wall_hides_what_is_behind_and_a_gap_does_not() -> None:
    who = actors([[30.0, 0.0, 0.0]])
    free = expected(who)[0]
    assert expected(who, [ground(), box_part([15.0, 0.0, 5.0], (0.3, 12.0, 10.0))])[0] == 0
    assert expected(who, [ground(), box_part([15.0, 8.0, 5.0], (0.3, 12.0, 10.0))])[0] == free > 0
    half = expected(who, [box_part([15.0, 3.0, 5.0], (0.3, 6.0, 10.0))])[0]
    assert 0.2 * free < half < 0.8 * free


def test_components_of_one_part_hide_separately() -> None:
    left, right = box_part([15.0, 8.0, 5.0], (0.3, 12.0, 10.0)), box_part([15.0, -8.0, 5.0], (0.3, 12.0, 10.0))
    both = StaticPart(
        "both",
        np.concatenate([left.vertices, right.vertices]),
        np.concatenate([left.faces, right.faces + len(left.vertices)]),
        left.color,
        left.reflectivity,
    )
    who = actors([[30.0, 0.0, 0.0]])
    assert expected(who, [both])[0] == expected(who)[0]


def test_actors_hide_each_other_but_not_themselves_and_a_carrier_hides_nothing() -> None:
    who = actors([[0.0, 0.0, 0.0], [10.0, 0.0, np.pi / 2], [22.0, 0.0, 0.0]], model=[0, 0, 1])
    own, near, behind = expected(who, own_id=1)
    assert own == 0 and near > 0 and behind < expected(who[np.array([0, 2])], own_id=1)[1]


def test_nobody_there() -> None:
    assert expected(actors([]), [ground()]).shape == (0,)


def test_the_ground_hides_nothing() -> None:
    scene, who = [ground()], actors([[12.0, 3.0, 0.4]])
    assert expected(who, scene)[0] == expected(who)[0]
    assert len(Lidar(LidarConfig()).sense(RayScene(triangles(who, scene)), SE3.identity(), 1.65, None, stream(0, "l")))


def test_a_turned_building_hides_what_its_own_box_covers_and_no_more() -> None:
    """A wall along a diagonal: the upright box around it would hide a square of 30 x 30 m."""
    turned = box_part([25.0, 15.0, 5.0], (42.0, 0.5, 10.0), yaw_rad=np.pi / 4)
    own = replace(turned, closed=True, boxes=np.array([[25.0, 15.0, 5.0, 42.0, 0.5, 10.0, np.pi / 4]]))
    who = actors([[15.0, 12.0, 0.0], [30.0, 8.0, 0.0]])  # both within the square, on either side of the wall
    free, around, exact = expected(who), expected(who, [turned]), expected(who, [own])
    assert free.min() > 0 and around.tolist() == [0, 0]
    assert exact.tolist() == [free[0], 0]


def test_an_open_surface_has_no_box_but_its_own() -> None:
    who = actors([[30.0, 0.0, 0.0]])
    box = box_part([15.0, 0.0, 5.0], (0.3, 12.0, 10.0))
    assert expected(who, [replace(box, closed=False)])[0] == expected(who)[0]
    assert expected(who, [replace(box, boxes=np.zeros((0, 7)))])[0] == expected(who)[0]
    assert expected(who, [replace(box, closed=False, boxes=np.array([[15.0, 0, 5, 0.3, 12, 10, 0]]))])[0] == 0


@given(opacities=st.lists(st.floats(0.0, 1.0), min_size=1, max_size=4))
def test_hedges_one_behind_the_other_let_through_the_product_of_what_each_does(opacities: list[float]) -> None:
    who = actors([[40.0, 0.0, 0.0]])
    hedges = [
        replace(box_part([8.0 + 6 * k, 0.0, 2.0], (1.0, 20.0, 4.0)), opacity=opacity)
        for k, opacity in enumerate(opacities)
    ]
    free = int(expected(who, columns=10**6)[0])
    share = np.prod(1.0 - np.array(opacities))
    assert abs(expected(who, hedges, columns=10**6)[0] - share * free) <= 1


def test_a_hedge_before_a_wall_changes_nothing_for_those_behind_the_wall() -> None:
    who = actors([[30.0, 0.0, 0.0], [30.0, 20.0, 0.0]])
    hedge = replace(box_part([10.0, 0.0, 2.0], (1.0, 40.0, 4.0)), opacity=0.25)
    wall = box_part([20.0, 0.0, 5.0], (0.3, 12.0, 10.0))
    for static in ([hedge, wall], [wall, hedge]):
        hidden, seen = expected(who, static, columns=10**6)
        assert hidden == 0 and abs(seen - 0.75 * expected(who, columns=10**6)[1]) <= 1


def test_scenery_out_of_range_changes_nothing() -> None:
    rng = np.random.default_rng(4)
    who = actors(np.column_stack([rng.uniform(-80, 80, (30, 2)), rng.uniform(-3, 3, 30)]))
    near = [box_part([*rng.uniform(-60, 60, 2), 2.0], (6.0, 2.0, 4.0)) for _ in range(20)]
    far = [box_part([*(rng.uniform(150, 300, 2) * rng.choice([-1, 1], 2)), 2.0], (9.0, 9.0, 4.0)) for _ in range(200)]
    np.testing.assert_array_equal(expected(who, [*near, *far]), expected(who, near))
    np.testing.assert_array_equal(expected(who, [*far, *near]), expected(who, near))


def test_other_beams_see_as_an_estimate_of_their_own_and_change_nothing() -> None:
    who = tall(np.array([[20.0, 1.0, 4.5, 1.9, 0.3], [30.0, -8.0, 4.5, 1.9, 1.0]]))
    static = [box_part([24.0, -5.0, 1.0], [1.0, 6.0, 2.0])]
    down = BeamPattern("down", BEAMS.elevation_rad - 0.3)
    level = ReturnsEstimator(static, BEAMS, 1024, 120.0)
    before = level.expected_returns(SENSOR_M[None], who, [None])
    own = ReturnsEstimator(static, down, 1024, 120.0).expected_returns(SENSOR_M[None], who, [None])
    np.testing.assert_array_equal(level.with_beams(down).expected_returns(SENSOR_M[None], who, [None]), own)
    np.testing.assert_array_equal(level.expected_returns(SENSOR_M[None], who, [None]), before)
    assert not np.array_equal(own, before)
