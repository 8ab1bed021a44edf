"""The grid's sweep against embree, and against an intersection written for these tests, on scenes made to break it."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from sensor_scenes import actors, box_part, ground, moller_trumbore, soup, triangles

from coopsim.geometry.se3 import SE3
from coopsim.sensors.lidar.patterns import PATTERNS, BeamPattern
from coopsim.sensors.lidar.ray_grid import GridHits, RayGrid
from coopsim.sensors.scene import RayScene, SceneGeometry, Triangles, is_closed
from coopsim.world.models import make_models
from coopsim.world.scenario import make_scenario
from coopsim.world.towns.town import draw_place
from coopsim.world.world import World

COLUMNS = 200
"""No multiple of `LANES`, and few enough for triangles to lie between two columns."""

UNEVEN = BeamPattern(
    "uneven",
    np.radians([-88.0, -3.0, -20.0, 0.0, 1.0, -1.0, 15.0, 89.0, 40.0, -45.0, -3.1]),
    np.radians([0.0, 5.2, -5.2, 1.0, 0.0, -170.0, 3.0, 180.0, 0.9, -0.9, 0.0]),
)
"""Out of order, unevenly spaced, nearly upright, and pointing aside, even backwards."""


def pose(xyz_m: tuple[float, float, float] = (0.0, 0.0, 2.0), *roll_pitch_yaw_deg: float) -> SE3:
    turn = Rotation.from_euler("xyz", roll_pitch_yaw_deg or (0.0, 0.0, 0.0), degrees=True)
    return SE3(turn.as_matrix(), np.array(xyz_m))


def rays_of(pattern: BeamPattern, columns: int = COLUMNS) -> RayGrid:
    return RayGrid(pattern.elevation_rad, pattern.offset_rad, columns)


def by_embree(scene: Triangles, world_SE3_sensor: SE3, pattern: BeamPattern, columns: int) -> GridHits:
    rays = world_SE3_sensor.rotate(pattern.directions(columns))
    hits, shape = RayScene(scene).cast(world_SE3_sensor.translation, rays), (len(pattern.elevation_rad), columns)
    cosine = np.abs(np.einsum("ij,ij->i", scene.normals[hits.face], rays)) * (hits.face >= 0)
    return GridHits(hits.range_m.reshape(shape), hits.face.reshape(shape), cosine.reshape(shape))


def require_agreement(got: GridHits, want: GridHits) -> None:
    """Require the same hit or miss for 99.9 % of the rays, and ranges equal to 1 mm for 99.9 % of the hits."""
    hit = want.face >= 0
    assert (hit == (got.face >= 0)).mean() >= 0.999
    both = hit & (got.face >= 0)
    assert (np.isinf(got.range_m) == (got.face < 0)).all()
    if both.any():
        error_m, tolerance_m = (
            np.abs(got.range_m[both] - want.range_m[both]),
            np.maximum(1e-3, 1e-5 * want.range_m[both]),
        )
        assert (error_m < tolerance_m).mean() >= 0.999  # beyond 100 m, both count in float32
        same = got.face[both] == want.face[both]
        np.testing.assert_allclose(got.cosine[both][same], want.cosine[both][same], atol=1e-3)


def mixed_scene(rng: np.random.Generator) -> np.ndarray:
    """Return triangles (F, 3, 3) m: large and small ones all around, a huge ground, and degenerate ones."""
    scattered = rng.uniform(-40, 40, (60, 1, 3)) + rng.uniform(-6, 6, (60, 3, 3))
    small = rng.uniform(-15, 15, (200, 1, 3)) + rng.uniform(-0.3, 0.3, (200, 3, 3))
    huge = 1e4 * np.array([[[-1.0, -1, 0], [1, -1, 0], [1, 1, 0]], [[-1.0, -1, 0], [1, 1, 0], [-1, 1, 0]]])
    above_and_below = np.array([[[-2.0, -1, z], [2, -1, z + 0.5], [0.1, 3, z]] for z in (9.0, -9.0)])
    on_the_seam = np.array([[[8.0, -2, 1], [8, 2, 1], [9, 0, 4]], [[-8.0, -2, 1], [-8, 2, 1], [-9, 0, 4]]])
    corner_on_the_axis = np.array([[[0.0, 0, 6], [1, 2, 6], [-1, 2, 7]], [[0.0, 0, -6], [1, -2, -6], [3, 2, -7]]])
    # Embree hits a triangle without area if a ray runs exactly along it; here no ray does.
    without_area = np.array([[[1.0, 2, 3]] * 3, [[1.0, 1.1, 1], [2, 2.2, 2], [3, 3.3, 3]]])
    edge_on = np.array([[[0.0, 5, 2], [4, 9, 2], [-4, 9, 2]]])  # in the plane of a level sensor at 2 m
    parts = [scattered, small, huge, above_and_below, on_the_seam, corner_on_the_axis, without_area, edge_on]
    corners = np.concatenate(parts)
    turned = rng.random(len(corners)) < 0.5
    corners[turned] = corners[turned][:, ::-1]  # seen from behind as often as from the front
    return corners


@settings(max_examples=30)
@given(seed=st.integers(0, 2**32 - 1), level=st.booleans())
def test_agrees_with_embree_on_any_scene_from_any_pose(seed: int, level: bool) -> None:
    rng = np.random.default_rng(seed)
    scene = soup(mixed_scene(rng))
    where = pose((0.0, 0.0, 2.0)) if level else pose(tuple(rng.uniform(-5, 5, 3)), *rng.uniform(-180, 180, 3))
    for pattern in (UNEVEN, PATTERNS.get("Pandar64")):
        require_agreement(rays_of(pattern).cast(scene, where), by_embree(scene, where, pattern, COLUMNS))


def test_agrees_with_an_independent_intersection_in_double_precision() -> None:
    corners, where = mixed_scene(np.random.default_rng(1)), pose((1.0, -2.0, 3.0), 5.0, -8.0, 30.0)
    hits = rays_of(UNEVEN).cast(soup(corners), where)
    rays = where.rotate(UNEVEN.directions(COLUMNS))
    with np.errstate(divide="ignore", invalid="ignore"):  # triangles without area
        range_m, face = moller_trumbore(corners, where.translation, rays)
    assert (hits.face.ravel() == face).mean() >= 0.999
    same = (hits.face.ravel() == face) & (face >= 0)
    assert same.mean() > 0.5
    np.testing.assert_allclose(hits.range_m.ravel()[same], range_m[same], rtol=1e-5, atol=1e-4)


@pytest.mark.parametrize("name", list(PATTERNS))
def test_agrees_with_embree_on_the_worlds_own_models(name: str) -> None:
    """Closed meshes, of which only the outer side is drawn; the sensor is on, beside, within and under them."""
    pattern, rng = PATTERNS.get(name), np.random.default_rng(0)
    scene = triangles(
        actors(rng.uniform([-25, -25, -3], [25, 25, 3], (30, 3)), model=rng.integers(0, 2, 30)), [ground()]
    )
    inside = scene.vertices[scene.faces[scene.instance == 5]].mean(axis=(0, 1))
    for place in ((0.0, 0.0, 2.0), (3.0, 4.0, 0.5), tuple(inside), (0.0, 0.0, -1.0)):
        where = pose(place, 3.0, -4.0, 77.0)
        got, want = rays_of(pattern).cast(scene, where), by_embree(scene, where, pattern, COLUMNS)
        require_agreement(got, want)
        assert (want.face >= 0).mean() > 0.1


def test_leaving_out_inner_sides_changes_nothing() -> None:
    rng = np.random.default_rng(3)
    scene = triangles(
        actors(rng.uniform([-30, -30, -3], [30, 30, 3], (40, 3))), [ground(), box_part([9, 9, 4], (3, 3, 8))]
    )
    assert scene.parts is not None and scene.parts.closed.tolist() == [False] + [True] * 41
    got = rays_of(UNEVEN).cast(scene, pose())
    want = rays_of(UNEVEN).cast(replace(scene, parts=None), pose())
    np.testing.assert_array_equal(got.range_m, want.range_m)


def test_open_surfaces_are_seen_from_both_sides() -> None:
    down, up = pose((0.0, 0.0, 2.0)), pose((0.0, 0.0, -2.0))
    for where in (down, up):
        assert (rays_of(UNEVEN).cast(triangles(static=[ground()]), where).face >= 0).any()


def test_which_surfaces_are_closed() -> None:
    box = trimesh.creation.box()
    corners, faces = np.array(box.vertices), np.array(box.faces)
    assert is_closed(corners, faces) and not is_closed(corners, faces[1:]) and not is_closed(corners, faces[:0])
    assert not is_closed(corners, np.vstack([faces, faces[:1]]))  # a face twice
    assert not is_closed(corners, faces[:, ::-1])  # inside out
    assert all(is_closed(model.vertices, model.faces) for model in make_models(varied=True))


@pytest.mark.parametrize("tilt_deg", [0.0, 11.0])
def test_no_ray_slips_through_between_faces(tilt_deg: float) -> None:
    """Edges and corners of the ball lie exactly on rays where nothing is tilted."""
    ball = trimesh.creation.uv_sphere(radius=20.0, count=[16, 40])
    level = BeamPattern("fine", np.radians(np.linspace(-89.0, 89.0, 179)))
    scene = soup(np.array(ball.vertices)[ball.faces])
    assert (rays_of(level, 720).cast(scene, pose((0.0, 0.0, 0.0), tilt_deg, 0.0, 0.0)).face >= 0).all()
    assert (rays_of(level, 720).cast(scene, pose((3.0, 1.0, 2.0), 0.0, tilt_deg, 0.0)).face >= 0).all()


def test_a_turn_by_whole_columns_shifts_the_grid() -> None:
    scene = soup(mixed_scene(np.random.default_rng(4)))
    grid = rays_of(UNEVEN)
    straight, turned = grid.cast(scene, pose()), grid.cast(scene, pose((0.0, 0.0, 2.0), 0.0, 0.0, 7 * 360 / COLUMNS))
    assert np.isclose(np.roll(straight.range_m, -7, axis=1), turned.range_m, rtol=1e-4).mean() >= 0.999


def parked(count: int) -> Triangles:
    return triangles(actors(np.random.default_rng(count).uniform([-30, -30, -3], [30, 30, 3], (count, 3))), [ground()])


def assert_same(got: GridHits, want: GridHits) -> None:
    for name in ("range_m", "face", "cosine"):
        np.testing.assert_array_equal(getattr(got, name), getattr(want, name))


def test_scenes_of_any_size_follow_each_other() -> None:
    """Nothing is left over from the scene before."""
    grid = rays_of(UNEVEN)
    for count in (5, 40, 0, 3, 40):
        scene = parked(count)
        assert_same(grid.cast(scene, pose()), rays_of(UNEVEN).cast(scene, pose()))


def test_sweeps_at_one_time_do_not_mix() -> None:
    grid, scenes = rays_of(UNEVEN), [parked(count) for count in (4, 20, 40)]
    alone = [grid.cast(scene, pose()) for scene in scenes]

    def cast(k: int) -> list[GridHits]:
        return [grid.cast(scenes[k], pose()) for _ in range(50)]

    with ThreadPoolExecutor(len(scenes)) as pool:
        for k, sweeps in enumerate(pool.map(cast, range(len(scenes)))):
            for sweep in sweeps:
                assert_same(sweep, alone[k])


def test_of_two_that_are_equally_near_the_first_is_hit() -> None:
    wall = np.array([[[10.0, -9, -9], [10, 9, -9], [10, 0, 9]]])
    hits = rays_of(UNEVEN).cast(soup(np.concatenate([wall, wall, wall])), pose())
    assert set(hits.face.ravel().tolist()) == {-1, 0}


def test_far_from_the_origin_is_as_exact_as_near() -> None:
    corners, shift = np.random.default_rng(5).uniform(-30, 30, (100, 3, 3)), np.array([1e5, -2e5, 0.0])
    near = rays_of(UNEVEN).cast(soup(corners), pose())
    far = rays_of(UNEVEN).cast(soup(corners + shift), pose((1e5, -2e5, 2.0)))
    same = near.face == far.face
    assert same.mean() >= 0.999
    np.testing.assert_allclose(far.range_m[same], near.range_m[same], atol=1e-4)


def test_nothing_to_hit() -> None:
    hits = rays_of(UNEVEN).cast(triangles(), pose())
    assert np.isinf(hits.range_m).all() and (hits.face == -1).all() and (hits.cosine == 0).all()


def test_leaving_out_what_is_out_of_reach_changes_nothing_within() -> None:
    rng, pattern = np.random.default_rng(5), PATTERNS.get("HDL-32E")
    scene = triangles(actors(rng.uniform([-90, -90, 1], [90, 90, 4], (60, 3))))
    everything, near = (
        RayGrid(pattern.elevation_rad, pattern.offset_rad, COLUMNS, reach_m).cast(scene, pose())
        for reach_m in (np.inf, 40.0)
    )
    within = everything.range_m <= 40.0
    np.testing.assert_array_equal(near.range_m[within], everything.range_m[within])
    np.testing.assert_array_equal(near.face[within], everything.face[within])
    assert (near.face >= 0).sum() < (everything.face >= 0).sum()


@pytest.mark.parametrize(("place", "detail"), [(2, "plain"), (7, "plain"), (2, "full")])
def test_agrees_with_embree_in_drawn_towns(place: int, detail: str) -> None:
    world = World(make_scenario(draw_place(place), detail=detail), place)
    scene = SceneGeometry(world.models, world.static).triangles(world.actors())
    pattern, bodies = PATTERNS.get("HDL-32E"), world.agents().values()
    assert len(bodies) > 1
    for body in bodies:
        where = body.world_SE3_base.compose(pose((0.0, 0.0, body.height_m + 0.4)))
        got, want = rays_of(pattern, 500).cast(scene, where), by_embree(scene, where, pattern, 500)
        require_agreement(got, want)
        both = (got.face >= 0) & (want.face >= 0) & (want.range_m < 100.0)
        off = np.abs(got.range_m[both] - want.range_m[both]) > 1e-3
        assert off.mean() < 3e-4, "a ray may take either side of an edge"
