"""Points and pictures together: depths that points correct, and points alone where there is no picture."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from small_cameras import AHEAD, SIDEWAYS
from tiny_pictures import GRID, TINY_BOTH, shake, tiny_view

from coopsim.errors import InvalidValueError
from coopsim.learn.weights import make_network
from coopsim.nn.camera.picture_batch import PictureView, collate_pictures
from coopsim.nn.camera.picture_net import DepthBins, PictureFeatures
from coopsim.nn.camera.points_and_pictures import (
    PointsAndPicturesConfig,
    PointsAndPicturesEncoder,
    confidences,
    masked_depth,
)
from coopsim.nn.detector.pillars import PillarBatch, collate, pillarize
from coopsim.sensors.camera.camera import Camera
from coopsim.sensors.camera.intrinsics import Intrinsics

torch.set_num_threads(1)
BINS = DepthBins(farthest_m=30.0, count=4)


def encoder(shaken: bool = False) -> PointsAndPicturesEncoder:
    net = make_network("points_and_pictures", TINY_BOTH).eval()
    if shaken:
        shake(net)
    return net.encoder


def points(count: int = 200, agents: int = 1) -> PillarBatch:
    rng = np.random.default_rng(0)
    low, high = [-19, -19, 0.4, 0, 0], [19, 19, 3, 1, 0]
    return collate([pillarize(rng.uniform(low, high, (count, 5)).astype(np.float32), GRID) for _ in range(agents)])


def test_a_fresh_network_has_the_features_of_points() -> None:
    net, cloud = encoder(), points()
    assert torch.equal(net(cloud, collate_pictures([tiny_view()])), net.points(cloud))


def test_without_pictures_a_trained_network_has_the_features_of_points() -> None:
    net, cloud = encoder(shaken=True), points(agents=2)
    nothing = PictureView([], np.zeros(3), GRID)
    alone = net.points(cloud)
    torch.testing.assert_close(net(cloud, collate_pictures([nothing, nothing])), alone)
    one_sees = net(cloud, collate_pictures([nothing, tiny_view()]))
    torch.testing.assert_close(one_sees[0], alone[0])
    assert (one_sees[1] - alone[1]).abs().max() > 5e-4


def test_pictures_alone_make_features_where_there_is_no_point() -> None:
    net = encoder(shaken=True)
    features = net(points(count=0), collate_pictures([tiny_view()]))
    assert torch.isfinite(features).all() and not torch.equal(features, net.points(points(count=0)))


def test_measured_depths_move_what_is_laid() -> None:
    net = encoder(shaken=True)
    own = np.random.default_rng(3).uniform([2, -10, 0], [20, 10, 3], (400, 3))
    plain, measured = (collate_pictures([tiny_view(AHEAD, points_m=each)]) for each in (None, own))
    one, other = (net.pictures.canvas(batch, net.read(batch)) for batch in (plain, measured))
    assert not torch.allclose(one, other)


def test_a_measured_depth_is_believed_as_far_as_the_prediction_finds_it_possible() -> None:
    """Where another bin is more than `trust` ahead of the measured one, it stays the likeliest."""
    draws = torch.Generator().manual_seed(0)
    depth = 6 * torch.randn(2, 5, 40, 40, generator=draws)
    bin_of = torch.randint(0, 4, (2, 40, 40), generator=draws)
    measured_m, trust = BINS.middles()[bin_of], torch.tensor(4.0)
    seen = PictureFeatures(torch.zeros(1), depth, torch.zeros(1))
    masked = masked_depth(seen, measured_m, trust, BINS).depth
    behind = depth.amax(1) - depth.gather(1, bin_of[:, None])[:, 0]
    believed = masked.argmax(1) == bin_of
    assert torch.equal(believed, behind < trust)
    assert torch.equal(masked.argmax(1)[~believed], depth.argmax(1)[~believed])
    assert 0.2 < believed.float().mean() < 0.8


def test_depths_stay_where_nothing_is_measured_and_rise_in_two_bins_where_something_is() -> None:
    seen = PictureFeatures(torch.ones(1), torch.zeros(1, 5, 1, 3), torch.ones(1))
    between = float(BINS.middles()[1:3].mean())
    masked = masked_depth(seen, torch.tensor([[[0.0, between, 90.0]]]), torch.tensor(4.0), BINS)
    torch.testing.assert_close(masked.depth[0, :, 0].T, torch.tensor([[0.0] * 5, [0, 2, 2, 0, 0], [0, 0, 0, 0, 4]]))
    assert masked.features is seen.features and masked.label is seen.label


def test_confidences_say_how_much_is_seen() -> None:
    views = [tiny_view(AHEAD, SIDEWAYS), PictureView([], np.zeros(3), GRID)]
    for picture, value in zip(views[0].pictures, (51, 153), strict=True):
        picture.rgb[:] = value
    batch = collate_pictures(views)
    canvas = torch.zeros(2, 6, 16, 16)
    canvas[0, 2, :4, :4] = 1.0
    depth = torch.zeros(2, 5, 4, 6)
    depth[1, 3] = 100.0
    found = confidences(canvas, batch, [PictureFeatures(torch.zeros(1), depth, torch.zeros(1))])
    wanted = [[10 / 16, (0.2 + 1.0) / 2, (0.2 + 0.6) / 2, 0.0], [0.0] * 4]
    torch.testing.assert_close(found, torch.tensor(wanted))


def test_confidences_are_means_over_pictures_of_all_sizes() -> None:
    """Pictures of different sizes come in groups; an agent's mean is over all of its pictures."""
    view = tiny_view(AHEAD, SIDEWAYS, Camera("small", Intrinsics.from_fov(24, 16)))
    for picture, value in zip(view.pictures, (0, 0, 255), strict=True):
        picture.rgb[:] = value
    batch = collate_pictures([view])
    seen = [PictureFeatures(torch.zeros(1), torch.zeros(n, 5, 2, 2), torch.zeros(1)) for n in (2, 1)]
    found = confidences(torch.zeros(1, 6, 16, 16), batch, seen)
    torch.testing.assert_close(found, torch.tensor([[0.0, 0.2, 1 / 3, 0.0]]))


def test_points_and_pictures_of_others_are_refused() -> None:
    net = encoder()
    with pytest.raises(InvalidValueError, match=r"same agents and canvases, got 2 of \(16, 16\) and 1 of \(16, 16\)"):
        net(points(agents=2), collate_pictures([tiny_view()]))


def test_gradients_reach_the_trust() -> None:
    net = encoder(shaken=True).train()
    own = np.random.default_rng(3).uniform([2, -10, 0], [20, 10, 3], (400, 3))
    net(points(), collate_pictures([tiny_view(AHEAD, points_m=own)])).square().sum().backward()
    assert net.trust.grad is not None and net.trust.grad != 0


def test_bad_sizes_of_both_are_refused() -> None:
    with pytest.raises(InvalidValueError, match=r"experts must be an integer in 1\.\.64, got 0"):
        PointsAndPicturesConfig(experts=0)
