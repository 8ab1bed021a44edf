"""Convolutions over the cells of a map that are in use: a rulebook of neighbours, and products of what it gathers.

Few pillars have points: convolving the others multiplies zeros. The cells of a map that are convolved are listed, each
with the rows of its 3 x 3 neighbours (SECOND, Yan et al., Sensors 2018, section 3.2; the cells that are in use do not
grow from layer to layer, as in Graham and van der Maaten, "Submanifold sparse convolutional networks", 2017).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor, nn
from torch.nn import functional

from coopsim.nn.detector.encoder import batch_normed

NEIGHBORS = 9
"""Places of a 3 x 3 convolution."""


@dataclass(frozen=True, slots=True, eq=False)
class SparseCells:
    """The M cells in use of the maps (A, rows, columns) of a batch.

    Attributes:
        cell: (M,) int64 their numbers through all maps, rising.
        row_of: (A * rows * columns,) int64 row of each cell in `cell`; M: it is not in use.
        shape: A, rows and columns.
    """

    cell: Tensor
    row_of: Tensor
    shape: tuple[int, int, int]

    @classmethod
    def of(cls, used: Tensor) -> SparseCells:
        """Return the cells in use of (A, rows, columns) flags."""
        maps, rows, columns = used.shape
        flat = used.reshape(-1)
        cell = torch.nonzero(flat)[:, 0]
        row_of = torch.full((len(flat),), len(cell), dtype=torch.int64, device=used.device)
        row_of[cell] = torch.arange(len(cell), device=used.device)
        return cls(cell, row_of, (maps, rows, columns))

    def __len__(self) -> int:
        return len(self.cell)

    def used(self) -> Tensor:
        """Return flags (A, rows, columns) of the cells in use."""
        return (self.row_of < len(self)).view(self.shape)

    def neighbors(self) -> Tensor:
        """Return the rows (M, 9) of the cells' 3 x 3 neighbours, row by row; M: not in use, or beyond the map."""
        _, rows, columns = self.shape
        padded = functional.pad(self.row_of.view(self.shape), (1, 1, 1, 1), value=len(self))
        wide = columns + 2
        number, row, column = self.places()
        start = (number * (rows + 2) + row) * wide + column
        steps = torch.tensor([i * wide + j for i in range(3) for j in range(3)], device=start.device)
        return padded.view(-1)[start[:, None] + steps]

    def places(self) -> tuple[Tensor, Tensor, Tensor]:
        """Return map, row and column (M,) of the cells in use."""
        _, rows, columns = self.shape
        line = torch.div(self.cell, columns, rounding_mode="floor")
        number = torch.div(line, rows, rounding_mode="floor")
        return number, line - number * rows, self.cell - line * columns

    def dense(self, features: Tensor, elsewhere: float = 0.0) -> Tensor:
        """Return maps (A, C, rows, columns) of the features (M, C) of the cells in use, and of a number elsewhere."""
        maps, rows, columns = self.shape
        out = features.new_full((maps * rows * columns, features.shape[1]), elsewhere)
        out = (
            out.index_put((self.cell,), features) if features.requires_grad else out.index_copy_(0, self.cell, features)
        )
        return out.view(maps, rows, columns, -1).permute(0, 3, 1, 2)


def grown(used: Tensor) -> Tensor:
    """Return flags (A, rows, columns) of the cells of which one of the 3 x 3 neighbours is flagged."""
    out = used.clone()
    out[:, 1:] |= used[:, :-1]
    out[:, :-1] |= used[:, 1:]
    tall = out.clone()
    out[:, :, 1:] |= tall[:, :, :-1]
    out[:, :, :-1] |= tall[:, :, 1:]
    return out


def coarser(used: Tensor) -> Tensor:
    """Return flags (A, rows / 2, columns / 2) of the pairs of rows and columns in which one is flagged."""
    return used[:, ::2, ::2] | used[:, 1::2, ::2] | used[:, ::2, 1::2] | used[:, 1::2, 1::2]


def finer(used: Tensor) -> Tensor:
    """Return flags (A, 2 rows, 2 columns) of the parts of flagged cells."""
    return used.repeat_interleave(2, 1).repeat_interleave(2, 2)


def filled(features: Tensor) -> Tensor:
    """Return flags (A, rows, columns) of the cells in which maps (A, C, rows, columns) are not zero."""
    rows = features.permute(0, 2, 3, 1)
    if rows.is_contiguous() and rows.shape[-1] * rows.element_size() % 8 == 0:
        return rows.detach().view(torch.int64).ne(0).any(-1)  # eight bytes at once
    return rows.ne(0).any(-1)


