"""The parts of a cooperative network's loss, by hand."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

torch = pytest.importorskip("torch")

from coopsim.learn.losses.fused_losses import copy_loss, surest  # noqa: E402


@pytest.mark.parametrize("kept", [0.0, 0.5, 1.0])
@pytest.mark.parametrize("scale", [0.1, 1.0, 30.0])
def test_the_loss_of_a_copy_is_the_share_of_energy_that_is_lost(kept: float, scale: float) -> None:
    features = scale * torch.randn(2, 3, 4, 5, generator=torch.Generator().manual_seed(0))
    net: Any = SimpleNamespace(expand=lambda values, delay_s: kept * values)
    assert copy_loss(net, features, features).item() == pytest.approx((1 - kept) ** 2, abs=1e-6)


def test_maps_without_energy_lose_nothing() -> None:
    net: Any = SimpleNamespace(expand=lambda values, delay_s: values)
    assert copy_loss(net, torch.zeros(1, 2, 3, 3), torch.zeros(1, 2, 3, 3)).item() == 0.0


def test_the_surest_cells_of_each_map_are_sent() -> None:
    sure = torch.tensor([[[0.1, 0.9], [0.8, 0.2]], [[0.5, 0.4], [0.3, 0.6]]])
    assert surest(sure, 2).tolist() == [[[False, True], [True, False]], [[True, False], [False, True]]]
    assert surest(sure, 9).all()
