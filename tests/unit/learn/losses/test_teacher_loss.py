"""The teacher's loss: what lowers it, and which cells count."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest
import torch

from coopsim.errors import InvalidValueError
from coopsim.learn.losses.fused_losses import require_fitting, teacher_loss
from coopsim.nn.detector.encoder import EncoderConfig

torch.set_num_threads(1)


def draw(seed: int) -> torch.Tensor:
    return torch.randn((1, 6, 4, 5), generator=torch.Generator().manual_seed(seed))


def loss(known: torch.Tensor, fused: torch.Tensor) -> torch.Tensor:
    teacher: Any = SimpleNamespace(encoder=lambda merged: known)
    return teacher_loss(teacher, None, fused)  # type: ignore[arg-type]


def test_it_is_the_mean_divergence_of_the_cells() -> None:
    known, fused = draw(0), draw(1)
    total = 0.0
    for row in range(4):
        for column in range(5):
            t, s = known[0, :, row, column].softmax(0), fused[0, :, row, column].softmax(0)
            total += float((t * (t / s).log()).sum())
    assert loss(known, fused).item() == pytest.approx(total / 20, rel=1e-5)
    assert loss(known, known + 3.0).item() == pytest.approx(0.0, abs=1e-6)


def test_cells_that_nobody_reports_are_left_out() -> None:
    known, fused = draw(0), draw(1)
    fused[..., 2:] = 0.0
    assert torch.allclose(loss(known, fused), loss(known[..., :2], fused[..., :2]))
    assert loss(known, torch.zeros_like(fused)).item() == 0.0


def test_gradients_reach_the_fused_map_alone() -> None:
    known, fused = draw(0).requires_grad_(), draw(1).requires_grad_()
    loss(known, fused).backward()
    assert known.grad is None and fused.grad is not None and fused.grad.isfinite().all() and fused.grad.any()


@pytest.mark.parametrize(("name", "value"), [("features", 32), ("cell_m", 0.4), ("sweeps", 2)])
def test_a_teacher_must_fit(name: str, value: float) -> None:
    teacher, detector = (SimpleNamespace(config=EncoderConfig(**given)) for given in ({name: value}, {}))  # type: ignore[arg-type]
    with pytest.raises(InvalidValueError, match=f"teacher must have the detector's {name}"):
        require_fitting(teacher, detector)  # type: ignore[arg-type]
