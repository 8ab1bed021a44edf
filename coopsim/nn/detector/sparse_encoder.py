"""An encoder that computes where points are: pillars, four scales of cells in use, and their sum on a map."""

from __future__ import annotations

import torch
from torch import Tensor, nn
from torch.nn import functional

from coopsim.nn.detector.encoder import EncoderConfig, PointLayer, require_grid
from coopsim.nn.detector.pillars import PillarBatch
from coopsim.nn.detector.sparse_cells import SparseCells, SparseConv, coarser, finer, grown, parents, wholes


class SparseEncoder(PointLayer):
    """Encoder of pillars on the cells in use, after PillarNet (Shi et al., ECCV 2022, section 3).

    Pillars and cells of two of them are those with points; the two coarser scales have a ring of cells more, into which
    their convolutions carry what stands beside. The map has features in that ring's cells and around it, at least 3.2 m
    from every point with pillars of 0.4 m: there the centre of an object lies of which one end is seen.
    """

    def __init__(self, config: EncoderConfig | None = None) -> None:
        super().__init__()
        self.config = config = config or EncoderConfig(layout="sparse")
        self.make_points(config)
        width, features = config.pillar_features, config.features
        self.pillars = nn.ModuleList([SparseConv(width, width)])
        widths = (width, *config.channels)
        self.down = nn.ModuleList(SparseConv(a, b, 4) for a, b in zip(widths, config.channels, strict=False))
        self.scales = nn.ModuleList(
            nn.ModuleList(SparseConv(channels, channels) for _ in range(layers))
            for channels, layers in zip(config.channels, config.layers, strict=True)
        )
        self.sides = nn.ModuleList(nn.Linear(channels, features, bias=False) for channels in config.channels)
        self.join = nn.BatchNorm1d(features, eps=1e-3, momentum=0.05)

    def forward(self, batch: PillarBatch) -> Tensor:
        """Return features (A, C, H / 2, W / 2), not negative; zeros far from every point.

        Raises:
            InvalidValueError: rows or columns of the grid do not divide by 8.
        """
        require_grid(batch)
        fine, scales, whole = _cells(batch)
        below = self.of_pillars(batch).to(next(self.sides.parameters()).dtype)  # shorter in a quick encoder
        below = _through(self.pillars, below, fine)
        found, before = [], fine
        for down, layers, cells in zip(self.down, self.scales, scales, strict=True):
            below = _through(layers, down(below, *parents(before, cells)), cells)
            found.append(below)
            before = cells
        return whole.dense(functional.relu(self.join(self._sum(found, scales, whole))))

    def _sum(self, found: list[Tensor], scales: list[SparseCells], whole: SparseCells) -> Tensor:
        """Return the sum (M, C) of the scales at the cells of the map."""
        total = None
        for level, (below, side, cells) in enumerate(zip(found, self.sides, scales, strict=True)):
            each = side(below)
            row = whole_rows(whole, cells, level)
            each = torch.cat([each, each.new_zeros(1, each.shape[1])]).index_select(0, row)
            total = each if total is None else total + each
        assert total is not None
        return total

    def shorten(self, numbers: torch.dtype) -> None:
        """Compute all but the points in shorter numbers: for inference alone."""
        for each in (self.pillars, self.down, self.scales, self.sides):
            each.to(numbers)


def whole_rows(whole: SparseCells, cells: SparseCells, level: int) -> Tensor:
    """Return the row (M,) in `cells`, 2^level as wide, of each cell of the map."""
    return cells.row_of[whole.cell] if level == 0 else wholes(whole, cells, level)


def _through(layers: nn.Module, below: Tensor, cells: SparseCells) -> Tensor:
    """Return features after layers of 3 x 3 cells, each added to what it was given (He et al., CVPR 2016)."""
    table = cells.neighbors()
    for layer in layers.children():
        below = layer(below, table, added=below)
    return below


def _cells(batch: PillarBatch) -> tuple[SparseCells, list[SparseCells], SparseCells]:
    """Return the cells in use: of the pillars, of the three scales, and of the map."""
    rows, columns = batch.shape
    row_of = torch.full((batch.clouds * rows * columns,), len(batch.cell), device=batch.cell.device)
    row_of[batch.cell] = torch.arange(len(batch.cell), device=batch.cell.device)
    fine = SparseCells(batch.cell, row_of, (batch.clouds, rows, columns))
    first = coarser(fine.used())
    second = grown(coarser(first))
    third = grown(coarser(second))
    return fine, [SparseCells.of(each) for each in (first, second, third)], SparseCells.of(finer(grown(second)))
