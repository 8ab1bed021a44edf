"""Crops hold what a picture shows of a box, and no more."""

from __future__ import annotations

import numpy as np
import pytest
from small_cameras import AHEAD, BENT_CAMERA, CAMERAS

from coopsim.errors import InvalidValueError
from coopsim.geometry.boxes import Boxes3D
from coopsim.geometry.se3 import SE3
from coopsim.sensors.camera.camera import Camera
from coopsim.sensors.camera.intrinsics import Intrinsics
from coopsim.sensors.camera.projection import LEAST_AREA_PX, best_crops, hidden_shares, project, rectangles
from coopsim.types import CameraCalibration

LENS = Intrinsics.from_fov(320, 180, np.radians(100))
PINHOLE = CameraCalibration(LENS.size, LENS.matrix, np.zeros(5), Camera("front", LENS).base_SE3_camera(1.5))
TURNED = CameraCalibration(LENS.size, LENS.matrix, np.zeros(5), Camera("f", LENS, yaw_rad=0.6).base_SE3_camera(1.5))


def boxes(*rows: tuple[float, ...]) -> Boxes3D:
    return Boxes3D.from_array(np.array(rows, dtype=float).reshape(-1, 7))


def many(count: int, seed: int) -> Boxes3D:
    rng = np.random.default_rng(seed)
    rows = np.column_stack(
        [rng.uniform(-20, 20, (count, 2)), rng.normal(0.8, 0.3, count), rng.uniform(0.4, 8, (count, 3))]
    )
    return boxes(*np.column_stack([rows, rng.uniform(-4, 4, count)]))


