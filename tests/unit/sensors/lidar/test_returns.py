"""Wide beams at edges."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from sensor_scenes import box_part, ground, triangles

from coopsim.errors import InvalidValueError
from coopsim.geometry.se3 import SE3
from coopsim.sensors.lidar.lidar import Lidar, LidarConfig
from coopsim.sensors.lidar.patterns import PATTERNS, BeamPattern
from coopsim.sensors.lidar.returns import footprint_patterns, merge_echoes
from coopsim.sensors.scene import RayScene
from coopsim.support.rng import stream
from coopsim.types import Sweep

LEVEL = BeamPattern("level", np.zeros(1))


def two_steps(behind_m: float, **config: Any) -> Sweep:
    """A board at 20 m in front of a larger one."""
    scene = RayScene(
        triangles(
            static=[
                box_part([20.05, 0.0, 2.0], (0.1, 4.0, 4.0)),
                box_part([20.05 + behind_m, 0.0, 2.0], (0.1, 60.0, 9.0)),
            ]
        )
    )
    exact = {"pattern": LEVEL, "columns": 4096, "range_noise_m": 0.0, "dropout_energy": 0.0}
    return Lidar(LidarConfig(**(exact | config))).sense(scene, SE3.identity(), 1.65, None, stream(0, "lidar"))


def test_thin_beams_see_one_board_or_the_other() -> None:
    x = two_steps(0.5).points[:, 0]
    assert np.unique(np.round(x, 3)).tolist() == [20.0, 20.5]


def test_wide_beams_mix_what_is_near_each_other() -> None:
    x = two_steps(0.5, divergence_rad=0.004).points[:, 0]
    mixed = (x > 20.02) & (x < 20.48)
    assert 2 <= mixed.sum() <= 20  # some columns at either edge
    assert (x >= 20.0 - 1e-3).all() and (x <= 20.5 + 1e-2).all()


def test_wide_beams_choose_between_what_is_apart() -> None:
    x = two_steps(5.0, divergence_rad=0.004).points[:, 0]
    assert not ((x > 20.01) & (x < 24.9)).any() and (x > 24.9).any() and (x < 20.01).any()


def test_what_fills_a_part_of_a_beam_returns_a_part_of_its_light() -> None:
    whole, parts = two_steps(50.0), two_steps(50.0, divergence_rad=0.004)
    near = [sweep.intensity[np.abs(sweep.points[:, 0] - 20.0) < 0.01] for sweep in (whole, parts)]
    assert near[0].min() > 0.49
    assert near[1].min() < 0.45 and near[1].max() == pytest.approx(near[0].max(), rel=1e-3)
    assert set(np.round(5 * near[1] / 0.5).astype(int).tolist()) <= {1, 2, 3, 4, 5}


def test_merging_by_hand() -> None:
    inf, range_m = np.inf, np.array([[10.0, 10.0, 10.0, 30.0], [10.4, 30.0, np.inf, 10.0]], dtype=np.float32)
    bounced = np.array([[0.4, 0.9, 0.5, 0.9], [0.4, 0.9, 0.0, 0.05]], dtype=np.float32)
    near, light, face = merge_echoes(range_m, bounced, np.array([[0, 0, 0, 0], [1, 1, -1, 1]]), 0.75)
    np.testing.assert_allclose(near, [10.192, 10.0, 10.0, 30.0], atol=1e-3)
    np.testing.assert_allclose(light, [0.4, 0.45, 0.25, 0.45], atol=1e-6)
    assert face.tolist() == [0, 0, 0, 0]
    nothing = merge_echoes(np.full((2, 1), inf, np.float32), np.zeros((2, 1), np.float32), np.full((2, 1), -1), 0.75)
    assert (nothing[0][0], nothing[1][0], nothing[2][0]) == (inf, 0.0, -1)


def test_five_rays_lie_around_the_beam() -> None:
    middle, up, down, left, right = (
        table.directions(8) for table in footprint_patterns(PATTERNS.get("Pandar64"), 0.003)
    )
    for other in (up, down, left, right):
        angle = np.arccos(np.clip((middle * other).sum(axis=1), -1, 1))
        np.testing.assert_allclose(angle, 0.35 * 0.003, rtol=1e-3)
    np.testing.assert_allclose(up + down, left + right, atol=1e-5)
    assert len(footprint_patterns(LEVEL, 0.0)) == 1


def test_flat_ground_looks_the_same_to_wide_beams() -> None:
    scene = RayScene(triangles(static=[ground()]))
    exact: dict[str, Any] = {"range_noise_m": 0.0, "dropout_energy": 0.0, "max_range_m": 30.0, "columns": 64}
    thin, wide = (
        Lidar(LidarConfig(divergence_rad=angle, **exact)).sense(scene, SE3.identity(), 1.65, None, stream(0, "x"))
        for angle in (0.0, 0.002)
    )
    assert len(thin) == len(wide)
    assert np.abs(np.linalg.norm(thin.points, axis=1) - np.linalg.norm(wide.points, axis=1)).max() < 0.1


@pytest.mark.parametrize("bad", [{"divergence_rad": -0.1}, {"divergence_rad": 0.5}, {"pulse_m": -1.0}])
def test_bad_beams_are_refused(bad: dict[str, Any]) -> None:
    with pytest.raises(InvalidValueError, match=next(iter(bad))):
        LidarConfig(**bad)
