"""Embree against a Moller-Trumbore intersection written for this test, and against distances known exactly."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from sensor_scenes import actors, box_part, ground, moller_trumbore, soup, triangles

from coopsim.sensors.scene import RayScene


def unit_rays(count: int, seed: int) -> np.ndarray:
    rays = np.random.default_rng(seed).normal(size=(count, 3))
    return rays / np.linalg.norm(rays, axis=1, keepdims=True)


def test_agrees_with_an_independent_intersection() -> None:
    rng = np.random.default_rng(3)
    corners = rng.uniform(-40, 40, (250, 1, 3)) + rng.uniform(-8, 8, (250, 3, 3))
    origin, rays = np.array([1.0, -2.0, 3.0]), unit_rays(4000, seed=4)
    hits = RayScene(soup(corners)).cast(origin, rays)
    range_m, face = moller_trumbore(corners, origin, rays)
    assert 0.2 < (face >= 0).mean() < 0.99  # both outcomes are tried
    same = hits.face == face
    assert same.mean() > 0.999  # a ray through an edge may fall on either side of it
    np.testing.assert_allclose(hits.range_m[same], range_m[same], rtol=1e-4, atol=1e-3)


def test_distances_known_exactly() -> None:
    scene = RayScene(triangles(actors([[10.0, 0.0, 0.0]]), [ground(), box_part([0, 20, 5], (30, 2, 10))]))
    rays = np.array([[1.0, 0, 0], [0, 1.0, 0], [0, 0, -1.0], [0, 0, 1.0], [-1.0, 0, 0]])
    hits = scene.cast(np.array([0.0, 0.0, 1.0]), rays)
    np.testing.assert_allclose(hits.range_m, [8.0, 19.0, 1.0, np.inf, np.inf], atol=1e-5)
    assert scene.triangles.instance[hits.face[:3]].tolist() == [1, 0, 0]
    assert (hits.face[3:] == -1).all()


def test_no_ray_slips_through_between_faces() -> None:
    """Rays from within a closed ball, at its edges and corners, which faces share."""
    ball = trimesh.creation.icosphere(subdivisions=2, radius=20.0)
    corners = np.array(ball.vertices)
    ends = corners[ball.edges_unique]
    along = np.linspace(0.0, 1.0, 50)[:, None, None]
    targets = (ends[:, 0] * (1 - along) + ends[:, 1] * along).reshape(-1, 3)
    origin = np.array([3.0, 1.0, 2.0])
    rays = targets - origin
    distance_m = np.linalg.norm(rays, axis=1)
    hits = RayScene(soup(corners[ball.faces])).cast(origin, rays / distance_m[:, None])
    np.testing.assert_allclose(hits.range_m, distance_m, atol=1e-4)


@pytest.mark.parametrize("instance", [0, 1], ids=["scenery", "actor"])
def test_far_from_the_origin_is_as_exact_as_near(instance: int) -> None:
    """In float32 a coordinate of 200 km is known to 16 mm."""
    corners = np.random.default_rng(5).uniform(-30, 30, (100, 3, 3))
    rays, shift = unit_rays(2000, seed=6), np.array([1e5, -2e5, 0.0])
    near = RayScene(soup(corners, instance)).cast(np.zeros(3), rays)
    far = RayScene(soup(corners + shift, instance)).cast(shift, rays)
    same = near.face == far.face
    assert same.mean() > 0.998
    np.testing.assert_allclose(far.range_m[same], near.range_m[same], atol=1e-3)


def test_nothing_to_hit() -> None:
    hits = RayScene(triangles()).cast(np.zeros(3), unit_rays(10, seed=1))
    assert np.isinf(hits.range_m).all() and (hits.face == -1).all()


def test_no_rays() -> None:
    hits = RayScene(triangles(static=[ground()])).cast(np.zeros(3), np.zeros((0, 3)))
    assert hits.range_m.shape == hits.face.shape == (0,)
