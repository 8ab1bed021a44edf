"""Rays that look past all boxes are left out, and no ray that meets one is."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from coopsim.geometry.boxes import Boxes3D
from coopsim.geometry.se3 import Floats
from coopsim.sensors.visibility import angles_of, ranges_to_boxes


def last_met(box: Floats, origin_m: Floats, directions: Floats) -> Floats:
    """(R,) distance at which rays leave a box (7,), by its slabs in its own axes; 0 for rays that do not meet it."""
    cos, sin = np.cos(box[6]), np.sin(box[6])
    own_from_world = np.array([[cos, sin, 0.0], [-sin, cos, 0.0], [0.0, 0.0, 1.0]])
    start, along = own_from_world @ (origin_m - box[:3]), directions @ own_from_world.T
    with np.errstate(divide="ignore", invalid="ignore"):
        ends = np.stack([(-box[3:6] / 2 - start) / along, (box[3:6] / 2 - start) / along])
    first, last = np.nanmin(ends, axis=0), np.nanmax(ends, axis=0)
    met = (first.max(axis=1) <= last.min(axis=1)) & (last.min(axis=1) >= 0)
    return np.where(met, last.min(axis=1), 0.0)


def reached(boxes: Boxes3D, origin_m: Floats, rays: Floats) -> Floats:
    return ranges_to_boxes(boxes, origin_m, *angles_of(rays))


def all_around(rng: np.random.Generator, count: int = 4000) -> Floats:
    rays = rng.normal(size=(count, 3))
    straight = np.concatenate([np.eye(3), -np.eye(3)])  # along the axes, where angles jump
    return np.concatenate([rays / np.linalg.norm(rays, axis=1, keepdims=True), straight])


@settings(max_examples=60)
@given(seed=st.integers(0, 2**31), spread_m=st.sampled_from([0.5, 5.0, 60.0]))
def test_no_ray_is_left_out_or_ends_before_the_last_box_that_it_meets(seed: int, spread_m: float) -> None:
    rng = np.random.default_rng(seed)
    count = int(rng.integers(1, 8))
    rows = np.column_stack(
        [rng.uniform(-spread_m, spread_m, (count, 3)), rng.uniform(0.2, 9.0, (count, 3)), rng.uniform(-9, 9, count)]
    )
    origin_m, rays = rng.uniform(-2, 2, 3), all_around(rng)
    far_m = np.max([last_met(row, origin_m, rays) for row in rows], axis=0)
    assert (reached(Boxes3D.from_array(rows), origin_m, rays) >= far_m).all()
    turned = ranges_to_boxes(Boxes3D.from_array(rows), origin_m, angles_of(rays)[0] + 2 * np.pi, angles_of(rays)[1])
    assert (turned >= far_m).all()


def test_most_rays_look_past_a_box_far_away_wherever_it_is() -> None:
    rays = all_around(np.random.default_rng(0))
    for x_m, y_m in ((-30.0, 0.0), (-30.0, 0.01), (-30.0, -0.01), (30.0, 0.0), (0.0, 30.0), (20.0, -20.0)):
        box = Boxes3D.from_array([[x_m, y_m, 0.0, 4.0, 2.0, 1.5, 0.4]])
        assert 0 < (reached(box, np.zeros(3), rays) > 0).mean() < 0.01


def test_without_boxes_no_ray_is_needed() -> None:
    assert not reached(Boxes3D.empty(), np.zeros(3), all_around(np.random.default_rng(0))).any()
