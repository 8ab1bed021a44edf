"""Where2comm's fusion: what confidences do."""

from __future__ import annotations

import pytest

torch = pytest.importorskip("torch")
from coopsim.errors import InvalidValueError  # noqa: E402
from coopsim.nn.fusion import FusionContext, Where2comm  # noqa: E402

ONE = torch.ones(1, 1, dtype=torch.bool)


def fused(fusion: Where2comm, *confidence: float, known: bool = True) -> float:
    """Return the fusion of an own 0 and two others' 1 and 2 in one cell of one channel."""
    sure = torch.tensor(confidence)[:, None, None] if known else None
    own_sure = torch.zeros(1, 1) if known else None
    context = FusionContext(torch.zeros(2), torch.zeros(2), sure, own_sure)
    others = torch.tensor([1.0, 2.0])[:, None, None, None]
    return fusion(torch.zeros(1, 1, 1), ONE, others, ONE.expand(2, 1, 1), context).item()


@pytest.fixture
def fusion() -> Where2comm:
    """A fusion that knows nothing but confidences."""
    fusion = Where2comm(1)
    torch.nn.init.zeros_(fusion.key.weight)
    return fusion


def test_the_sure_agent_counts_more(fusion: Where2comm) -> None:
    assert fused(fusion, 0.0, 1.0) > fused(fusion, 0.5, 0.5) > fused(fusion, 1.0, 0.0)


def test_equal_confidences_are_as_none(fusion: Where2comm) -> None:
    assert fused(fusion, 0.0, 0.0) == pytest.approx(1.0) == fused(fusion, 0.0, 0.0, known=False)


def test_weights_follow_the_equation(fusion: Where2comm) -> None:
    beta = torch.nn.functional.softplus(fusion.trust).item()
    weights = torch.tensor([0.0, beta * 0.3, beta * 0.9]).softmax(0)
    assert fused(fusion, 0.3, 0.9) == pytest.approx(float(weights[1] + 2 * weights[2]), rel=1e-6)


def test_counts_are_checked() -> None:
    with pytest.raises(InvalidValueError, match="depth must be"):
        Where2comm(64, depth=0)
