"""Parts of pillars: what hangs above, or came before, changes nothing of what is gathered and encoded below and now."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

from coopsim.errors import CoopsimError
from coopsim.nn.detector.detector_net import make_encoder
from coopsim.nn.detector.encoder import LAYOUTS, EncoderConfig
from coopsim.nn.detector.pillars import PillarSettings, collate, pillarize
from coopsim.types import BevGrid

torch.set_num_threads(1)
GRID = BevGrid((-4.8, 4.8), (-4.8, 4.8), 0.6)
TINY = EncoderConfig(pillar_features=8, channels=(8, 8, 8), layers=(1, 1, 1), features=16)
BANDS = (1.0, 2.2)


def person(age_s: float = 0.0) -> np.ndarray:
    return np.float32([[0.3 + 0.01 * k, 0.2, z, 0.5, age_s] for k, z in enumerate((0.4, 0.7, 1.2, 1.6, 1.8))])


def ground() -> np.ndarray:
    return np.float32([[x, y, 0.0, 0.3, 0] for x in (-2, 0, 2) for y in (-2, 0, 2)])


def crown() -> np.ndarray:
    rng = np.random.default_rng(0)
    return rng.uniform([0, 0, 2.3, 0.1, 0], [0.6, 0.6, 5.0, 0.9, 0], (400, 5)).astype(np.float32)


def test_a_pillar_s_points_are_counted_by_band() -> None:
    found = pillarize(np.concatenate([ground(), person(), crown()]), GRID, PillarSettings(bands_m=BANDS))
    assert len(found.cell) == 1
    assert found.count.tolist() == [2, 3, 400]
    apart = pillarize(np.concatenate([ground(), person(0.1), crown()]), GRID, PillarSettings(bands_m=BANDS, apart=True))
    assert apart.count.tolist() == [0, 0, 400, 2, 3, 0]


def test_a_crown_changes_nothing_of_what_stands_under_it() -> None:
    for more, same in ((crown(), slice(0, 16)), (person(0.1) + np.float32([0.2, 0, 0, 0, 0]), slice(0, 24))):
        config = replace(TINY, sweeps=2, bands_m=BANDS, apart=True)
        net = make_encoder(config).eval()
        alone, under = (
            net.of_parts(collate([pillarize(points, GRID, config.pillars)]))[0]
            for points in (np.concatenate([ground(), person()]), np.concatenate([ground(), person(), more]))
        )
        torch.testing.assert_close(under[same], alone[same], rtol=0, atol=0)
        assert not torch.equal(under, alone)


def test_in_a_whole_pillar_a_crown_does_change_it() -> None:
    net = make_encoder(TINY).eval()
    alone, under = (
        net.of_pillars(collate([pillarize(points, GRID)])) for points in (person(), np.concatenate([person(), crown()]))
    )
    assert not torch.allclose(alone, under)


def test_one_part_is_the_whole_pillar() -> None:
    points = np.concatenate([person(), person(0.1), crown()])
    one, other = pillarize(points, GRID), pillarize(points, GRID, PillarSettings(bands_m=(100.0,)))
    np.testing.assert_array_equal(one.features, other.features)
    np.testing.assert_array_equal(one.count, other.count[::2])


@pytest.mark.parametrize("layout", LAYOUTS)
@pytest.mark.parametrize("more", [{"bands_m": BANDS}, {"apart": True}, {"bands_m": BANDS, "apart": True}])
def test_encoders_of_parts_take_any_cloud_and_train_all_weights(layout: str, more: dict[str, object]) -> None:
    config = replace(TINY, layout=layout, sweeps=2, **more)
    rng = np.random.default_rng(0)
    points = rng.uniform([-5, -5, 0.4, 0, 0], [5, 5, 3, 1, 0], (300, 5)).astype(np.float32)
    points[150:, 4] = 0.1
    clouds = [pillarize(points[:count], GRID, config.pillars) for count in (0, 1, 300)]
    net = make_encoder(config)
    features = net(collate(clouds))
    assert features.shape == (3, 16, 8, 8)
    features.square().sum().backward()
    assert all(weight.grad is not None and weight.grad.abs().sum() > 0 for weight in net.parameters())
    net(collate(clouds[:2]))
    net(collate(clouds[:1]))
    net.eval()
    torch.testing.assert_close(net(collate(clouds))[2], net(collate(clouds[2:]))[0], atol=1e-5, rtol=1e-5)


def test_bad_options_are_refused() -> None:
    for wrong in ({"bands_m": (2.0, 1.0)}, {"bands_m": (0.0,)}, {"bands_m": 2.0}, {"bands_m": tuple(range(1, 10))},
                  {"apart": True}, {"ground": "flat"}):  # fmt: skip
        with pytest.raises(CoopsimError):
            EncoderConfig(**wrong)
    assert EncoderConfig(bands_m=[1]).bands_m == (1.0,)
