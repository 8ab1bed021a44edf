"""The network on pictures: maps for pictures of any size, a beginning at the ground, and backbones of one's own."""

from __future__ import annotations

from typing import Any

import pytest
import torch
from small_cameras import AHEAD, PARTIAL, SIDEWAYS
from tiny_pictures import TINY_PICTURES, tiny_view
from torch import Tensor, nn

from coopsim.errors import InvalidValueError, UnknownNameError
from coopsim.learn.weights import make_network
from coopsim.nn.camera.picture_batch import CameraViews, collate_pictures
from coopsim.nn.camera.picture_net import BACKBONES, DepthBins, PictureNet
from coopsim.sensors.camera.camera import Camera
from coopsim.sensors.camera.intrinsics import Intrinsics

torch.set_num_threads(1)
BINS = DepthBins(farthest_m=30.0, count=4)


def fresh(**options: Any) -> PictureNet:
    with torch.random.fork_rng():
        torch.manual_seed(0)
        return PictureNet(5, BINS, width=4, **options).eval()


def views(*cameras: Camera) -> CameraViews:
    (found,) = collate_pictures([tiny_view(*cameras)]).views
    return found


@pytest.mark.parametrize("camera", [AHEAD, PARTIAL, Camera("odd", Intrinsics.from_fov(37, 9))])
def test_every_cell_has_features_depth_and_class(camera: Camera) -> None:
    look = views(camera)
    seen, cells = fresh()(look.rgb, look.geometry), look.geometry.shape[-2:]
    assert [tuple(each.shape) for each in (seen.features, seen.depth, seen.label)] == [
        (1, channels, *cells) for channels in (5, 5, 10)
    ]


def test_pictures_are_looked_at_one_by_one() -> None:
    together, net = views(AHEAD, SIDEWAYS), fresh()
    both = net(together.rgb, together.geometry)
    for number in range(2):
        one = net(together.rgb[number : number + 1], together.geometry[number : number + 1])
        torch.testing.assert_close(one.features[0], both.features[number])
        torch.testing.assert_close(one.depth[0], both.depth[number])


def test_a_fresh_network_sees_the_ground_where_it_is() -> None:
    look = views(Camera("down", Intrinsics.from_fov(64, 64), pitch_rad=0.4))
    seen = fresh()(look.rgb, look.geometry)
    ground_m = 10 / look.geometry[:, 0].clamp_min(1e-3)
    likeliest = seen.depth.argmax(1)
    assert (BINS.shares(ground_m).gather(1, likeliest[:, None]) > 0.4).all()  # of the two bins beside a depth
    assert len(likeliest.unique()) >= 3


class Mean(nn.Module):
    """Return each cell's mean colour, and the numbers that the cell's geometry has."""

    def __init__(self, width: int) -> None:
        super().__init__()
        self.width = width

    def forward(self, pictures: Tensor, geometry: Tensor) -> Tensor:
        assert pictures.shape[-2] % 16 == pictures.shape[-1] % 16 == 0
        assert pictures.amin() >= -1 and pictures.amax() <= 1
        colour = nn.functional.avg_pool2d(pictures, 8)
        assert colour.shape[-2:] == geometry.shape[-2:]
        return torch.cat([colour, geometry], 1)[:, : self.width]


def test_a_backbone_of_ones_own_is_used(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(BACKBONES, "_entries", dict(BACKBONES._entries))
    BACKBONES.register("mean")(Mean)
    net = make_network("pictures", TINY_PICTURES | {"backbone": "mean"})
    backbone = net.encoder.pictures.net.backbone
    assert isinstance(backbone, Mean) and backbone.width == 4
    features = net.eval().encoder(collate_pictures([tiny_view(AHEAD, PARTIAL)]))
    assert torch.isfinite(features).all() and features.any()
    with pytest.raises(
        InvalidValueError, match=r"backbone must give maps of shape \(1, 9, 4, 6\), gave \(1, 7, 4, 6\)"
    ):
        PictureNet(5, BINS, "mean", width=9)(views(AHEAD).rgb, views(AHEAD).geometry)


def test_cells_keep_their_places_where_a_picture_is_filled_up(monkeypatch: pytest.MonkeyPatch) -> None:
    """A picture of 2 x 5 cells is filled up to 2 x 6 for its backbone."""
    monkeypatch.setattr(BACKBONES, "_entries", dict(BACKBONES._entries) | {"mean": Mean})
    look, net = views(Camera("odd", Intrinsics.from_fov(37, 9))), fresh(backbone="mean")
    before = net(look.rgb, look.geometry).features
    look.rgb[:, :, :8, 16:24] = 255 - look.rgb[:, :, :8, 16:24]
    changed = (net(look.rgb, look.geometry).features != before).any(1)
    assert changed.nonzero().tolist() == [[0, 0, 2]]


def test_unknown_backbones_are_refused_with_the_known_ones() -> None:
    with pytest.raises(UnknownNameError, match=r"unknown network backbone 'smal'\. Did you mean 'small'"):
        make_network("pictures", TINY_PICTURES | {"backbone": "smal"})
