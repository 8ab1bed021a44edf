"""The pyramid: its scales, and what beliefs do."""

from __future__ import annotations

import pytest

torch = pytest.importorskip("torch")
from coopsim.nn.fusion import FusionContext, Pyramid  # noqa: E402

torch.set_num_threads(1)
SIZE = (7, 13)


def draw(*shape: int, seed: int = 0) -> torch.Tensor:
    return torch.rand(shape, generator=torch.Generator().manual_seed(seed))


def inputs() -> tuple[torch.Tensor, torch.Tensor, torch.Tensor, torch.Tensor, FusionContext]:
    whole = torch.ones(SIZE, dtype=torch.bool)
    return draw(8, *SIZE), whole, draw(2, 8, *SIZE, seed=1), draw(2, *SIZE, seed=2) < 0.7, FusionContext.plain(2)


@pytest.mark.parametrize("levels", [1, 2, 3, 4])
def test_beliefs_of_all_agents_at_all_scales(levels: int) -> None:
    found = Pyramid(8, levels=levels).foreground(*inputs())
    assert [each.stride for each in found] == [1, 2, 4, 8][:levels]
    for each in found:
        size = (-(-SIZE[0] // each.stride), -(-SIZE[1] // each.stride))
        assert each.logits.shape == each.valid.shape == (3, *size)


def test_coarse_cells_are_valid_where_any_fine_one_is() -> None:
    own, own_mask, others, mask, context = inputs()
    mask[:] = False
    mask[0, 2, 12] = True
    found = Pyramid(8).foreground(own, own_mask, others, mask, context)
    assert [torch.nonzero(each.valid[1]).tolist() for each in found] == [[[2, 12]], [[1, 6]], [[0, 3]]]


def test_it_starts_as_a_mean_weighted_by_belief() -> None:
    fusion = Pyramid(8)
    own, own_mask, others, mask, context = inputs()
    logits = fusion.foreground(own, own_mask, others, mask, context)[0].logits
    valid = torch.cat([own_mask[None], mask])
    weights = ((4 * logits.sigmoid()).exp() * valid)[:, None]
    expected = (torch.cat([own[None], others]) * weights).sum(0) / weights.sum(0)
    assert torch.allclose(fusion(own, own_mask, others, mask, context), expected, atol=1e-5)


def test_who_believes_counts_more() -> None:
    fusion = Pyramid(1, levels=1)
    with torch.no_grad():
        fusion.believe[0].weight.fill_(10.0)
        fusion.believe[0].bias.fill_(-5.0)
    one = torch.ones(1, 1, dtype=torch.bool)
    fused = fusion(torch.ones(1, 1, 1), one, torch.zeros(3, 1, 1, 1), one.expand(3, 1, 1), FusionContext.plain(3))
    assert fused.item() > 0.9


def test_objects_are_found_at_coarse_scales_once_learned() -> None:
    fusion = Pyramid(8)
    before = fusion(*inputs())
    with torch.no_grad():
        fusion.up[0].weight.copy_(draw(*fusion.up[0].weight.shape))
    assert (fusion(*inputs()) - before).abs().max() > 0.1
