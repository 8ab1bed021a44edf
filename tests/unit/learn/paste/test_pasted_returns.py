"""Occlusion both ways, and intensities, by a wall and a post made by hand."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from sensor_scenes import actors, triangles

from coopsim.learn.paste.rays import SweepRays
from coopsim.learn.paste.returns import Optics, cast, match_intensities
from coopsim.sensors.lidar.imperfections import Imperfections
from coopsim.sensors.lidar.lidar import LidarConfig
from coopsim.support.rng import stream

ORIGIN_M = np.array([0.0, 0.0, 1.0])
CLEAN = Optics(LidarConfig(range_noise_m=0.0, dropout_energy=0.0, imperfections=Imperfections()), 0.0)


def wall_with_post() -> tuple[SweepRays, np.ndarray, np.ndarray]:
    """Return rays to a wall at x = 20 m, of which those to the right of y / x = -0.03 end at x = 5 m before, and the
    last hundred met nothing; and the slopes (R,) of all rays to the left and upwards.
    """
    left, up = (grid.ravel() for grid in np.meshgrid(np.linspace(-0.2, 0.2, 81), np.linspace(-0.1, 0.1, 41)))
    toward = np.column_stack([np.ones(len(left)), left, up])
    away_m = np.where(left < -0.03, 5.0, 20.0) * np.linalg.norm(toward, axis=1)
    away_m[-100:] = np.inf
    return SweepRays(ORIGIN_M, toward / np.linalg.norm(toward, axis=1)[:, None], away_m), left, up


def test_actors_hide_what_is_behind_them_and_are_hidden_by_what_is_before_them() -> None:
    """A car of 4 x 2 x 1.6 m at 10 m has its near face at x = 8 m: it covers slopes up to 1/8, and 0.6/8 upwards."""
    rays, left, up = wall_with_post()
    points = len(left) - 100
    found = cast(rays, points, triangles(actors([[10.0, 0.0, 0.0]])), CLEAN, stream(0, "cast"))
    on_face = (np.abs(left) < 0.124) & (up < 0.074) & (up > -0.124)
    beside = (np.abs(left) > 0.126) | (up > 0.076)
    before = left < -0.03
    assert found.hidden[(on_face & ~before)[:points]].all()
    assert not found.hidden[(before | beside)[:points]].any()
    assert (found.points[:, 0] > 7.99).all() and (found.points[:, 0] < 12.01).all()
    assert ((found.points[:, 1] / found.points[:, 0]) > -0.0301).all()  # none behind the post
    assert len(found.points) >= (on_face & ~before).sum() and (found.instance == 1).all()


def test_rays_that_met_nothing_meet_tall_actors_and_hide_no_point() -> None:
    rays, _, _ = wall_with_post()
    low, high = (
        cast(replace(rays, origin_m=np.array([0.0, 0.0, z])), len(rays.directions) - 100,
             triangles(actors([[10.0, 0.0, 0.0]])), CLEAN, stream(0, "cast"))
        for z in (1.0, 0.3)
    )  # fmt: skip
    assert len(low.points) == low.hidden.sum() and len(high.points) > high.hidden.sum()


def test_lost_returns_still_hide_what_is_behind() -> None:
    rays, left, _ = wall_with_post()
    scene, rng = triangles(actors([[10.0, 0.0, 0.0]])), stream(0, "cast")
    clean = cast(rays, len(left), scene, CLEAN, rng)
    lossy = cast(rays, len(left), scene, CLEAN._replace(lost_share=0.5), rng)
    np.testing.assert_array_equal(lossy.hidden, clean.hidden)
    assert 0.4 < len(lossy.points) / len(clean.points) < 0.6


def test_intensities_have_the_ranks_and_the_range_of_the_sweep() -> None:
    rng = np.random.default_rng(0)
    points = np.column_stack([rng.uniform(-20, 20, (2000, 2)), np.full(2000, 1.0), rng.uniform(0.1, 0.3, 2000)])
    light = np.array([0.0, 0.01, 0.1, 0.3, 1.0])
    bright = match_intensities(light, points, points[:, 2])
    assert (np.diff(bright) > 0).all() and 0.1 <= bright[0] < 0.11 and 0.29 < bright[-1] <= 0.3
    points[:1000, 3], points[:1000, 2] = 0.9, 0.0  # of the ground: does not count
    assert match_intensities(light, points, points[:, 2]).max() <= 0.3
    assert not match_intensities(light, np.zeros((0, 4)), np.zeros(0)).any()
