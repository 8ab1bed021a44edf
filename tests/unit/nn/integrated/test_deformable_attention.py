"""Deformable attention against a slow one, both ways of computing it, and its edges."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

torch = pytest.importorskip("torch")

from coopsim.nn.integrated.encoder import DeformableAttention  # noqa: E402
from coopsim.nn.integrated.integrated_net import box_axes  # noqa: E402
from coopsim.types import BevGrid  # noqa: E402

torch.set_num_threads(1)
WIDTH, HEADS, POINTS = 8, 2, 3


def made() -> DeformableAttention:
    torch.manual_seed(0)
    attention = DeformableAttention(WIDTH, HEADS, POINTS)
    for number, weights in enumerate(attention.parameters()):
        with torch.no_grad():
            weights.add_(0.4 * torch.randn(weights.shape, generator=torch.Generator().manual_seed(number)))
    return attention.requires_grad_(False)


def between(features: Any, row: float, column: float) -> Any:
    """A map (C, H, W) at a place between cells, zero outside."""
    total = np.zeros(len(features))
    low = int(np.floor(row)), int(np.floor(column))
    for i in (low[0], low[0] + 1):
        for j in (low[1], low[1] + 1):
            if 0 <= i < features.shape[1] and 0 <= j < features.shape[2]:
                total += (1 - abs(row - i)) * (1 - abs(column - j)) * features[:, i, j]
    return total


def slow(attention: DeformableAttention, query: Any, place: Any, axes: Any, features: Any, grid: BevGrid) -> Any:
    """The equation, one query, head and place at a time."""
    weights = {name: each.numpy().astype(float) for name, each in attention.state_dict().items()}
    out, depth = np.zeros((len(query), WIDTH)), WIDTH // HEADS
    for q in range(len(query)):
        offsets = (weights["offset.weight"] @ query[q] + weights["offset.bias"]).reshape(HEADS, POINTS, 2)
        logits = (weights["weight.weight"] @ query[q] + weights["weight.bias"]).reshape(HEADS, POINTS)
        heads = []
        for m in range(HEADS):
            share = np.exp(logits[m]) / np.exp(logits[m]).sum()
            read = np.zeros(WIDTH)
            for k in range(POINTS):
                x, y = place[q] + axes[q] @ offsets[m, k]
                row, column = (y - grid.y_m[0]) / grid.cell_m - 0.5, (x - grid.x_m[0]) / grid.cell_m - 0.5
                read += share[k] * between(features, row, column)
            heads.append(weights["value.weight"][m * depth : (m + 1) * depth] @ read)
        out[q] = weights["out.weight"] @ np.concatenate(heads) + weights["out.bias"]
    return out


@pytest.mark.parametrize("shape", [(12, 16), (3, 4)])  # of which the smaller one has fewer cells than places are read
def test_it_is_its_equation(shape: tuple[int, int]) -> None:
    rng = np.random.default_rng(0)
    grid = BevGrid((-3.0, -3.0 + 1.5 * shape[1]), (2.0, 2.0 + 1.5 * shape[0]), 1.5)
    query, features = rng.normal(size=(9, WIDTH)), rng.normal(size=(WIDTH, *shape))
    place = rng.uniform([-4, 0], [22, 22], (9, 2))  # some outside
    box = np.column_stack([place, np.zeros(9), rng.uniform(1, 9, (9, 3)), rng.uniform(-3, 3, 9)])
    axes = box_axes(torch.from_numpy(box))
    given = [torch.from_numpy(each).float() for each in (query, place)]
    found = made()(*given, axes.float(), torch.from_numpy(features).float(), grid)
    expected = slow(made(), query, place, axes.numpy(), features, grid)
    np.testing.assert_allclose(found.numpy(), expected, atol=1e-4)


def test_axes_are_half_a_box_along_and_across() -> None:
    box = torch.tensor([[5.0, 5.0, 0.0, 4.0, 2.0, 1.0, torch.pi / 2], [0.0, 0.0, 0.0, 0.6, 0.4, 1.0, 0.0]])
    expected = torch.tensor([[[0.0, -1.0], [2.0, 0.0]], [[0.6, 0.0], [0.0, 0.6]]])
    assert torch.allclose(box_axes(box), expected, atol=1e-6)


def test_a_fresh_one_looks_around_its_place_and_nobody_asks_nothing() -> None:
    grid = BevGrid((-8.0, 8.0), (-8.0, 8.0), 1.0)
    features, axes = torch.zeros(WIDTH, 16, 16), torch.eye(2)[None]
    features[:, 8:10, 8:10] = 1.0
    fresh = DeformableAttention(WIDTH, HEADS, POINTS).requires_grad_(False)
    near, far = fresh(torch.zeros(2, WIDTH), torch.tensor([[1.0, 1.0], [-6.0, -6.0]]), axes, features, grid)
    assert torch.allclose(far, fresh.out.bias) and not torch.allclose(near, far)
    assert fresh(torch.zeros(0, WIDTH), torch.zeros(0, 2), torch.zeros(0, 2, 2), features, grid).shape == (0, WIDTH)
