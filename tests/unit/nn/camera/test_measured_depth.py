"""Depths that points measure: of the nearest one in each cell, and of none that the camera cannot see."""

from __future__ import annotations

import numpy as np
import pytest
from small_cameras import AHEAD, CAMERAS

from coopsim.nn.camera.picture_batch import cell_rays, measured_depth
from coopsim.sensors.camera.camera import Camera


@pytest.mark.parametrize("camera", CAMERAS, ids=lambda camera: camera.name)
def test_points_on_lines_of_sight_measure_their_cells(camera: Camera) -> None:
    calibration = camera.calibration(1.5)
    sight = cell_rays(calibration)
    shape = sight.ray.shape[1:]
    depth_m = np.random.default_rng(0).uniform(1, 60, shape)
    # Parts of cells have their middles on the picture's edge: rays are bent inwards a little.
    ray = 0.9999 * sight.ray + 0.0001 * sight.ray.mean((1, 2), keepdims=True)
    points_m = (sight.start_m[:, None, None] + depth_m * ray).reshape(3, -1).T
    hit = np.random.default_rng(1).random(shape) < 0.5
    found = measured_depth(calibration, points_m[hit.ravel()])
    assert found.dtype == np.float32
    np.testing.assert_allclose(found, np.where(hit, depth_m, 0), rtol=1e-5)


def test_the_nearest_point_counts_whatever_the_order() -> None:
    calibration = AHEAD.calibration(1.5)
    sight = cell_rays(calibration)
    points_m = sight.start_m + np.array([[30.0], [4.0], [9.0]]) * sight.ray[:, 2, 3]
    for order in ([0, 1, 2], [2, 0, 1], [1, 2, 0]):
        found = measured_depth(calibration, points_m[order].astype(np.float32))
        assert found[2, 3] == pytest.approx(4.0, rel=1e-5)
        assert np.count_nonzero(found) == 1


def test_points_behind_and_beside_measure_nothing() -> None:
    found = measured_depth(AHEAD.calibration(1.5), np.array([[-10.0, 0, 1], [1.0, 30.0, 1], [2.0, 0.0, 40.0]]))
    assert not found.any()
    assert not measured_depth(AHEAD.calibration(1.5), np.zeros((0, 3))).any()
