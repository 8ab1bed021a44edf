"""The encoder: any grid, any batch, no dependence on order or neighbours in the batch."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import torch

from coopsim.errors import InvalidValueError
from coopsim.nn.detector.detector_net import make_encoder
from coopsim.nn.detector.encoder import LAYOUTS, EncoderConfig, PillarEncoder
from coopsim.nn.detector.pillars import collate, pillarize
from coopsim.nn.detector.sparse_encoder import SparseEncoder
from coopsim.types import BevGrid

torch.set_num_threads(1)
TINY = EncoderConfig(pillar_features=8, channels=(8, 8, 8), layers=(1, 1, 1), features=16)


@pytest.fixture(params=LAYOUTS)
def encoder(request: pytest.FixtureRequest) -> PillarEncoder | SparseEncoder:
    with torch.random.fork_rng():
        torch.manual_seed(0)
        return make_encoder(replace(TINY, layout=request.param)).eval()


def pillars(seed: int, half_m: tuple[float, float] = (9.6, 4.8), count: int = 300):
    rng = np.random.default_rng(seed)
    points = rng.uniform([-10, -5, 0.4, 0, 0], [10, 5, 3, 1, 0], (count, 5)).astype(np.float32)
    return pillarize(points, BevGrid((-half_m[0], half_m[0]), (-half_m[1], half_m[1]), 0.6))


@pytest.mark.parametrize("half_m", [(9.6, 4.8), (4.8, 9.6), (2.4, 2.4)])
def test_any_grid_that_divides_by_eight(encoder: Any, half_m: tuple[float, float]) -> None:
    features = encoder(collate([pillars(0, half_m)]))
    assert features.shape == (1, 16, round(half_m[1] / 0.6), round(half_m[0] / 0.6))
    assert (features >= 0).all()


def test_other_grids_are_refused(encoder: Any) -> None:
    with pytest.raises(InvalidValueError, match="divide by 8"):
        encoder(collate([pillars(0, (6.0, 4.8))]))


def test_a_cloud_has_the_same_map_alone_and_in_a_batch(encoder: Any) -> None:
    clouds = [pillars(k) for k in range(3)]
    net = encoder
    together = net(collate(clouds))
    for number, cloud in enumerate(clouds):
        torch.testing.assert_close(net(collate([cloud]))[0], together[number], atol=1e-5, rtol=1e-5)


def test_an_empty_cloud_has_a_map_and_gradients_are_finite(encoder: Any) -> None:
    net = encoder.train()
    features = net(collate([pillars(0, count=0), pillars(1)]))
    features.sum().backward()
    assert all(torch.isfinite(weight.grad).all() for weight in net.parameters() if weight.grad is not None)
    assert torch.isfinite(net(collate([pillars(0, count=0)]))).all()


def test_a_single_point_can_be_trained_on(encoder: Any) -> None:
    assert torch.isfinite(encoder.train()(collate([pillars(0, count=1)]))).all()


def test_the_largest_point_of_a_pillar_counts() -> None:
    cloud = np.float32([[0.3, 0.3, z, 0.5, 0] for z in (0.5, 1.0, 2.0)])
    batch = collate([pillarize(cloud, BevGrid((-2.4, 2.4), (-2.4, 2.4), 0.6))])
    net = make_encoder(TINY).eval()
    each = torch.relu(net.points_norm(net.points(batch.features)))
    canvas = net.canvas(batch)
    torch.testing.assert_close(canvas[0, :, 4, 4], each.amax(0))
    assert canvas.abs().sum() == canvas[0, :, 4, 4].abs().sum()


def test_bad_configurations_are_refused() -> None:
    for wrong in ({"cell_m": 0.0}, {"channels": (8, 8)}, {"sweeps": 3}, {"features": 0}):
        with pytest.raises(InvalidValueError):
            EncoderConfig(**wrong)


def test_a_sparse_map_is_empty_far_from_every_point() -> None:
    cloud = np.float32([[0.3, 0.3, 1.0, 0.5, 0]])
    net = make_encoder(replace(TINY, layout="sparse")).eval()
    with torch.no_grad():
        features = net(collate([pillarize(cloud, BevGrid((-48.0, 48.0), (-48.0, 48.0), 0.6))]))[0]
    row, column = torch.nonzero(features.amax(0), as_tuple=True)
    assert len(row) and (row - 40).abs().max() <= 8 and (column - 40).abs().max() <= 8
    assert row.unique().numel() >= 5, "the centre of a car of which one end is seen must have features"
