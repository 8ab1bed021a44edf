"""Request maps: cells that a receiver asks for, and a sender's choice of cells by such requests.

Where2comm (Hu et al., NeurIPS 2022) asks for the places where the receiver is not sure of itself, R = 1 - C with its
confidence map C, and sends what the sender is sure of and the receiver is not, C_sender * R_receiver. Neither is in its
published code. A broadcast serves all receivers at once, so here the largest request counts.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from coopsim.geometry.se3 import Floats
from coopsim.types import BevGrid

Float32s = NDArray[np.float32]


@dataclass(frozen=True, slots=True, eq=False)
class Request:
    """Request map of one receiver, with its pose relative to a sender.

    Attributes:
        values: (h, w) in [0, 1], 1 where the receiver knows nothing.
        grid: their cells, in the receiver's frame.
        receiver_SE2_sender: (3,) x m, y m, yaw rad of the sender's frame in the receiver's.
    """

    values: Float32s
    grid: BevGrid
    receiver_SE2_sender: Floats


def request_map(confidence: Float32s, grid: BevGrid, factor: int = 8) -> tuple[Float32s, BevGrid]:
    """Return a receiver's request: 1 - confidence, of the surest cell of each block of cells.

    A block is asked for unless something is known in it. The mean over a block, which is mostly empty, would be nearly
    1 everywhere.

    The confidence (H, W) is in [0, 1], of the receiver's own cells; `factor` is the edge of a block in cells. Return
    the requests (H / factor, W / factor), and their grid.
    """
    coarse = grid.coarser(factor)
    rows, columns = coarse.shape
    surest = confidence.reshape(rows, factor, columns, factor).max(axis=(1, 3))
    return (1 - surest).astype(np.float32), coarse


def selection_weight(confidence: Float32s, grid: BevGrid, requests: Sequence[Request]) -> Float32s:
    """Return a weight (H, W) in [0, 1] for the choice of cells: confidence times the largest request for its place.

    A receiver asks for all that lies beyond its requests' grid. Without any request all places count alike. The
    confidence (H, W) in [0, 1] is of the sender's own cells.
    """
    if not requests:
        return confidence.astype(np.float32)
    centers = grid.cell_centers()
    wanted: Float32s = np.max([_asked_for(request, centers) for request in requests], axis=0)
    weight: Float32s = (confidence * wanted).astype(np.float32)
    return weight


def _asked_for(request: Request, centers: Floats) -> Float32s:
    """Return the request at places (H, W, 2) in the sender's frame."""
    x, y, yaw = np.asarray(request.receiver_SE2_sender, dtype=np.float64)
    cos, sin = np.cos(yaw), np.sin(yaw)
    there_x = cos * centers[..., 0] - sin * centers[..., 1] + x
    there_y = sin * centers[..., 0] + cos * centers[..., 1] + y
    grid = request.grid
    rows, columns = grid.shape
    column = np.floor((there_x - grid.x_m[0]) / grid.cell_m).astype(np.int64)
    row = np.floor((there_y - grid.y_m[0]) / grid.cell_m).astype(np.int64)
    inside = (row >= 0) & (row < rows) & (column >= 0) & (column < columns)
    asked: Float32s = np.ones(inside.shape, np.float32)
    asked[inside] = request.values[row[inside], column[inside]]
    return asked
