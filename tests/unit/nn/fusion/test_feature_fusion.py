"""The laws of every registered fusion."""

from __future__ import annotations

import pytest

torch = pytest.importorskip("torch")
from coopsim.errors import InvalidValueError  # noqa: E402
from coopsim.nn.cooperative.warp import warp  # noqa: E402
from coopsim.nn.fusion import FUSIONS, FeatureFusion, FusionContext  # noqa: E402
from coopsim.nn.fusion.feature_fusion import masked_softmax  # noqa: E402
from coopsim.types import BevGrid  # noqa: E402

torch.set_num_threads(1)
CHANNELS = 16
SIZES = [(8, 8), (7, 13), (1, 1), (5, 2)]
each_fusion = pytest.mark.parametrize("name", FUSIONS.names())
WINDOWS = {"cobevt", "gsaf", "v2x_vit"}
"""Fusions with windows, which begin where the map does: what moves by a part of a window has not quite the same
neighbours."""


def trained(name: str) -> FeatureFusion:
    """Return a fusion whose weights are all random, also those that start as zeros."""
    fusion = FUSIONS.get(name)(CHANNELS)
    source = torch.Generator().manual_seed(5)
    with torch.no_grad():
        for weights in fusion.parameters():
            weights.copy_(torch.randn(weights.shape, generator=source) * 0.3)
    return fusion


class Case:
    """Random maps of S senders and the receiver, with random validity."""

    def __init__(self, senders: int, size: tuple[int, int] = (7, 13), seed: int = 0) -> None:
        source = torch.Generator().manual_seed(seed)

        def draw(*shape: int) -> torch.Tensor:
            return torch.rand(shape, generator=source)

        self.own_mask = draw(*size) < 0.7
        self.own = (draw(CHANNELS, *size) - 0.5).relu() * self.own_mask
        self.others = (draw(senders, CHANNELS, *size) - 0.5).relu()
        self.mask = draw(senders, *size) < 0.6
        self.delay_s = draw(senders)
        self.kind = torch.arange(senders) % 3
        self.confidence, self.own_confidence = draw(senders, *size), draw(*size)

    def context(self, order: torch.Tensor | slice = slice(None)) -> FusionContext:
        return FusionContext(self.delay_s[order], self.kind[order], self.confidence[order], self.own_confidence)

    def fused(self, fusion: FeatureFusion, order: torch.Tensor | slice = slice(None)) -> torch.Tensor:
        return fusion(self.own, self.own_mask, self.others[order], self.mask[order], self.context(order))


@each_fusion
@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("senders", [1, 2, 5])
def test_any_size_and_number(name: str, size: tuple[int, int], senders: int) -> None:
    out = Case(senders, size).fused(trained(name))
    assert out.shape == (CHANNELS, *size) and out.isfinite().all()


@each_fusion
def test_one_agent_alone_has_its_own_map(name: str) -> None:
    case = Case(0)
    assert case.fused(trained(name)) is case.own


@each_fusion
def test_cells_that_nobody_else_reports_are_the_own_map(name: str) -> None:
    case = Case(3)
    out = case.fused(trained(name))
    alone = ~case.mask.any(0)
    assert torch.equal(out[:, alone], case.own[:, alone])
    assert (alone & ~case.own_mask).any() and not out[:, alone & ~case.own_mask].any()


@each_fusion
def test_senders_have_an_effect_where_they_are_valid(name: str) -> None:
    case = Case(3)
    changed = (case.fused(trained(name)) != case.own).any(0)
    assert changed[case.mask.any(0)].float().mean() > 0.95


@each_fusion
def test_order_does_not_matter(name: str) -> None:
    case, fusion = Case(4), trained(name)
    assert torch.allclose(case.fused(fusion), case.fused(fusion, torch.tensor([2, 0, 3, 1])), atol=1e-5)


@each_fusion
def test_masked_senders_change_nothing(name: str) -> None:
    case, fusion = Case(4), trained(name)
    before = case.fused(fusion, slice(3))
    case.mask[3] = False
    case.others[3] = 1e6
    assert torch.allclose(case.fused(fusion), before, atol=1e-6)


