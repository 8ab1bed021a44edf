"""The embedder "picture_identity": what objects look like, and nothing where no picture shows them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("torch")

from tiny_networks import tiny_picture_identity

from coopsim.detection.embedder import Embedder, make_embedder
from coopsim.errors import InvalidValueError, UnknownNameError
from coopsim.geometry.boxes import Boxes3D
from coopsim.sensors.camera.camera import Camera
from coopsim.sensors.camera.intrinsics import Intrinsics
from coopsim.types import CameraImage, Detections, Odometry, SensorView

LENS = Intrinsics.from_fov(320, 180, np.radians(100))
AHEAD, LEFT = Camera("ahead", LENS).calibration(1.5), Camera("left", LENS, yaw_rad=1.2).calibration(1.5)


@pytest.fixture(scope="module")
def weights() -> Path:
    return Path(tiny_picture_identity())


def make(weights: Path, **options: float) -> Embedder:
    given = "".join(f", {name}={value}" for name, value in options.items())
    return make_embedder(f"picture_identity(weights='{weights}'{given})")


def found(*rows: tuple[float, ...]) -> Detections:
    boxes = np.array(rows, dtype=float).reshape(-1, 7)
    return Detections(Boxes3D.from_array(boxes), np.full(len(boxes), 0.9), np.zeros(len(boxes), dtype=int))


def view(seed: int = 0) -> SensorView:
    rng = np.random.default_rng(seed)
    images = {name: CameraImage(rng.integers(0, 256, (180, 320, 3)).astype(np.uint8)) for name in ("ahead", "left")}
    return SensorView("cav_0", 0, Odometry(np.zeros(4)), images=images, cameras={"left": LEFT, "ahead": AHEAD})


def test_what_pictures_show_has_a_vector_and_nothing_else(weights: Path) -> None:
    seen = found((10, 0, 1, 4, 2, 1.5, 0), (3, 9, 1, 4, 2, 1.5, 0), (-10, 0, 1, 4, 2, 1.5, 0), (95, 0, 1, 1, 1, 2, 0))
    rows = np.asarray(make(weights).embed(seen, view()))
    assert rows.shape == (4, 6) and rows.any(axis=1).tolist() == [True, True, False, False]
    np.testing.assert_allclose(np.linalg.norm(rows[:2], axis=1), 1.0, atol=1e-3)
    assert not np.asarray(make(weights, least_area_px=1e6).embed(seen, view())).any()


def test_the_vector_is_of_the_pixels_in_the_box(weights: Path) -> None:
    """Another picture behind the object changes nothing but what the margin shows; another on it does."""
    seen, one = found((10, 0, 1, 4, 2, 1.5, 0)), view()
    rgb = one.images["ahead"].rgb
    assert rgb is not None
    elsewhere, on_it = rgb.copy(), rgb.copy()
    elsewhere[:, :100], on_it[80:110, 140:180] = 0, 0
    embedder = make(weights)
    rows = [
        np.asarray(embedder.embed(seen, replace(one, images={"ahead": CameraImage(pixels)})))
        for pixels in (rgb, elsewhere, on_it)
    ]
    np.testing.assert_array_equal(rows[0], rows[1])
    assert np.abs(rows[0] - rows[2]).max() > 1e-3


def test_what_stands_behind_another_has_none(weights: Path) -> None:
    seen = found((10, 0, 1, 4, 2, 2.0, 0), (20, 0, 1, 4, 2, 1.5, 0))
    assert np.asarray(make(weights).embed(seen, view())).any(axis=1).tolist() == [True, False]
    assert np.asarray(make(weights, most_hidden=1).embed(seen, view())).any(axis=1).tolist() == [True, True]
    assert np.asarray(make(weights).embed(seen[1:], view())).any()


def test_without_pictures_nothing_is_known(weights: Path) -> None:
    seen, embedder = found((10, 0, 1, 4, 2, 1.5, 0)), make(weights)
    blind = replace(view(), images={}, cameras={})
    depth_alone = replace(view(), images={"ahead": CameraImage(depth=np.ones((180, 320), np.float32))})
    for nothing in (blind, depth_alone):
        assert not np.asarray(embedder.embed(seen, nothing)).any()
    assert np.asarray(embedder.embed(found(), view())).shape == (0, 6)


def test_what_is_refused(weights: Path, tmp_path: Path) -> None:
    with pytest.raises(InvalidValueError, match="least_area_px must be a finite number > 0"):
        make(weights, least_area_px=0)
    with pytest.raises(InvalidValueError, match=r"most_hidden must be in \[0, 1\]"):
        make(weights, most_hidden=2)
    with pytest.raises(InvalidValueError, match="must be weights of the kind 'picture_identity', is 'detector'"):
        make_embedder("picture_identity(weights=pillars)")
    with pytest.raises(UnknownNameError, match="unknown weights 'pictures'"):
        make_embedder("picture_identity(weights=pictures)")
    broken = tmp_path / "broken.safetensors"
    broken.write_bytes(weights.read_bytes()[:-7])
    with pytest.raises(InvalidValueError, match="broken"):
        make(broken)
