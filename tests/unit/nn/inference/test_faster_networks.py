"""Networks made faster give what the networks that they were made of give."""

from __future__ import annotations

import numpy as np
import pytest

torch = pytest.importorskip("torch")

from coopsim.errors import InvalidValueError  # noqa: E402
from coopsim.learn.weights import make_network  # noqa: E402
from coopsim.nn.detector.encoder import HEADS, LAYOUTS  # noqa: E402
from coopsim.nn.detector.pillars import collate, pillarize  # noqa: E402
from coopsim.nn.inference.backend import Backend  # noqa: E402
from coopsim.nn.inference.encoders import PointEncoder, SensedFrame, folded  # noqa: E402
from coopsim.types import BevGrid  # noqa: E402

TINY = {"cell_m": 1.2, "pillar_features": 8, "channels": [8, 8, 8], "layers": [1, 0, 1], "features": 16}
GRID = BevGrid((-19.2, 19.2), (-19.2, 19.2), 1.2)


PARTS = {"sweeps": 2, "bands_m": [1.0], "apart": True, "ground": "local"}


def network(layout: str = "dense", head: str = "centre", **more: object) -> torch.nn.Module:
    """A network whose normalisations are not trivial."""
    net, draw = (
        make_network("detector", TINY | {"layout": layout, "head": head} | more).eval(),
        torch.Generator().manual_seed(1),
    )
    for name, value in net.state_dict().items():
        if "running_mean" in name:
            value.normal_(0, 0.1, generator=draw)
        elif "running_var" in name:
            value.uniform_(0.5, 2.0, generator=draw)
    return net.requires_grad_(False)


def cloud(count: int) -> np.ndarray:
    rng = np.random.default_rng(0)
    low, high = [-19, -19, 0.5, 0, 0], [19, 19, 2, 1, 0]
    return rng.uniform(low, high, (count, 5)).astype(np.float32)


@pytest.mark.parametrize("numbers", [torch.float32, torch.bfloat16])
@pytest.mark.parametrize("count", [0, 1, 700])
@pytest.mark.parametrize("layout", LAYOUTS)
@pytest.mark.parametrize("more", [{}, PARTS], ids=["whole pillars", "parts"])
def test_a_faster_encoder_gives_the_same_features(
    layout: str, count: int, numbers: torch.dtype, more: dict[str, object]
) -> None:
    net = network(layout, **more)
    batch = collate([pillarize(cloud(each), GRID, net.config.pillars) for each in (count, 50)])
    backend = Backend(numbers=numbers)
    encoder = PointEncoder(net, backend)
    with backend.inference():
        got = encoder.encode([SensedFrame(encoder, cloud(each)) for each in (count, 50)], [GRID] * 2).float()
    with torch.no_grad():
        expected = net.encoder(batch)
    assert got.shape == expected.shape == (2, 16, 16, 16)
    torch.testing.assert_close(got, expected, rtol=0.05, atol=0.05 * float(expected.abs().max()))


@pytest.mark.parametrize("head", HEADS)
def test_a_folded_head_gives_the_same_heat_and_the_old_one_stays(head: str) -> None:
    net, maps = network(head=head), torch.rand(1, 16, 8, 8)
    before = {name: value.clone() for name, value in net.head.state_dict().items()}
    faster = folded(net.head)
    for got, expected in zip(faster.heat(maps), net.head.heat(maps), strict=True):
        torch.testing.assert_close(got, expected, rtol=1e-4, atol=1e-5)
    for name, value in net.head.state_dict().items():
        assert torch.equal(value, before[name])
    assert not any(isinstance(each, (torch.nn.BatchNorm1d, torch.nn.BatchNorm2d)) for each in faster.modules())


def test_a_grid_that_does_not_divide_is_refused() -> None:
    odd = BevGrid((0.0, 14.4), (0.0, 9.6), 1.2)
    encoder = PointEncoder(network())
    with pytest.raises(InvalidValueError, match=r"must divide by 8, got \(8, 12\)"):
        encoder.encode([SensedFrame(encoder, cloud(5))], [odd])