def surface_of(box: np.ndarray, rng: np.random.Generator, count: int = 15_000) -> np.ndarray:
    """Return random points (M, 3) of a box's faces and edges."""
    unit = rng.uniform(-0.5, 0.5, (count, 3))
    on = np.arange(count)
    unit[on, rng.integers(0, 3, count)] = rng.choice([-0.5, 0.5], count)
    edge = on[: count // 2]
    unit[edge, (np.argmax(np.abs(unit[edge]) == 0.5, axis=1) + 1) % 3] = rng.choice([-0.5, 0.5], len(edge))
    local, yaw = unit * box[3:6], box[6]
    turn = np.array([[np.cos(yaw), -np.sin(yaw), 0], [np.sin(yaw), np.cos(yaw), 0], [0, 0, 1]])
    return local @ turn.T + box[:3]


@pytest.mark.parametrize("calibration", [PINHOLE, TURNED, *(each.calibration(1.5) for each in CAMERAS)])
def test_a_rectangle_goes_around_every_visible_point_and_no_farther(calibration: CameraCalibration) -> None:
    """Against points of the surface, each projected alone: boxes beside, behind, around and far from the camera."""
    rng, some = np.random.default_rng(0), many(40, 1)
    found, shown = rectangles([calibration], some)[0], 0
    for box, place in zip(some.array, found, strict=True):
        points = project(calibration, surface_of(box, rng))
        seen = points.place_px[points.inside]
        if not len(seen):
            assert np.isnan(place).all() or (place[2:] - place[:2]).min() < 1.5, "points of a surface miss only corners"
            continue
        shown += 1
        low, high = seen.min(axis=0), seen.max(axis=0)
        assert (place[:2] <= low + 0.05).all() and (high <= place[2:] + 0.05).all()
        spare_px = max(calibration.size) * (0.15 if calibration.distortion.any() else 0.04)
        assert (low - place[:2]).max() < spare_px and (place[2:] - high).max() < spare_px
    assert shown > 5


def test_a_box_ahead_is_where_its_corners_are() -> None:
    place = rectangles([PINHOLE], boxes((10, 0, 1.65, 2, 2, 1, 0)))[0, 0]
    corners = project(PINHOLE, boxes((10, 0, 1.65, 2, 2, 1, 0)).corners[0]).place_px
    np.testing.assert_allclose(place, [*corners.min(axis=0), *corners.max(axis=0)], atol=1e-9)


def test_a_box_that_crosses_the_cameras_plane_is_cut_not_dropped() -> None:
    """A bus beside the camera, from 6 m behind to 6 m ahead: its corners in front alone would be half as wide."""
    bus = boxes((0, 3, 1.5, 12, 2.5, 3, 0))
    place = rectangles([PINHOLE], bus)[0, 0]
    ahead = project(PINHOLE, bus.corners[0])
    corners_only = ahead.place_px[ahead.depth_m > 0.1]
    assert place[0] == -0.5 and place[2] == pytest.approx(corners_only[:, 0].max())
    left_of_corners = corners_only[:, 0].min()
    assert left_of_corners > -0.5 and place[0] < left_of_corners


def test_a_wall_before_the_lens_fills_the_picture_and_what_is_behind_or_beside_is_not_there() -> None:
    around = rectangles([PINHOLE], boxes((0, 0, 1.5, 4, 4, 4, 0.3), (1.5, 0, 1.5, 1, 40, 40, 0)))[0]
    np.testing.assert_allclose(around, [[-0.5, -0.5, 319.5, 179.5]] * 2)
    assert np.isnan(rectangles([PINHOLE], boxes((-10, 0, 1, 4, 2, 2, 0), (2, 20, 1, 1, 1, 1, 0)))).all()
    assert rectangles([PINHOLE, TURNED], boxes()).shape == (2, 0, 4)


def test_the_camera_that_shows_most_is_taken_and_stains_are_not() -> None:
    cameras = {"ahead": PINHOLE, "left": TURNED}
    found = best_crops(cameras, boxes((10, -6, 1, 4, 2, 1.5, 0), (4, 8, 1, 4, 2, 1.5, 0), (90, 0, 1, 0.6, 0.6, 1.7, 0)))
    assert found.camera.tolist() == [0, 1, -1] and found.known.tolist() == [True, True, False]
    assert np.isnan(found.place_px[2]).all()
    far = best_crops(cameras, boxes((90, 0, 1, 0.6, 0.6, 1.7, 0)), least_area_px=1)
    width, height = far.place_px[0, 2:] - far.place_px[0, :2]
    assert far.camera[0] == 1 and 1 <= width * height < LEAST_AREA_PX
    assert not best_crops({}, many(3, 0)).known.any()
    assert len(best_crops(cameras, boxes()).camera) == 0


def test_cameras_are_looked_through_one_by_one() -> None:
    cameras = [each.calibration(1.5) for each in CAMERAS]
    together = rectangles(cameras, many(30, 2))
    for camera, found in zip(cameras, together, strict=True):
        np.testing.assert_allclose(found, rectangles([camera], many(30, 2))[0], atol=1e-9)


def test_what_a_nearer_box_covers() -> None:
    """A car 10 m ahead stands before the lower part of a bus at 20 m, and before nothing of what is beside it."""
    row = boxes(
        (10, 0, 0.8, 4, 2, 1.5, 0), (20, 0, 1.5, 10, 2.5, 3, 0), (20, 9, 1, 4, 2, 1.5, 0), (-9, 0, 1, 4, 2, 1, 0)
    )
    crops = best_crops({"ahead": PINHOLE}, row)
    shares = hidden_shares(crops, np.linalg.norm(row.center, axis=1))
    assert shares[[0, 2, 3]].tolist() == [0, 0, 0] and 0.2 < shares[1] < 0.9
    assert hidden_shares(crops, np.array([2.0, 1.0, 2.0, 0.0]))[0] > 0.2
    assert hidden_shares(best_crops({}, row), np.ones(4)).tolist() == [0] * 4


def test_a_small_picture_of_a_bent_lens() -> None:
    for camera in (AHEAD, BENT_CAMERA):
        found = best_crops({camera.name: camera.calibration(1.5)}, many(40, 3))
        inside = found.place_px[found.known]
        assert len(inside) > 2
        rows, columns = camera.intrinsics.size
        assert (inside >= -0.5).all() and (inside <= [columns - 0.5, rows - 0.5] * 2).all()


def test_what_is_refused() -> None:
    with pytest.raises(InvalidValueError, match="least_area_px must be a finite number > 0, got 0"):
        best_crops({"ahead": PINHOLE}, many(3, 0), least_area_px=0)
    folded = CameraCalibration(LENS.size, LENS.matrix, np.array([-0.9, 0, 0, 0, 0]), SE3.identity())
    with pytest.raises(InvalidValueError, match="distortion must be one to one"):
        rectangles([folded], many(3, 0))
