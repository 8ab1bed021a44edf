"""V2VNet: who hears whom."""

from __future__ import annotations

import pytest

torch = pytest.importorskip("torch")
from coopsim.errors import InvalidValueError, UnknownNameError  # noqa: E402
from coopsim.nn.fusion import FusionContext, V2VNet  # noqa: E402

torch.set_num_threads(1)
SIZE = (6, 7)
WHOLE = torch.ones(SIZE, dtype=torch.bool)


def draw(*shape: int, seed: int = 0) -> torch.Tensor:
    return torch.rand(shape, generator=torch.Generator().manual_seed(seed))


def bare(fusion: V2VNet) -> V2VNet:
    """Return a fusion without the noise of its first weights: messages are copies, and the GRU takes half of them."""
    with torch.no_grad():
        for weights in (fusion.hear.weight, fusion.memory.gates.weight):
            weights.zero_()
        for layer in (fusion.send, fusion.memory.candidate):
            layer.weight.copy_((layer.weight > 0.5).float())
        for layer in (fusion.hear, fusion.memory.gates, fusion.memory.candidate):
            layer.bias.zero_()
    return fusion


def fused(fusion: V2VNet, own: torch.Tensor, others: torch.Tensor, mask: torch.Tensor) -> torch.Tensor:
    return fusion(own, WHOLE, others, mask, FusionContext.plain(len(others)))


def test_it_starts_as_half_its_own_and_half_the_mean_of_those_who_see() -> None:
    own, others = draw(4, *SIZE), draw(2, 4, *SIZE, seed=1)
    mask = torch.stack([WHOLE, WHOLE & (torch.arange(7) < 3)])
    out = fused(bare(V2VNet(4)), own, others, mask)
    both = (own + others.mean(0)) / 2
    assert torch.allclose(out[..., :3], both[..., :3], atol=1e-6)
    assert torch.allclose(out[..., 3:], ((own + others[0]) / 2)[..., 3:], atol=1e-6)  # the mean is of one, not of two


def test_no_agent_has_a_message_from_itself() -> None:
    """Where the only other one says nothing, twice as large features of one's own come back twice as large."""
    fusion, own = bare(V2VNet(4)), draw(4, *SIZE)
    silent = torch.zeros(1, 4, *SIZE)
    assert torch.allclose(fused(fusion, own, silent, WHOLE[None]), own / 2, atol=1e-6)
    with torch.no_grad():
        fusion.send.weight.mul_(100.0)
    assert torch.allclose(fused(fusion, own, silent, WHOLE[None]), own / 2, atol=1e-6)


def test_in_a_second_round_others_have_heard_each_other() -> None:
    own, others = torch.zeros(4, *SIZE), torch.zeros(2, 4, *SIZE)
    others[1] = 1.0
    mask = torch.stack([WHOLE, WHOLE & False])
    mask[1, :, :2] = True
    one, two = (fused(bare(V2VNet(4, rounds=rounds)), own, others, mask) for rounds in (1, 2))
    assert torch.allclose(one[..., :2], torch.full((4, 6, 2), 0.25)) and not one[..., 2:].any()
    # After a round the three have .25, .25 (from the third) and .5, so the receiver then (.25 + (.25 + .5) / 2) / 2.
    assert torch.allclose(two[..., :1], torch.full((4, 6, 1), 0.3125))


def test_rounds_follow_the_size_unless_given() -> None:
    assert [V2VNet(4).rounds, V2VNet(4, size="reference").rounds, V2VNet(4, rounds=2).rounds] == [1, 3, 2]
    with pytest.raises(InvalidValueError, match="rounds must be"):
        V2VNet(4, rounds=0)
    with pytest.raises(UnknownNameError, match="unknown size 'medium'"):
        V2VNet(4, size="medium")