@each_fusion
def test_masked_cells_have_no_effect(name: str) -> None:
    case, fusion = Case(3), trained(name)
    before = case.fused(fusion)
    case.others = torch.where(case.mask[:, None], case.others, 1e6)
    assert torch.allclose(case.fused(fusion), before, atol=1e-6)


@each_fusion
def test_no_channels_are_refused(name: str) -> None:
    with pytest.raises(InvalidValueError, match="features must be"):
        FUSIONS.get(name)(0)


@each_fusion
def test_all_may_be_masked(name: str) -> None:
    case = Case(2)
    case.mask[:] = False
    case.own_mask[:] = False
    case.own = torch.zeros_like(case.own).requires_grad_()
    case.others.requires_grad_()
    out = case.fused(trained(name))
    assert not out.any()
    out.sum().backward()
    assert case.own.grad is None or case.own.grad.isfinite().all()
    assert case.others.grad is None or not case.others.grad.any()


@each_fusion
def test_gradients_reach_valid_cells_of_every_sender_and_no_others(name: str) -> None:
    case, fusion = Case(4), trained(name)
    case.mask[3] = False
    case.own.requires_grad_()
    case.others.requires_grad_()
    out = case.fused(fusion)
    (out * torch.randn(out.shape, generator=torch.Generator().manual_seed(2))).sum().backward()
    assert case.own.grad is not None and case.others.grad is not None
    assert case.own.grad.isfinite().all() and case.own.grad.any()
    assert case.others.grad.isfinite().all()
    touched = case.others.grad.abs().sum(1) > 0
    assert touched[:3].flatten(1).any(1).all()
    assert not (touched & ~case.mask).any()
    for weights in fusion.parameters():
        assert weights.grad is not None and weights.grad.isfinite().all()


@each_fusion
def test_low_precision_is_near(name: str) -> None:
    case, fusion = Case(3), trained(name)
    exact = case.fused(fusion)
    case.own, case.others = case.own.bfloat16(), case.others.bfloat16()
    with torch.autocast("cpu", torch.bfloat16):
        assert (case.fused(fusion).float() - exact).abs().max() < 0.05 * exact.abs().max()


@each_fusion
def test_shifting_a_pose_moves_its_contribution(name: str) -> None:
    """The receiver sees nothing; a sender's object moves by as many cells as the pose."""
    grid = BevGrid((-24.0, 24.0), (-24.0, 24.0), 1.2)
    empty, unseen = torch.zeros(CHANNELS, *grid.shape), torch.zeros(grid.shape, dtype=torch.bool)
    image = torch.zeros(1, CHANNELS, *grid.shape)
    image[0, :, 16:20, 20:24] = 1.0
    fusion = trained(name)

    def at(x_cells: int, y_cells: int, image: torch.Tensor = image) -> torch.Tensor:
        maps, valid = warp(image, grid, grid, [(-1.2 * x_cells, -1.2 * y_cells, 0.0)])
        context = FusionContext(torch.zeros(1), torch.zeros(1), maps[:, 0], torch.zeros(grid.shape))
        return fusion(empty, unseen, maps, valid, context)

    here, there = at(0, 0), at(4, -8)
    assert here[:, 16:20, 20:24].any()
    if name not in WINDOWS:
        assert torch.allclose(there[:, 4:20, 16:32], here[:, 12:28, 12:28], atol=1e-5)
        return
    effect = (there - at(4, -8, torch.zeros_like(image))).abs().sum(0)
    assert effect[8:12, 24:28].sum() > 0.5 * effect.sum()


def test_softmax_without_anyone_is_zero() -> None:
    logits = torch.tensor([[[3.0, 1.0, -5.0]], [[4.0, 2.0, 100.0]]], requires_grad=True)
    mask = torch.tensor([[[True, False, True]], [[True, False, False]]])
    weights = masked_softmax(logits, mask)
    assert torch.allclose(weights.sum(0), torch.tensor([[1.0, 0.0, 1.0]]))
    assert weights[0, 0, 2] == 1.0
    weights[0].sum().backward()
    assert logits.grad is not None and logits.grad.isfinite().all()
