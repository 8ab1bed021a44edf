"""GSAF: its equations, written out on one window."""

from __future__ import annotations

import pytest

torch = pytest.importorskip("torch")
from coopsim.errors import UnknownNameError  # noqa: E402
from coopsim.nn.fusion import GSAF, AttFuse, FusionContext  # noqa: E402

torch.set_num_threads(1)
SIZE = (16, 16)


def draw(*shape: int, seed: int = 0) -> torch.Tensor:
    return torch.rand(shape, generator=torch.Generator().manual_seed(seed))


def trained() -> GSAF:
    fusion = GSAF(8)
    with torch.no_grad():
        for number, weights in enumerate(fusion.parameters()):
            weights.copy_(0.3 * torch.randn(weights.shape, generator=torch.Generator().manual_seed(number)))
    return fusion


def inputs() -> tuple[torch.Tensor, ...]:
    whole = torch.ones(2, *SIZE, dtype=torch.bool)
    return draw(8, *SIZE), whole[0], draw(2, 8, *SIZE, seed=1), whole


def test_it_starts_as_attfuse() -> None:
    context = FusionContext.plain(2)
    assert torch.allclose(GSAF(8)(*inputs(), context), AttFuse(8)(*inputs(), context), atol=1e-6)


def test_equations_one_to_four() -> None:
    fusion, (own, own_mask, others, mask) = trained(), inputs()
    with torch.no_grad():
        out = fusion(own, own_mask, others, mask, FusionContext.plain(2))
        maps = torch.cat([own[None], others])
        tokens = fusion.patches.cut(maps).permute(0, 2, 3, 1)
        normed, valid = fusion.norm(tokens), torch.ones(3, 8, 8, dtype=torch.bool)
        found = [torch.cat([branch(normed[k : k + 1], valid[:1]) for k in range(3)]) for branch in fusion.branches]
        features = tokens + fusion.join(torch.cat(found, -1))  # F', of each agent by itself
        pairs = features @ fusion.compare.sender.weight.T + fusion.compare.receiver(features[0])
        logits = fusion.compare.rest(pairs).view(3, 8, 8, 2, 2).transpose(2, 3).reshape(3, *SIZE)
        weights = ((maps * own).sum(1) / 8**0.5 + logits).softmax(0)  # b
        share = weights.view(3, 8, 2, 8, 2).mean((2, 4))[..., None]
        mean = (features * share).sum(0)  # F~
        last = fusion.last_norm(mean + fusion.refine(mean))
        added = fusion.patches.add(last).view(8, 8, 2, 2, 8).transpose(1, 2).reshape(*SIZE, 8).permute(2, 0, 1)
        expected = (maps * weights[:, None]).sum(0) + added
    assert torch.allclose(out, expected, atol=1e-4)


def test_the_reference_has_windows_of_three_sizes() -> None:
    assert len(GSAF(8, size="reference").branches) == 3
    with pytest.raises(UnknownNameError, match="unknown size"):
        GSAF(8, size="paper")


@pytest.mark.parametrize(("size", "windows"), [("small", (4, 8)), ("reference", (4, 8, 16))])
def test_a_token_attends_to_its_window(size: str, windows: tuple[int, ...]) -> None:
    fusion = GSAF(8, size=size)
    for branch, window in zip(fusion.branches, windows, strict=True):
        tokens = draw(1, 16, 16, *fusion.norm.normalized_shape).requires_grad_()
        branch(tokens, torch.ones(1, 16, 16, dtype=torch.bool))[0, 0, 0].square().sum().backward()
        reached = tokens.grad[0].abs().sum(-1) > 0
        assert reached[:window, :window].all() and reached.sum() == window**2
