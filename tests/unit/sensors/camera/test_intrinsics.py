"""Lenses: distortion at parity with OpenCV's, its inverse, and what is refused."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from coopsim.errors import InvalidValueError
from coopsim.sensors.camera.intrinsics import Intrinsics, distort, undistort

MILD = st.tuples(
    st.floats(-0.2, 0.3), st.floats(0.0, 0.1), st.floats(-0.005, 0.005), st.floats(-0.005, 0.005), st.floats(0.0, 0.02)
)
WIDE = np.stack(np.meshgrid(np.linspace(-0.9, 0.9, 9), np.linspace(-0.6, 0.6, 7)), axis=-1).reshape(-1, 2)


@given(MILD)
def test_undistorting_undoes_distorting(coefficients: Any) -> None:
    np.testing.assert_allclose(undistort(distort(WIDE, coefficients), coefficients), WIDE, atol=1e-8)


@given(MILD)
def test_a_lens_looks_along_the_rays_that_it_projects(coefficients: Any) -> None:
    lens = Intrinsics(64, 40, 50.0, 45.0, 30.0, 21.0, coefficients)
    columns, rows = np.meshgrid(np.arange(64), np.arange(40))
    np.testing.assert_allclose(lens.project(3.0 * lens.rays), np.stack([columns, rows], -1).reshape(-1, 2), atol=1e-6)
    np.testing.assert_allclose(lens.unit_rays * lens.stretch.reshape(-1, 1), lens.rays, rtol=1e-6)


def test_points_project_as_opencv_projects_them() -> None:
    cv2 = pytest.importorskip("cv2", reason="opencv-python is not installed")
    lens = Intrinsics(320, 180, 140.0, 130.0, 155.0, 92.0, (-0.21, 0.06, 0.003, -0.002, 0.01))
    rng = np.random.default_rng(0)
    points = np.column_stack([rng.uniform(-1, 1, (200, 2)), np.ones(200)]) * rng.uniform(2, 50, (200, 1))
    theirs, _ = cv2.projectPoints(points, np.zeros(3), np.zeros(3), lens.matrix, np.array(lens.distortion))
    np.testing.assert_allclose(lens.project(points), theirs[:, 0], atol=1e-9)


def test_a_fov_is_from_edge_to_edge() -> None:
    lens = Intrinsics.from_fov(200, 100, np.radians(90))
    assert lens.fx_px == lens.fy_px == pytest.approx(100.0)
    edges = np.array([[-1.0, 0.0, 1.0], [1.0, 0.0, 1.0]])
    np.testing.assert_allclose(lens.project(edges), [[-0.5, 49.5], [199.5, 49.5]])


@pytest.mark.parametrize(
    ("bad", "match"),
    [
        ({"width": 0}, r"width must be an integer in 1\.\.8192, got 0"),
        ({"width": 100_000}, r"width must be an integer in 1\.\.8192"),
        ({"height": 10.5}, "height must be an integer"),
        ({"horizontal_fov_rad": np.pi}, r"horizontal_fov_rad must be in \(0, pi\)"),
        ({"horizontal_fov_rad": 0.0}, "horizontal_fov_rad"),
        ({"horizontal_fov_rad": "wide"}, "horizontal_fov_rad"),
        ({"distortion": (0.1, 0.2)}, r"distortion \(k1, k2, p1, p2, k3\) must have shape \(5\)|shape \(5,\)"),
        ({"distortion": (0.1, np.nan, 0, 0, 0)}, "distortion .* must be finite"),
        ({"distortion": (-0.25, 0.08, 0.0, 0.0, -0.01)}, "fold it over"),
        ({"distortion": (-1.0, 0.0, 0.0, 0.0, 0.0)}, "fold it over"),
    ],
)
def test_bad_lenses_are_refused(bad: dict[str, Any], match: str) -> None:
    with pytest.raises(InvalidValueError, match=match):
        Intrinsics.from_fov(**bad)


@pytest.mark.parametrize("value", [np.nan, -1e9, 1e300])
@pytest.mark.parametrize("name", ["fx_px", "fy_px", "cx_px", "cy_px"])
def test_bad_calibrations_are_refused(name: str, value: float) -> None:
    good = {"width": 32, "height": 18, "fx_px": 20.0, "fy_px": 20.0, "cx_px": 15.5, "cy_px": 8.5}
    with pytest.raises(InvalidValueError, match=f"{name} must be"):
        Intrinsics(**(good | {name: value}))  # type: ignore[arg-type]
