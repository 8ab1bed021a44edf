"""F-Cooper: numbers by hand."""

from __future__ import annotations

import pytest

torch = pytest.importorskip("torch")
from coopsim.nn.fusion import FCooper, FusionContext  # noqa: E402


def test_the_largest_valid_value_of_each_channel() -> None:
    own = torch.tensor([[[1.0]], [[0.0]]])
    others = torch.tensor([[[[0.5]], [[2.0]]], [[[9.0]], [[9.0]]]])
    mask = torch.tensor([[[True]], [[False]]])
    out = FCooper(2)(own, torch.ones(1, 1, dtype=torch.bool), others, mask, FusionContext.plain(2))
    assert out.flatten().tolist() == [1.0, 2.0]
