"""The sweep by torch against the grid's."""

from __future__ import annotations

import sys
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from sensor_scenes import actors, box_part, ground, soup, triangles

from coopsim.errors import InvalidValueError
from coopsim.geometry.se3 import SE3
from coopsim.sensors.lidar.cast.ray_grid import GridHits, RayGrid
from coopsim.sensors.lidar.lidar import Lidar, LidarConfig
from coopsim.sensors.lidar.patterns import PATTERNS, BeamPattern
from coopsim.sensors.raycast import RayScene
from coopsim.sensors.scene import Triangles

COLUMNS = 200

ASIDE = BeamPattern("aside", np.radians([-88.0, -3.0, 0.0, 15.0, 89.0]), np.radians([0.0, 5.2, -170.0, 180.0, 0.9]))
"""Nearly upright, and pointing aside, even backwards: no strip of columns is narrow."""


def poses(rng: np.random.Generator) -> list[SE3]:
    level = SE3(np.eye(3), np.array([0.0, 0.0, 2.0]))
    askew = Rotation.from_euler("xyz", rng.uniform(-180, 180, 3), degrees=True)
    return [level, SE3(askew.as_matrix(), rng.uniform(-5, 5, 3))]


def crowd(rng: np.random.Generator) -> Triangles:
    return triangles(
        actors(rng.uniform([-30, -30, -3], [30, 30, 3], (25, 3))), [ground(), box_part([9, 9, 4], (3, 3, 8))]
    )


def require_same(got: GridHits, want: GridHits) -> None:
    """But for what passes an edge within rounding."""
    hit = want.face >= 0
    assert ((got.face >= 0) == hit).mean() >= 0.9995
    assert (np.isinf(got.range_m) == (got.face < 0)).all() and (got.cosine[got.face < 0] == 0).all()
    both = hit & (got.face >= 0)
    error_m = np.abs(got.range_m[both] - want.range_m[both])
    assert (error_m <= 1e-4 + 1e-6 * want.range_m[both]).mean() >= 0.9995
    same = both & (got.face == want.face)
    assert same.sum() >= 0.99 * both.sum()  # of those equally near, any is hit
    np.testing.assert_allclose(got.range_m[same], want.range_m[same], rtol=1e-6)
    np.testing.assert_allclose(got.cosine[same], want.cosine[same], atol=1e-6)


@pytest.fixture
def torch_grid() -> type[Any]:
    pytest.importorskip("torch", reason="torch is not installed (pip install 'coopsim[learn]')")
    from coopsim.sensors.lidar.cast.torch_grid import TorchGrid

    return TorchGrid


@pytest.mark.parametrize("pattern", [ASIDE, PATTERNS.get("OS1-128")], ids=lambda pattern: pattern.name)
@pytest.mark.parametrize("seed", range(3))
def test_the_hits_are_the_grids(torch_grid: type[Any], pattern: BeamPattern, seed: int) -> None:
    rng = np.random.default_rng(seed)
    scattered = soup(rng.uniform(-40, 40, (200, 1, 3)) + rng.uniform(-5, 5, (200, 3, 3)))
    for scene in (scattered, crowd(rng)):
        for where in poses(rng):
            want = RayGrid(pattern, COLUMNS).cast(scene, where)
            require_same(torch_grid(pattern, COLUMNS).cast(scene, where), want)


@pytest.mark.usefixtures("torch_grid")
def test_sweeps_are_those_of_the_grid_at_rest_and_turning() -> None:
    scene = RayScene(crowd(np.random.default_rng(5)))
    end = SE3.from_xyz_yaw([1.0, 0.5, 0.0], 0.1)
    for turn_s, divergence_rad in ((0.0, 0.0), (0.1, 0.003)):
        by_grid, by_torch = (
            Lidar(LidarConfig("VLP-16", COLUMNS, backend=backend, turn_s=turn_s, divergence_rad=divergence_rad)).sense(
                scene, end, 1.5, None, np.random.default_rng(1), start=SE3.from_xyz_yaw([0.0, 0.0, 0.0], 0.0)
            )
            for backend in ("grid", "torch")
        )
        assert len(by_grid.points) > 100
        np.testing.assert_allclose(by_torch.points, by_grid.points, atol=1e-3)
        np.testing.assert_array_equal(by_torch.instance, by_grid.instance)


def test_what_torch_makes_by_default_does_not_matter(torch_grid: type[Any]) -> None:
    import torch

    scene, before = crowd(np.random.default_rng(2)), torch.get_default_dtype()
    try:
        torch.set_default_dtype(torch.float64)
        hits = torch_grid(ASIDE, COLUMNS).cast(scene, SE3.identity())
    finally:
        torch.set_default_dtype(before)
    require_same(hits, RayGrid(ASIDE, COLUMNS).cast(scene, SE3.identity()))


def test_nothing_to_hit(torch_grid: type[Any]) -> None:
    nothing = soup(np.zeros((0, 3, 3)))
    hits = torch_grid(ASIDE, COLUMNS).cast(nothing, SE3.identity())
    assert (hits.face == -1).all() and np.isinf(hits.range_m).all() and not hits.cosine.any()


def test_without_torch_an_error_says_how_to_get_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delitem(sys.modules, "coopsim.sensors.lidar.cast.torch_grid", raising=False)
    monkeypatch.setitem(sys.modules, "torch", None)
    with pytest.raises(InvalidValueError, match=r"needs torch: pip install 'coopsim\[learn\]'"):
        Lidar(LidarConfig("VLP-16", backend="torch"))
