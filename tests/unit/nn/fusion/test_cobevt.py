"""CoBEVT: a mean of who is there, and attention that reaches across the map."""

from __future__ import annotations

import pytest

torch = pytest.importorskip("torch")
from coopsim.errors import UnknownNameError  # noqa: E402
from coopsim.nn.fusion import AttFuse, CoBEVT, FusionContext  # noqa: E402

torch.set_num_threads(1)
SIZE = (24, 32)


def draw(*shape: int, seed: int = 0) -> torch.Tensor:
    return torch.rand(shape, generator=torch.Generator().manual_seed(seed))


def trained() -> CoBEVT:
    fusion = CoBEVT(8)
    with torch.no_grad():
        for number, weights in enumerate(fusion.parameters()):
            weights.copy_(0.3 * torch.randn(weights.shape, generator=torch.Generator().manual_seed(number)))
    return fusion


def fused(fusion: CoBEVT, own: torch.Tensor, others: torch.Tensor) -> torch.Tensor:
    whole = torch.ones(len(others), *SIZE, dtype=torch.bool)
    with torch.no_grad():
        out: torch.Tensor = fusion(own, whole[0], others, whole, FusionContext.plain(len(others)))
    return out


def test_it_starts_as_attfuse() -> None:
    own, others = draw(8, *SIZE), draw(3, 8, *SIZE, seed=1)
    assert torch.allclose(fused(CoBEVT(8), own, others), fused(AttFuse(8), own, others), atol=1e-6)  # type: ignore[arg-type]


def test_the_same_map_twice_is_as_once() -> None:
    """A mean over rows that pad the number of agents would be another one."""
    fusion, own, others = trained(), draw(8, *SIZE), draw(1, 8, *SIZE, seed=1)
    with torch.no_grad():  # to attend to one's own tokens is to attend to another's
        for block in fusion.blocks:
            block.attention.bias[1] = block.attention.bias[0]
    same = own[None].expand(3, -1, -1, -1)
    assert torch.allclose(fused(fusion, own, same[:1]), fused(fusion, own, same), atol=1e-3)
    assert not torch.allclose(fused(fusion, own, others), fused(fusion, own, same), atol=1e-2)


def test_what_is_far_away_is_seen_by_the_second_attention_alone() -> None:
    fusion, own = trained(), torch.zeros(8, *SIZE)
    others = torch.zeros(1, 8, *SIZE)
    others[:, :, 1, 1] = 5.0
    change = (fused(fusion, own, others) - fused(fusion, own, torch.zeros_like(others))).abs().sum(0)
    quarter = (SIZE[0] // 4 // 2 * 2, SIZE[1] // 4)  # of 12 x 16 tokens: every third row, every fourth column
    assert change[0 + quarter[0] : 2 + quarter[0], 0:2].any() and change[0:2, quarter[1] : 2 + quarter[1]].any()
    with torch.no_grad():
        for block in fusion.blocks[1::2]:
            block.attention.out.weight.zero_()
    change = (fused(fusion, own, others) - fused(fusion, own, torch.zeros_like(others))).abs().sum(0)
    assert change[:8, :8].all() and not change[8:].any() and not change[:, 8:].any()


def test_the_reference_has_a_token_a_cell() -> None:
    reference = CoBEVT(8, size="reference")
    assert len(reference.blocks) == 6 and reference.norm.normalized_shape == (256,)
    tokens, _ = reference.patches.tokens(draw(8, 4, 4), torch.ones(4, 4) > 0, draw(1, 8, 4, 4), torch.ones(1, 4, 4) > 0)
    assert tokens.shape == (2, 4, 4, 256)
    with pytest.raises(UnknownNameError, match="unknown size"):
        CoBEVT(8, size="large")
