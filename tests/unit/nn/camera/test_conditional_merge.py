"""Conditional convolutions, and a merge that begins as the canvas of points."""

from __future__ import annotations

import torch
from tiny_pictures import shake
from torch.nn import functional

from coopsim.nn.camera.points_and_pictures import CONFIDENCES, ConditionalConv, ConditionalMerge

DRAWS = torch.Generator().manual_seed(0)
POINTS, PICTURES = (torch.randn(2, 3, 8, 8, generator=DRAWS) for _ in range(2))
SURE = torch.rand(2, CONFIDENCES, generator=DRAWS)


def test_kernels_are_mixtures_of_experts() -> None:
    """Equation 1 of CondConv: mixing kernels is mixing what each of them gives."""
    conv = ConditionalConv(3, 5, 4)
    shake(conv)
    weights = torch.sigmoid(SURE @ conv.route.weight.T + conv.route.bias)
    each = [functional.conv2d(POINTS, conv.kernels[e][..., None, None], conv.biases[e]) for e in range(4)]
    wanted = sum(weights[:, e, None, None, None] * each[e] for e in range(4))
    torch.testing.assert_close(conv(POINTS, SURE), wanted, atol=1e-5, rtol=1e-5)
    assert not torch.allclose(conv(POINTS, SURE), conv(POINTS, SURE.flip(0)))


def test_kernels_begin_as_those_of_an_ordinary_convolution() -> None:
    """Uniform up to one over the root of the channels in, as torch's layers are."""
    largest = ConditionalConv(16, 500, 4).kernels.detach().abs().amax()
    assert 0.99 * 16**-0.5 < largest <= 16**-0.5


def test_a_fresh_merge_is_the_canvas_of_points_and_can_learn() -> None:
    merge = ConditionalMerge(3, experts=2)
    merged = merge(POINTS, PICTURES, SURE)
    assert torch.equal(merged, POINTS)
    merged.square().sum().backward()
    assert merge.second.kernels.grad is not None and merge.second.kernels.grad.any()


def test_where_no_picture_laid_anything_points_stay_as_they_are() -> None:
    merge, pictures = ConditionalMerge(3, experts=2), PICTURES.clone()
    shake(merge)
    pictures[:, :, :3] = 0.0
    merged = merge(POINTS, pictures, SURE)
    assert torch.equal(merged[:, :, :3], POINTS[:, :, :3])
    assert (merged[:, :, 3:] != POINTS[:, :, 3:]).any(1).all()
