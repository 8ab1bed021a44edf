"""Detectors of clouds: without pictures one of both is the one of points; velocities are told from two sweeps."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

torch = pytest.importorskip("torch")

from tiny_pictures import TINY_BOTH, shake  # noqa: E402

from coopsim.learn.weights import make_network  # noqa: E402
from coopsim.nn.detector.detector_net import DetectorNet  # noqa: E402
from coopsim.nn.detector.encoder import EncoderConfig  # noqa: E402
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
        motion=None,
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


def test_a_network_that_compares_sweeps_tells_velocities_where_it_is_given_two() -> None:
    small = EncoderConfig(0.6, 8, (8, 8, 8), (1, 1, 1), 8, sweeps=2, head="street", layout="sparse", apart=True)
    with torch.random.fork_rng():
        torch.manual_seed(0)
        net = DetectorNet(small).eval()
    rng = np.random.default_rng(0)
    points = rng.uniform([-20, -20, 0.4, 0, 0], [20, 20, 3, 1, 0], (600, 5)).astype(np.float32)
    points[300:, 4] = 0.1
    both, now = CloudDetector(net).detect_around([points, points[:300]], 20.0, 0.001)
    assert len(both) > 5 and len(now) > 5
    assert now.velocity is None and both.velocity is not None
    with torch.inference_mode():
        boxes, expected = net.motion.look(points, both.boxes.array)
    np.testing.assert_allclose(both.velocity, expected, atol=1e-4)  # the same for boxes that were turned round
    np.testing.assert_allclose(both.boxes.array, boxes)
    assert np.abs(expected).max() > 0
