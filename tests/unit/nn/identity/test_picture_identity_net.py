"""Vectors of crops: of length 1, each by itself."""

from __future__ import annotations

from dataclasses import asdict

import pytest

pytest.importorskip("torch")

import torch

from coopsim.errors import InvalidValueError
from coopsim.learn.weights import make_network
from coopsim.nn.identity.picture_identity_net import PictureIdentityConfig

TINY = {"edge_px": 16, "channels": [4, 4, 8, 8], "dim": 6}


def test_a_vector_of_length_one_for_each_crop_by_itself() -> None:
    net = make_network("picture_identity", TINY, 1).eval()
    crops = torch.randint(0, 256, (5, 3, 16, 16), generator=torch.Generator().manual_seed(0), dtype=torch.uint8)
    vectors = net(crops)
    assert vectors.shape == (5, net.dim) == (5, 6)
    torch.testing.assert_close(vectors.norm(dim=1), torch.ones(5))
    torch.testing.assert_close(net(crops[2:3].float()), vectors[2:3])
    assert net(crops[:0]).shape == (0, 6)


def test_the_default_fits_into_a_small_file() -> None:
    net = make_network("picture_identity", {})
    assert net.dim == 64 and 2 * sum(each.numel() for each in net.parameters()) < 1_000_000
    assert asdict(net.config) == asdict(PictureIdentityConfig())


@pytest.mark.parametrize(
    ("options", "match"),
    [
        ({"edge_px": 20}, "edge_px must be a multiple of 8, got 20"),
        ({"edge_px": 0}, "edge_px must be"),
        ({"margin": -0.1}, "margin must be in"),
        ({"channels": [4, 4]}, "channels must be 4 numbers"),
        ({"channels": [4, 0, 4, 4]}, r"channels\[1\] must be"),
        ({"dim": 0}, "dim must be"),
    ],
)
def test_bad_sizes(options: dict[str, object], match: str) -> None:
    with pytest.raises(InvalidValueError, match=match):
        make_network("picture_identity", options)
