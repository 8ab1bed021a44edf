"""V2X-ViT: delays and kinds count, and one agent's windows do not see another's."""

from __future__ import annotations

import pytest

torch = pytest.importorskip("torch")
from coopsim.errors import UnknownNameError  # noqa: E402
from coopsim.nn.fusion import AttFuse, FusionContext, V2XViT  # noqa: E402
from coopsim.nn.fusion.v2x_vit import SplitWindows  # noqa: E402

torch.set_num_threads(1)
SIZE = (16, 32)


def draw(*shape: int, seed: int = 0) -> torch.Tensor:
    return torch.rand(shape, generator=torch.Generator().manual_seed(seed))


@pytest.fixture
def fusion() -> V2XViT:
    fusion = V2XViT(8)
    with torch.no_grad():
        for number, weights in enumerate(fusion.parameters()):
            weights.copy_(0.3 * torch.randn(weights.shape, generator=torch.Generator().manual_seed(number)))
    return fusion


def fused(fusion: torch.nn.Module, delay_s: float = 0.0, kind: int = 0, own_kind: int = 0) -> torch.Tensor:
    whole = torch.ones(2, *SIZE, dtype=torch.bool)
    context = FusionContext(torch.tensor([delay_s, 0.0]), torch.tensor([kind, 0]), own_kind=own_kind)
    with torch.no_grad():
        out: torch.Tensor = fusion(draw(8, *SIZE), whole[0], draw(2, 8, *SIZE, seed=1), whole, context)
    return out


def test_it_starts_as_attfuse() -> None:
    assert torch.allclose(fused(V2XViT(8), 0.3, 1), fused(AttFuse(8)), atol=1e-6)


def test_delays_are_real_numbers_that_count(fusion: V2XViT) -> None:
    at_once, soon, later = fused(fusion), fused(fusion, 0.1), fused(fusion, 0.14)
    assert (soon - at_once).abs().mean() > 0.01 and (later - soon).abs().mean() > 0.003
    assert torch.allclose(fused(fusion, 0.1 + 1e-6), soon, atol=1e-3)


def test_kinds_count(fusion: V2XViT) -> None:
    car, mast, of_mast = fused(fusion), fused(fusion, kind=1), fused(fusion, own_kind=1)
    assert (car - mast).abs().mean() > 0.01 and (car - of_mast).abs().mean() > 0.01


def test_windows_are_weighted_by_what_is_valid_alone() -> None:
    windows = SplitWindows(8, (2, 2), (4, 8))
    tokens, valid = draw(2, 8, 16, 8), torch.ones(2, 8, 16, dtype=torch.bool)
    valid[:, :, 8:] = False
    before = windows(tokens, valid)
    tokens[:, :, 8:] = 100.0
    assert torch.allclose(windows(tokens, valid)[:, :, :8], before[:, :, :8], atol=1e-5)
    assert torch.allclose(windows(tokens[:1], valid[:1]), windows(tokens, valid)[:1], atol=1e-5)  # each by itself


def test_the_reference_is_the_papers() -> None:
    reference = V2XViT(8, size="reference")
    assert len(reference.blocks) == 3 and len(reference.blocks[0].windows.branches) == 3
    with pytest.raises(UnknownNameError, match="unknown size"):
        V2XViT(8, size="paper")
