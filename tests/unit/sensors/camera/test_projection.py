"""Points in pictures: where OpenCV has them, and none that the camera cannot see."""

from __future__ import annotations

import numpy as np
import pytest
from small_cameras import BENT_CAMERA, CAMERAS

from coopsim.errors import InvalidValueError
from coopsim.geometry.se3 import SE3
from coopsim.sensors.camera.camera import Camera
from coopsim.sensors.camera.intrinsics import Intrinsics
from coopsim.sensors.camera.projection import project
from coopsim.types import CameraCalibration


@pytest.mark.parametrize("camera", CAMERAS, ids=lambda camera: camera.name)
def test_what_lies_on_a_pixels_ray_is_in_that_pixel(camera: Camera) -> None:
    calibration, lens = camera.calibration(1.5), camera.intrinsics
    depth_m = np.random.default_rng(0).uniform(0.5, 80, len(lens.rays))
    found = project(calibration, calibration.base_SE3_camera.apply(lens.rays * depth_m[:, None]))
    columns, rows = np.meshgrid(np.arange(lens.width), np.arange(lens.height))
    assert found.inside.all()
    np.testing.assert_allclose(found.place_px, np.stack([columns, rows], -1).reshape(-1, 2), atol=1e-6)
    np.testing.assert_allclose(found.depth_m, depth_m)


@pytest.mark.parametrize("camera", CAMERAS, ids=lambda camera: camera.name)
def test_places_are_opencvs(camera: Camera) -> None:
    cv2 = pytest.importorskip("cv2", reason="opencv-python is not installed")
    calibration = camera.calibration(1.5)
    points_m = np.random.default_rng(1).uniform([-30, -30, 0], [30, 30, 4], (400, 3))
    found = project(calibration, points_m)
    inside = points_m[found.inside]
    assert 10 < len(inside) < 300
    camera_SE3_base = calibration.base_SE3_camera.inverse()
    turn, _ = cv2.Rodrigues(camera_SE3_base.rotation)
    theirs, _ = cv2.projectPoints(inside, turn, camera_SE3_base.translation, calibration.matrix, calibration.distortion)
    np.testing.assert_allclose(found.place_px[found.inside], theirs[:, 0], atol=1e-8)


def test_a_picture_ends_half_a_pixel_beyond_its_last_pixels() -> None:
    calibration = CameraCalibration((10, 20), np.diag([10.0, 10.0, 1.0]), np.zeros(5), SE3.identity())
    edges = np.array([[-0.5, -0.5], [19.5, 9.5], [-0.51, 0], [19.51, 0], [0, -0.51], [0, 9.51]])
    points_m = np.column_stack([edges / 10, np.ones(6)])
    assert project(calibration, points_m).inside.tolist() == [True, True, False, False, False, False]
    assert not project(calibration, -points_m).inside.any()  # behind
    assert not project(calibration, points_m * [0, 0, 0]).inside.any()  # in the lens


def test_what_a_lens_folds_back_into_the_picture_is_not_inside() -> None:
    """A point 69 degrees off the axis, where the formula of this lens leads back to the picture's middle."""
    lens = Intrinsics.from_fov(48, 32, np.radians(60), (-0.15, 0.0, 0.0, 0.0, 0.0))
    calibration = CameraCalibration(lens.size, lens.matrix, np.array(lens.distortion), SE3.identity())
    far = np.sqrt(1 / 0.15)
    points_m = np.array([[far, 0.0, 1.0], [0.0, far, 1.0], [0.5, 0.3, 1.0]])
    np.testing.assert_allclose(lens.project(points_m)[:2], [lens.matrix[:2, 2]] * 2, atol=1e-9)
    assert project(calibration, points_m).inside.tolist() == [False, False, True]


def test_bad_points_and_lenses_are_refused() -> None:
    calibration = BENT_CAMERA.calibration(1.5)
    with pytest.raises(InvalidValueError, match=r"points_m must have shape \(N, 3\), got \(4, 4\)"):
        project(calibration, np.zeros((4, 4)))
    folding = CameraCalibration((32, 48), calibration.matrix, np.array([-1.0, 0, 0, 0, 0]), SE3.identity())
    with pytest.raises(InvalidValueError, match="fold it over"):
        project(folding, np.ones((1, 3)))


@pytest.mark.parametrize(
    ("change", "match"),
    [
        ({"matrix": np.diag([np.nan, 10, 1])}, r"matrix must be finite, got nan at index \(0, 0\)"),
        ({"matrix": np.diag([-10.0, 10, 1])}, "matrix must be .* with positive fx and fy"),
        ({"matrix": np.array([[10.0, 1, 0], [0, 10, 0], [0, 0, 1]])}, r"matrix must be \[\[fx, 0, cx\]"),
        ({"distortion": np.array([0, 0, np.inf, 0, 0])}, "distortion must be finite"),
        ({"size": (0, 20)}, "height must be an integer >= 1, got 0"),
        ({"size": (10, 2.5)}, "width must be an integer >= 1, got 2.5"),
        ({"base_SE3_camera": SE3(np.eye(3), np.array([0, np.nan, 0]))}, "translation of base_SE3_camera must be fin"),
        ({"base_SE3_camera": SE3(np.full((3, 3), np.nan), np.zeros(3))}, "rotation of base_SE3_camera must be finite"),
    ],
)
def test_bad_calibrations_of_cameras_are_refused(change: dict[str, object], match: str) -> None:
    good = {"size": (10, 20), "matrix": np.diag([10.0, 10, 1]), "distortion": np.zeros(5)}
    with pytest.raises(InvalidValueError, match=match):
        CameraCalibration(**{**good, "base_SE3_camera": SE3.identity(), **change})  # type: ignore[arg-type]
