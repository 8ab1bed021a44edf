"""Training targets of a head: heat of the objects' centres, and codes of their boxes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from coopsim.geometry.se3 import Floats
from coopsim.nn.detector.decode import cell_centers
from coopsim.nn.detector.detector_net import encode_boxes
from coopsim.types import BevGrid, Ints
from coopsim.types.taxonomy import CLASS_NAMES

_REACH_M = 3.6
"""Distance along each axis up to which there is heat around a centre."""

_CODED_HEAT = 0.2
"""Cells around a centre with at least this heat are taught its code, too: a peak may be one cell beside it."""

_LEAST_SPREAD_M, _MOST_SPREAD_M = 0.5, 1.3


@dataclass(frozen=True, slots=True, eq=False)
class Targets:
    """The targets of B maps.

    Attributes:
        heat: (B, 9, h, w) in [0, 1], 1 at the cells of centres.
        cell: (M,) cells whose code is taught, numbered through all maps.
        code: (M, 12), see `coopsim.nn.detector.detector_net`.
        weight: (M,) heat of the cells.
        label: (M,) class of the cells' objects.
        yaw: (M,) heading of the cells' objects.
        moves: (M,) 1 where the sample shows how the cells' objects move, else 0.
        ignored: (B, h, w) True near objects that hardly show: heat there is neither right nor wrong.
        objects: number of objects.
        cell_m: edge of a cell.
    """

    heat: Tensor
    cell: Tensor
    code: Tensor
    weight: Tensor
    label: Tensor
    yaw: Tensor
    moves: Tensor
    ignored: Tensor
    objects: int
    cell_m: float

    def to(self, device: torch.device | str) -> Targets:
        """Return the targets on another device."""
        return replace(self, **{name: getattr(self, name).to(device) for name in ("cell", *_JOINED)})


_JOINED = ("heat", "code", "weight", "label", "yaw", "moves", "ignored")


def make_targets(
    boxes: Floats,
    velocity: Floats,
    label: Ints,
    grid: BevGrid,
    doubtful: NDArray[np.bool_] | None = None,
    *,
    moves: bool = True,
) -> Targets:
    """Return the targets of one map.

    The heat of an object is a Gaussian around the cell of its centre, elementwise the largest of all objects of a
    class (CenterPoint, section 4). Its spread is a quarter of the root of the box's area, from 0.5 to 1.3 m.

    Args:
        boxes: (N, 7) in the frame of `grid`; those with their centre outside are left out.
        velocity: (N, 2) m/s.
        label: (N,) classes.
        grid: the cells of the features.
        doubtful: (N,) flags of objects that hardly show: around these, no heat is right or wrong. None: of none.
        moves: the sample shows how objects move.
    """
    rows, columns = grid.shape
    column = np.floor((boxes[:, 0] - grid.x_m[0]) / grid.cell_m).astype(np.int64)
    row = np.floor((boxes[:, 1] - grid.y_m[0]) / grid.cell_m).astype(np.int64)
    inside = (row >= 0) & (row < rows) & (column >= 0) & (column < columns)
    clear = inside if doubtful is None else inside & ~doubtful
    ignored = np.zeros((rows, columns), np.bool_)
    _, i, j, _ = _patches(boxes[inside & ~clear], row[inside & ~clear], column[inside & ~clear], grid)
    ignored[i, j] = True
    boxes, velocity, label = boxes[clear], velocity[clear], label[clear]
    number, i, j, heat = _patches(boxes, row[clear], column[clear], grid)
    maps = np.zeros((len(CLASS_NAMES), rows, columns), np.float32)
    np.maximum.at(maps, (label[number], i, j), heat)
    coded = heat >= _CODED_HEAT
    ignored[i[coded], j[coded]] = False
    number, cell, heat = _strongest(number[coded], (i * columns + j)[coded], heat[coded])
    cells, labels = torch.from_numpy(cell), torch.from_numpy(label[number])
    code = encode_boxes(
        torch.from_numpy(boxes[number]), torch.from_numpy(velocity[number]), labels,
        cell_centers(cells, grid).double(), grid.cell_m,
    )  # fmt: skip
    return Targets(
        torch.from_numpy(maps)[None], cells, code, torch.from_numpy(heat), labels,
        torch.from_numpy(boxes[number, 6]).float(), torch.full((len(cell),), float(moves)),
        torch.from_numpy(ignored)[None], len(boxes), grid.cell_m,
    )  # fmt: skip


def join_targets(parts: Sequence[Targets]) -> Targets:
    """Join the targets of maps of one shape into those of a batch."""
    size = parts[0].heat.shape[-2] * parts[0].heat.shape[-1]
    first = np.cumsum([0, *(len(part.heat) for part in parts)])
    cells = [part.cell + int(start) * size for part, start in zip(parts, first, strict=False)]
    tensors: dict[str, Any] = {name: torch.cat([getattr(part, name) for part in parts]) for name in _JOINED}
    return replace(parts[0], cell=torch.cat(cells), objects=sum(part.objects for part in parts), **tensors)


def _patches(boxes: Floats, row: Ints, column: Ints, grid: BevGrid) -> tuple[Ints, Ints, Ints, NDArray[np.float32]]:
    """Return object, row, column and heat of the cells around all centres that lie in the grid."""
    reach = round(_REACH_M / grid.cell_m)
    near = np.arange(-reach, reach + 1)
    spread_m = np.clip(0.25 * np.sqrt(boxes[:, 3] * boxes[:, 4]), _LEAST_SPREAD_M, _MOST_SPREAD_M)
    away = np.exp(-0.5 * (near * grid.cell_m) ** 2 / spread_m[:, None] ** 2)
    heat = (away[:, :, None] * away[:, None, :]).astype(np.float32)
    i, j = np.broadcast_arrays(row[:, None, None] + near[:, None], column[:, None, None] + near[None, :])
    number = np.broadcast_to(np.arange(len(boxes))[:, None, None], i.shape)
    rows, columns = grid.shape
    kept = (i >= 0) & (i < rows) & (j >= 0) & (j < columns) & (heat > 1e-3)
    return number[kept], i[kept], j[kept], heat[kept]


def _strongest(number: Ints, cell: Ints, heat: NDArray[np.float32]) -> tuple[Ints, Ints, NDArray[np.float32]]:
    """Keep of the objects that share a cell the one with the most heat there, by cell."""
    order = np.lexsort((number, -heat, cell))
    number, cell, heat = number[order], cell[order], heat[order]
    first = np.ones(len(cell), np.bool_)
    first[1:] = cell[1:] != cell[:-1]
    return number[first], cell[first], heat[first]
