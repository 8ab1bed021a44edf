"""A detector of points and pictures: without pictures it is the one of points that it contains."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

torch = pytest.importorskip("torch")

from tiny_pictures import TINY_BOTH, shake  # noqa: E402

from coopsim.learn.weights import make_network  # noqa: E402
from coopsim.nn.detector.pillars import PillarSettings  # noqa: E402
from coopsim.nn.inference.detectors import CloudAndPicturesDetector, CloudDetector  # noqa: E402


@pytest.mark.parametrize("heading_rad", [0.0, 0.4])
def test_without_pictures_it_finds_what_points_alone_show(heading_rad: float, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COOPSIM_PRECISION", "float32")
    net = make_network("points_and_pictures", TINY_BOTH).eval()
    shake(net)
    alone = SimpleNamespace(
        encoder=net.encoder.points,
        head=net.head,
        config=SimpleNamespace(cell_m=TINY_BOTH["pictures"]["cell_m"], sweeps=1, pillars=PillarSettings()),
    )
    rng = np.random.default_rng(0)
    points = rng.uniform([-40, -20, 0.4, 0, 0], [40, 20, 3, 1, 0], (600, 5)).astype(np.float32)
    where = ((40.0, 20.0), heading_rad, 0.001)
    found, expected = (
        CloudAndPicturesDetector(net).detect(points, [], *where),
        CloudDetector(alone).detect(points, *where),
    )
    assert len(expected) > 5
    np.testing.assert_allclose(found.boxes.array, expected.boxes.array, atol=1e-3)
    np.testing.assert_allclose(found.score, expected.score, atol=1e-4)
