"""Lines of sight: those of the lens, from where the camera stands, and the ground that they meet."""

from __future__ import annotations

import numpy as np
import pytest
from small_cameras import AHEAD, CAMERAS, ODD, PLAIN, ROLLED

from coopsim.errors import InvalidValueError
from coopsim.geometry.se3 import SE3
from coopsim.nn.camera.picture_batch import STRIDE_PX, cell_rays, cells_of
from coopsim.sensors.camera.camera import Camera
from coopsim.sensors.camera.projection import project
from coopsim.types import CameraCalibration

BODY_M = 1.6
each_camera = pytest.mark.parametrize("camera", CAMERAS, ids=lambda camera: camera.name)


def middles(size: tuple[int, int]) -> np.ndarray:
    """Return the middles of cells (h, w, 2): column and row, no farther out than the picture's edge."""
    rows, columns = (np.minimum(STRIDE_PX * np.arange(-(-side // 8)) + 3.5, side - 0.5) for side in size)
    return np.stack(np.meshgrid(columns, rows), -1)


@each_camera
def test_points_on_a_line_of_sight_are_seen_in_the_middle_of_its_cell(camera: Camera) -> None:
    calibration = camera.calibration(BODY_M)
    sight, wanted = cell_rays(calibration), middles(calibration.size)
    assert sight.ray.shape == (3, *cells_of(calibration.size)) == (3, *wanted.shape[:2])
    for depth_m in (1.0, 30.0):
        points_m = sight.start_m + depth_m * sight.ray.reshape(3, -1).T
        found = project(calibration, points_m.astype(np.float64))
        np.testing.assert_allclose(found.place_px, wanted.reshape(-1, 2), atol=1e-4)
        np.testing.assert_allclose(found.depth_m, depth_m, rtol=1e-5)


def test_a_cells_ray_is_the_mean_of_those_of_its_middle_pixels() -> None:
    calibration = ROLLED.calibration(BODY_M)
    rays = (PLAIN.rays @ calibration.base_SE3_camera.rotation.T).reshape(32, 48, 3)
    wanted = np.mean([rays[i::8, j::8] for i in (3, 4) for j in (3, 4)], axis=0)
    np.testing.assert_allclose(cell_rays(calibration).ray.transpose(1, 2, 0), wanted, atol=1e-6)


@each_camera
def test_ground_is_the_nearest_that_any_pixel_of_the_cell_shows(camera: Camera) -> None:
    calibration, lens = camera.calibration(BODY_M), camera.intrinsics
    down = -(lens.rays @ calibration.base_SE3_camera.rotation.T)[:, 2].reshape(lens.size)
    inverse_m = np.maximum(down, 0) / calibration.base_SE3_camera.translation[2]
    rows, columns = (side // 8 for side in lens.size)  # whole cells
    wanted = inverse_m[: 8 * rows, : 8 * columns].reshape(rows, 8, columns, 8).max((1, 3))
    ground = cell_rays(calibration).geometry[0, :rows, :columns]
    np.testing.assert_allclose(ground, 10 * wanted, atol=1e-3 if lens.distorts else 1e-5)
    assert (ground == 0).any() or camera.pitch_rad > 0.2
    assert (ground > 0).any()


def test_ground_depth_is_exact_on_a_plane() -> None:
    """A camera 2 m high that looks 45 degrees down sees the ground at the depth of 2 m * sqrt(2) on its axis."""
    sight = cell_rays(Camera("down", PLAIN, above_m=0.0, pitch_rad=np.pi / 4).calibration(2.0))
    lowest = PLAIN.rays.reshape(32, 48, 3)[7::8, 7, 1]  # of each row of cells
    depth_m = 2 * np.sqrt(2) / (1 + lowest)
    np.testing.assert_allclose(10 / sight.geometry[0, :, 0], depth_m, rtol=1e-6)


def test_the_network_is_told_elevation_fineness_and_height() -> None:
    calibration = AHEAD.calibration(BODY_M)
    elevation, fine, height = cell_rays(calibration).geometry[1:]
    ray = cell_rays(calibration).ray
    np.testing.assert_allclose(np.tan(elevation), ray[2] / np.hypot(ray[0], ray[1]), atol=1e-6)
    np.testing.assert_allclose(fine, np.log(PLAIN.fx_px / 8) - 3, rtol=1e-6)
    np.testing.assert_allclose(height, np.log(BODY_M + AHEAD.above_m), rtol=1e-6)


def test_a_camera_on_or_under_the_ground_has_finite_geometry() -> None:
    for height_m in (0.0, -3.0):
        buried = CameraCalibration(
            PLAIN.size, PLAIN.matrix, np.zeros(5), SE3(ROLLED.base_SE3_camera(0).rotation, np.array([0, 0, height_m]))
        )
        assert np.isfinite(cell_rays(buried).geometry).all()


@pytest.mark.parametrize(("size", "cells"), [((27, 44), (4, 6)), ((8, 8), (1, 1)), ((1, 17), (1, 3))])
def test_parts_of_cells_count(size: tuple[int, int], cells: tuple[int, int]) -> None:
    assert cells_of(size) == cells
    matrix = np.array([[20.0, 0, size[1] / 2], [0, 20.0, size[0] / 2], [0, 0, 1]])
    sight = cell_rays(CameraCalibration(size, matrix, np.zeros(5), SE3(np.eye(3), np.array([0, 0, 1.0]))))
    assert sight.geometry.shape == (4, *cells)


def test_calibrations_are_told_apart_and_remembered() -> None:
    first, same = AHEAD.calibration(BODY_M), AHEAD.calibration(BODY_M)
    assert cell_rays(first) is cell_rays(same)
    others = [AHEAD.calibration(BODY_M + 0.1), ROLLED.calibration(BODY_M), Camera("odd", ODD).calibration(BODY_M)]
    assert all(cell_rays(other) is not cell_rays(first) for other in others)


def test_a_lens_that_folds_its_picture_over_is_refused() -> None:
    bad = CameraCalibration(PLAIN.size, PLAIN.matrix, np.array([-1.0, 0, 0, 0, 0]), SE3.identity())
    with pytest.raises(InvalidValueError, match="fold it over"):
        cell_rays(bad)
