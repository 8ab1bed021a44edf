"""DiscoNet: weights by hand."""

from __future__ import annotations

import pytest

torch = pytest.importorskip("torch")
from coopsim.errors import UnknownNameError  # noqa: E402
from coopsim.nn.fusion import DiscoNet, FusionContext  # noqa: E402

ONE = torch.ones(1, 1, dtype=torch.bool)


def test_weights_are_the_softmax_of_a_network_on_pairs() -> None:
    fusion = DiscoNet(3)
    source = torch.Generator().manual_seed(0)
    maps = torch.rand(3, 3, generator=source)
    fused = fusion(maps[0, :, None, None], ONE, maps[1:, :, None, None], ONE.expand(2, 1, 1), FusionContext.plain(2))
    compare = fusion.compare
    first = torch.cat([compare.sender.weight, compare.receiver.weight], 1)
    pairs = torch.cat([maps, maps[:1].expand(3, 3)], 1)  # [x_j ; x_0]
    logits = compare.rest(pairs @ first.T + compare.receiver.bias)[:, 0]
    assert torch.allclose(fused.flatten(), logits.softmax(0) @ maps, atol=1e-6)


def test_an_agent_can_count_for_nearly_nothing() -> None:
    """With a ReLU before the softmax, as in the published code, it could not."""
    fusion = DiscoNet(1)
    with torch.no_grad():
        for layer in (fusion.compare.sender, fusion.compare.receiver, *fusion.compare.rest):
            for weights in layer.parameters():
                weights.zero_()
        fusion.compare.sender.weight[0] = -1.0
        fusion.compare.receiver.bias[0] = 1.0
        fusion.compare.rest[1].weight[0, 0] = 1.0
        fusion.compare.rest[3].weight[0, 0] = 20.0
        fusion.compare.rest[3].bias[0] = -20.0
    fused = fusion(torch.ones(1, 1, 1), ONE, torch.zeros(1, 1, 1, 1), ONE[None], FusionContext.plain(1))
    assert 0 < fused.item() < 1e-6  # logits -20 of a 1, and 0 of a 0


def test_sizes_are_named() -> None:
    assert sum(p.numel() for p in DiscoNet(8, size="reference").parameters()) > 2 * 8 * 128
    with pytest.raises(UnknownNameError, match="unknown size 'huge'"):
        DiscoNet(8, size="huge")
