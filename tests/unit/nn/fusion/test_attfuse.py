"""AttFuse: numbers by hand."""

from __future__ import annotations

import math

import pytest

torch = pytest.importorskip("torch")
from coopsim.nn.fusion import AttFuse, FusionContext  # noqa: E402

ONE = torch.ones(1, 1, dtype=torch.bool)


def test_attention_by_the_equation() -> None:
    """Scalar products 4 and 2, divided by sqrt(4): weights e^2 and e^1."""
    own = torch.tensor([2.0, 0.0, 0.0, 0.0])[:, None, None]
    other = torch.tensor([1.0, 3.0, 0.0, 0.0])[None, :, None, None]
    out = AttFuse(4)(own, ONE, other, ONE[None], FusionContext.plain(1)).flatten()
    share = math.exp(1) / (math.exp(2) + math.exp(1))
    assert out.tolist() == pytest.approx([2 * (1 - share) + share, 3 * share, 0.0, 0.0])


def test_where_the_receiver_sees_nothing_senders_share_equally() -> None:
    others = torch.tensor([1.0, 3.0])[:, None, None, None]
    out = AttFuse(1)(torch.zeros(1, 1, 1), ~ONE, others, torch.ones(2, 1, 1, dtype=torch.bool), FusionContext.plain(2))
    assert out.item() == pytest.approx(2.0)