class SparseConv(nn.Module):
    """A product of the features at K places around each cell, with batch normalisation and ReLU.

    Args:
        before: channels of what it is given.
        after: channels of the result.
        places: number K of places.
    """

    def __init__(self, before: int, after: int, places: int = NEIGHBORS) -> None:
        super().__init__()
        self.weight = nn.Parameter(torch.randn(places * before, after) * (2.0 / (places * before)) ** 0.5)
        self.norm: nn.Module = nn.BatchNorm1d(after, eps=1e-3, momentum=0.05)
        self.register_buffer("bias", None)

    def forward(self, x: Tensor, table: Tensor, back: Tensor | None = None, added: Tensor | None = None) -> Tensor:
        """Return features (M, after) of rows of x (N, before).

        Args:
            x: features.
            table: (M, K) rows around each cell; N: none.
            back: (N, K) the rows of the result that have a row of x at each place; M: none. None: the places are the
                3 x 3 neighbours of the same cells.
            added: (M, after) what is added before the ReLU.
        """
        weight: Tensor = self.weight
        if torch.is_autocast_enabled(x.device.type):
            numbers = torch.get_autocast_dtype(x.device.type)
            x, weight = x.to(numbers), weight.to(numbers)
        if self.bias is None:
            made = batch_normed(self.norm, _GatheredProduct.apply(x, weight, table, back))  # type: ignore[no-untyped-call]
        else:
            made = _folded_product(x, weight, table, self.bias)
        return functional.relu(made if added is None else made + added)

    def fold(self) -> None:
        """Make the normalisation part of the weight: for inference alone."""
        norm: Any = self.norm
        factor = norm.weight / torch.sqrt(norm.running_var + norm.eps)
        self.bias = (norm.bias - norm.running_mean * factor).detach()
        self.weight = nn.Parameter((self.weight * factor).detach(), requires_grad=False)
        self.norm = nn.Identity()


class _GatheredProduct(torch.autograd.Function):
    """Product of gathered features and a weight, whose gradient gathers, too, and scatters nothing."""

    @staticmethod
    def forward(ctx: Any, x: Tensor, weight: Tensor, table: Tensor, back: Tensor | None) -> Tensor:
        ctx.save_for_backward(x, weight, table, back)
        return gathered(x, table) @ weight

    @staticmethod
    def backward(ctx: Any, grad: Tensor) -> tuple[Tensor | None, ...]:
        x, weight, table, back = ctx.saved_tensors
        grad = grad.contiguous()
        back = table.flip(1) if back is None else back  # the neighbour on the left has one on the right
        of_weight = gathered(x, table).T @ grad
        of_x = None
        if ctx.needs_input_grad[0]:
            turned = weight.view(back.shape[1], -1, weight.shape[1]).transpose(1, 2).reshape(-1, x.shape[1])
            of_x = gathered(grad, back) @ turned
        return of_x, of_weight, None, None


_AT_ONCE = 1024
"""Cells whose gathered features, some megabytes, stay in a processor's cache until they are multiplied."""


def _folded_product(x: Tensor, weight: Tensor, table: Tensor, bias: Tensor) -> Tensor:
    """Return a bias plus the product of gathered features and a weight, without gradients."""
    if x.device.type != "cpu" or len(table) <= _AT_ONCE:
        return torch.addmm(bias, gathered(x, table), weight)
    padded, made = torch.cat([x, x.new_zeros(1, x.shape[1])]), x.new_empty(len(table), weight.shape[1])
    bias = bias.to(x.dtype)
    for start in range(0, len(table), _AT_ONCE):
        rows, out = table[start : start + _AT_ONCE], made[start : start + _AT_ONCE]
        torch.addmm(bias, padded.index_select(0, rows.reshape(-1)).view(len(rows), -1), weight, out=out)
    return made


def gathered(x: Tensor, table: Tensor) -> Tensor:
    """Return the features (M, K C) of K rows of x (N, C) for each of M; row N is zeros."""
    padded = torch.cat([x, x.new_zeros(1, x.shape[1])])
    return padded.index_select(0, table.reshape(-1)).view(len(table), table.shape[1] * x.shape[1])


def parents(fine: SparseCells, coarse: SparseCells) -> tuple[Tensor, Tensor]:
    """Return the rows (M, 4) of the parts of coarse cells, and the rows (N, 4) of fine ones' wholes at each place.

    A row is that of none (N and M) where a part is not in use, and at all places of a fine cell but its own.
    """
    _, rows, columns = fine.shape
    four = fine.row_of.view(-1, rows // 2, 2, columns // 2, 2).permute(0, 1, 3, 2, 4).reshape(-1, 4)
    table = four[coarse.cell]
    back = torch.full((len(fine) + 1, 4), len(coarse), device=table.device)
    whole = torch.arange(len(coarse), device=table.device)
    for place in range(4):
        back[table[:, place], place] = whole
    return table, back[:-1]


def wholes(fine: SparseCells, coarse: SparseCells, levels: int = 1) -> Tensor:
    """Return the row (N,) of the coarse cell, 2^levels as wide, that each fine cell lies in; M: it is not in use."""
    _, rows, columns = fine.shape
    number, row, column = fine.places()
    return coarse.row_of[(number * (rows >> levels) + (row >> levels)) * (columns >> levels) + (column >> levels)]
