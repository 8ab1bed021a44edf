"""Convolutions of cells in use: those of whole maps, and their gradients."""

from __future__ import annotations

import pytest
import torch
from torch import Tensor
from torch.nn import functional

from coopsim.nn.detector.sparse_cells import SparseCells, SparseConv, coarser, filled, finer, grown, parents, wholes

torch.set_num_threads(1)


def some_cells(share: float, seed: int = 0) -> SparseCells:
    return SparseCells.of(torch.rand(2, 8, 12, generator=torch.Generator().manual_seed(seed)) < share)


def convolved(layer: SparseConv, maps: Tensor) -> Tensor:
    """Return the layer on whole maps, by torch."""
    before = layer.weight.shape[0] // 9
    weight = layer.weight.view(3, 3, before, -1).permute(3, 2, 0, 1)
    return functional.relu(functional.batch_norm(
        functional.conv2d(maps, weight, padding=1),
        *(getattr(layer.norm, name) for name in ("running_mean", "running_var", "weight", "bias")),
        eps=layer.norm.eps,
    ))  # fmt: skip


@pytest.mark.parametrize("share", [0.0, 0.2, 1.0])
def test_cells_in_use_have_the_features_of_a_convolution(share: float) -> None:
    cells, layer = some_cells(share), SparseConv(5, 7).eval()
    features = torch.randn(len(cells), 5)
    table = cells.neighbors()
    with torch.no_grad():
        whole = convolved(layer, cells.dense(features))
        found = layer(features, table, table.flip(1))
        torch.testing.assert_close(cells.dense(found), whole * cells.used()[:, None], atol=1e-5, rtol=1e-5)
        layer.fold()
        torch.testing.assert_close(layer(features, table, table.flip(1)), found, atol=1e-5, rtol=1e-5)


def test_gradients_are_those_of_a_convolution() -> None:
    cells, layer = some_cells(0.4), SparseConv(3, 4).eval()
    table = cells.neighbors()
    features = torch.randn(len(cells), 3)
    found = []
    for dense in (False, True):
        given = features.clone().requires_grad_()
        layer.zero_grad()
        if dense:
            out = convolved(layer, cells.dense(given)).permute(0, 2, 3, 1).flatten(0, 2)[cells.cell]
        else:
            out = layer(given, table, table.flip(1))
        (out**2).sum().backward()
        found.append((given.grad, layer.weight.grad))
    for one, other in zip(*found, strict=True):
        torch.testing.assert_close(one, other, atol=1e-4, rtol=1e-4)


def test_parts_and_wholes_know_each_other() -> None:
    fine = some_cells(0.3)
    coarse = SparseCells.of(grown(coarser(fine.used())))
    table, back = parents(fine, coarse)
    rows, place = torch.nonzero(table < len(fine), as_tuple=True)
    assert len(rows) == len(fine)
    assert (back[table[rows, place], place] == rows).all()
    assert (wholes(fine, coarse)[table[rows, place]] == rows).all()
    assert ((back < len(coarse)).sum(1) == 1).all()


def test_flags_grow_by_one_cell_and_come_back_from_a_coarser_map() -> None:
    one = torch.zeros(1, 8, 8, dtype=torch.bool)
    one[0, 3, 4] = True
    assert grown(one).sum() == 9 and grown(one)[0, 2:5, 3:6].all()
    assert finer(coarser(one)).sum() == 4 and finer(coarser(one))[0, 3, 4]


@pytest.mark.parametrize("channels", [3, 8])
def test_filled_cells_are_those_that_are_not_zero(channels: int) -> None:
    cells = some_cells(0.3)
    maps = cells.dense(torch.rand(len(cells), channels) + 0.1)
    assert (filled(maps) == cells.used()).all()
    assert (filled(maps.contiguous()) == cells.used()).all()
