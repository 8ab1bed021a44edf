"""The encoder of pictures: a map for any number of pictures, on any canvas that divides by 8."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import torch
from small_cameras import AHEAD, BENT_CAMERA, PARTIAL, ROLLED, SIDEWAYS
from tiny_pictures import TINY_PICTURES, shake, tiny_view

from coopsim.errors import InvalidValueError
from coopsim.learn.weights import make_network
from coopsim.nn.camera.lift_splat import LiftSplatConfig, LiftSplatEncoder
from coopsim.nn.camera.picture_batch import PictureView, collate_pictures
from coopsim.types import BevGrid

torch.set_num_threads(1)


def encoder(**changes: Any) -> LiftSplatEncoder:
    net = make_network("pictures", TINY_PICTURES | changes).eval()
    shake(net)
    return net.encoder


@pytest.mark.parametrize("cells", [(8, 16), (16, 8), (24, 24)])
def test_features_are_twice_as_coarse_as_the_canvas(cells: tuple[int, int]) -> None:
    grid = BevGrid((-9.6, 2.4 * cells[1] - 9.6), (-9.6, 2.4 * cells[0] - 9.6), 2.4)
    batch = collate_pictures([tiny_view(grid=grid), PictureView([], np.zeros(3), grid)])
    features = encoder()(batch)
    assert features.shape == (2, 8, cells[0] // 2, cells[1] // 2)
    assert (features >= 0).all() and (features[0] != features[1]).any()


def test_other_canvases_are_refused() -> None:
    view = tiny_view(grid=BevGrid((-4.8, 4.8), (-19.2, 19.2), 2.4))
    with pytest.raises(InvalidValueError, match=r"canvas must divide by 8, got \(16, 4\)"):
        encoder()(collate_pictures([view]))


def test_an_agent_has_the_same_map_alone_and_among_others() -> None:
    agents = [tiny_view(AHEAD, PARTIAL), tiny_view(SIDEWAYS, seed=1), tiny_view(BENT_CAMERA, ROLLED, seed=2)]
    net = encoder()
    together = net(collate_pictures(agents))
    for number, agent in enumerate(agents):
        torch.testing.assert_close(net(collate_pictures([agent]))[0], together[number], atol=1e-5, rtol=1e-5)


def test_an_agent_without_pictures_has_an_empty_canvas_and_a_map() -> None:
    batch, net = collate_pictures([PictureView([], np.zeros(3), tiny_view().grid)] * 2), encoder()
    assert net.pictures.read(batch) == []
    canvas = net.pictures.canvas(batch, [])
    assert canvas.shape == (2, 6, 16, 16) and not canvas.any()
    assert torch.isfinite(net(batch)).all()


def test_what_is_beyond_the_last_bin_is_not_laid() -> None:
    net, batch = encoder(), collate_pictures([tiny_view()])
    (seen,) = net.pictures.read(batch)
    seen.depth[:, -1] = 50.0
    assert not net.pictures.canvas(batch, [seen]).any()


def test_gradients_reach_every_parameter() -> None:
    net = encoder().train()
    net(collate_pictures([tiny_view(), tiny_view(seed=1)])).square().sum().backward()
    without = [name for name, each in net.named_parameters() if each.grad is None or not each.grad.any()]
    # Classes are for a loss of their own.
    assert without == ["pictures.net.label.weight", "pictures.net.label.bias"]
    assert all(torch.isfinite(each.grad).all() for each in net.parameters() if each.grad is not None)


def test_maps_have_the_sizes_of_the_encoder_of_points() -> None:
    maps = LiftSplatConfig().maps
    assert (maps.cell_m, maps.pillar_features, maps.channels, maps.features) == (0.6, 32, (48, 64, 96), 64)


@pytest.mark.parametrize(
    ("bad", "match"),
    [
        ({"width": 0}, r"width must be an integer in 1\.\.1024, got 0"),
        ({"picture_features": 10**6}, "picture_features must be"),
        ({"depth_bins": 1}, "depth_bins must be"),
        ({"farthest_m": 1.0}, "nearest_m must be less than farthest_m, got 2.0 and 1.0"),
        ({"cell_m": -1.0}, "cell_m must be a finite number > 0"),
        ({"channels": [4, 4]}, "channels must have 3 numbers"),
        ({"layers": [0, 0, 10**6]}, r"layers\[2\] must be"),
    ],
)
def test_bad_sizes_are_refused(bad: dict[str, Any], match: str) -> None:
    with pytest.raises(InvalidValueError, match=match):
        LiftSplatConfig(**bad)
