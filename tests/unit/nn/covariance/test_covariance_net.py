"""The network of covariances: bounds, the constant one, and the motion that belongs to it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from coopsim.errors import CoopsimError
from coopsim.learn.weights import load_covariance, load_detector, make_network, save_weights
from coopsim.nn.covariance.covariance_net import LEAST_VARIANCE, MOST_VARIANCE

NUMBERS = np.random.default_rng(0).normal(scale=50.0, size=(40, 19))


def excited(**config: Any) -> Any:
    """A network whose last layer does something."""
    net = make_network("covariance", config, seed=3)
    assert net.last is not None
    torch.nn.init.normal_(net.last.weight, std=3.0, generator=torch.Generator().manual_seed(0))
    return net


def test_variances_differ_and_are_within_bounds() -> None:
    found = excited().variances(NUMBERS)
    assert found.shape == (40, 7) and found.std(axis=0).min() > 0
    assert found.min() >= LEAST_VARIANCE * 0.999 and found.max() <= MOST_VARIANCE * 1.001


def test_a_box_has_the_same_bits_among_any_others() -> None:
    net, many = excited(), np.concatenate([NUMBERS] * 4)
    np.testing.assert_array_equal(net.variances(many)[-40:], net.variances(NUMBERS))
    np.testing.assert_array_equal(net.variances(NUMBERS[7:8]), net.variances(NUMBERS)[7:8])


def test_an_untrained_network_says_the_same_of_all_boxes() -> None:
    found = make_network("covariance", {}).variances(NUMBERS)
    np.testing.assert_allclose(found, 0.1, rtol=1e-5)


def test_the_constant_one_has_nothing_that_looks_at_a_box() -> None:
    net = make_network("covariance", {"constant": True})
    assert {name for name, _ in net.named_parameters()} == {"base", "log_growth", "log_speed"}
    np.testing.assert_array_equal(net.variances(NUMBERS)[0], net.variances(NUMBERS * 2)[1])


def test_the_motion_has_the_noise_of_the_filter() -> None:
    net = make_network("covariance", {})
    with torch.no_grad():
        net.log_growth.add_(torch.arange(7) / 7)
    motion, made = net.motion(), net.box_filter()
    np.testing.assert_allclose(motion.process_variance_per_s, made.growth_per_s.detach())
    assert motion.process_velocity_variance_per_s == pytest.approx(made.speed_growth_per_s.item())
    assert motion.initial_velocity_variance == pytest.approx(made.speed_variance.item())
    np.testing.assert_allclose(motion.measurement_variance, 0.1, rtol=1e-5)


@pytest.mark.parametrize(
    ("config", "match"),
    [
        ({"codes": 3}, "codes must be even"),
        ({"codes": 0}, "codes must be an integer"),
        ({"widths": []}, "widths must be 1 to 8 numbers"),
        ({"widths": [8, 0]}, r"widths\[1\]"),
        ({"widths": [10**6]}, r"widths\[0\]"),
        ({"constant": "yes"}, "constant must be"),
        ({"width": [8]}, "Did you mean 'widths'"),
    ],
)
def test_wrong_sizes_are_refused(config: dict[str, Any], match: str) -> None:
    with pytest.raises(CoopsimError, match=match):
        make_network("covariance", config)


def test_files_are_read_again_and_others_refused(tmp_path: Path) -> None:
    net, path = excited(widths=[8]), tmp_path / "mine.safetensors"
    save_weights(path, net, {"kind": "covariance", "config": {"codes": 16, "widths": [8], "constant": False}})
    np.testing.assert_allclose(load_covariance(path).variances(NUMBERS), net.variances(NUMBERS), rtol=0.05)
    with pytest.raises(CoopsimError, match="must be weights of the kind 'detector', is 'covariance'"):
        load_detector(path)
    with pytest.raises(CoopsimError, match="must be weights of the kind 'covariance', is 'detector'"):
        load_covariance("pillars")
