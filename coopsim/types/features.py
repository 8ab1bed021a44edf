"""Sensor data and encodings of it for others to fuse: point clouds, feature maps and instance queries."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from coopsim.errors import InvalidValueError
from coopsim.geometry.boxes import Boxes3D
from coopsim.geometry.se3 import SE3, Floats
from coopsim.support.arrays import Ints, Mask, freeze
from coopsim.support.checks import require_count, require_finite_number, require_positive
from coopsim.types.sensing import Sweep

_ROUNDING = 1e-6
"""In cells: smaller differences of places are rounding."""


@dataclass(frozen=True, slots=True, eq=False)
class PointCloud:
    """N points in the sender's base frame.

    Attributes:
        xyz: (N, 3) m, float32.
        intensity: (N,) in [0, 1], float32.
    """

    xyz: NDArray[np.float32]
    intensity: NDArray[np.float32]

    def __post_init__(self) -> None:
        freeze(self, xyz=((None, 3), np.float32))
        freeze(self, intensity=((len(self.xyz),), np.float32))

    @classmethod
    def of(cls, *sweeps: Sweep) -> PointCloud:
        """Return the points of sweeps of one agent."""
        return cls.concatenate(cls(sweep.points, sweep.intensity) for sweep in sweeps)

    @classmethod
    def concatenate(cls, parts: Iterable[PointCloud]) -> PointCloud:
        """Return the points of all clouds, in order."""
        clouds = list(parts)
        if len(clouds) == 1:
            return clouds[0]
        xyz = np.concatenate([np.zeros((0, 3), np.float32), *(cloud.xyz for cloud in clouds)])
        return cls(xyz, np.concatenate([np.zeros(0, np.float32), *(cloud.intensity for cloud in clouds)]))

    @classmethod
    def empty(cls) -> PointCloud:
        """Return a cloud without points."""
        return cls(np.zeros((0, 3), np.float32), np.zeros(0, np.float32))

    def __len__(self) -> int:
        return len(self.xyz)

    def __getitem__(self, index: slice | Ints | Mask) -> PointCloud:
        return PointCloud(self.xyz[index], self.intensity[index])

    def transform(self, dst_SE3_src: SE3) -> PointCloud:
        """Return the points, moved from the frame src to dst."""
        return PointCloud(dst_SE3_src.apply(self.xyz).astype(np.float32), self.intensity)

    @property
    def extent_m(self) -> float:
        """The largest absolute coordinate."""
        return float(np.abs(self.xyz).max(initial=0.0))


@dataclass(frozen=True, slots=True)
class BevGrid:
    """A grid of square cells on the ground around an agent, seen from above, in its base frame.

    Cell (row i, column j) has its centre at x = x_m[0] + (j + 1/2) cell_m, y = y_m[0] + (i + 1/2) cell_m: columns go
    along x (forward), rows along y (left). Two grids are equal if all their numbers are.

    Attributes:
        x_m: least and largest x.
        y_m: least and largest y.
        cell_m: edge of a cell, by which both ranges can be divided.

    Raises:
        InvalidValueError: a range is empty or not a whole number of cells, or a number is not finite.
    """

    x_m: tuple[float, float]
    y_m: tuple[float, float]
    cell_m: float

    def __post_init__(self) -> None:
        require_positive(cell_m=self.cell_m)
        object.__setattr__(self, "cell_m", float(self.cell_m))
        for name in ("x_m", "y_m"):
            given = getattr(self, name)
            if not (isinstance(given, (tuple, list, np.ndarray)) and len(given) == 2):
                raise InvalidValueError(f"{name} must be the least and the largest value, got {given!r}")
            low, high = given
            require_finite_number(**{f"{name}[0]": low, f"{name}[1]": high})
            cells = (high - low) / self.cell_m
            if not (math.isfinite(cells) and round(cells) >= 1 and abs(cells - round(cells)) <= 1e-3):
                raise InvalidValueError(
                    f"{name} must be a whole number >= 1 of cells of {self.cell_m:g} m, got {low:g} to {high:g}"
                )
            object.__setattr__(self, name, (float(low), float(high)))

    @property
    def shape(self) -> tuple[int, int]:
        """H, the number of rows (cells along y), and W, the number of columns (cells along x)."""
        rows, columns = ((high - low) / self.cell_m for low, high in (self.y_m, self.x_m))
        return round(rows), round(columns)

    def coarser(self, factor: int) -> BevGrid:
        """Return the grid of the same area with cells `factor` times as wide, as after a convolution of that stride.

        Raises:
            InvalidValueError: the numbers of cells cannot be divided by `factor`.
        """
        require_count(1, factor=factor)
        if any(cells % factor for cells in self.shape):
            raise InvalidValueError(f"factor must divide {self.shape} cells, got {factor}")
        return BevGrid(self.x_m, self.y_m, self.cell_m * factor)

    def cell_centers(self) -> Floats:
        """Return the centres of all cells, (H, W, 2) m: x and y."""
        rows, columns = self.shape
        x = self.x_m[0] + (np.arange(columns) + 0.5) * self.cell_m
        y = self.y_m[0] + (np.arange(rows) + 0.5) * self.cell_m
        return np.stack(np.broadcast_arrays(x[None, :], y[:, None]), axis=-1)

    def __str__(self) -> str:
        (x_low, x_high), (y_low, y_high) = self.x_m, self.y_m
        return f"x {x_low:g} to {x_high:g} m, y {y_low:g} to {y_high:g} m in cells of {self.cell_m:g} m"


@dataclass(frozen=True, slots=True, eq=False)
class FeatureMap:
    """Features of the cells of a grid around an agent.

    Attributes:
        values: (C, H, W) float32.
        grid: the place of the cells.
        confidence: (H, W) in [0, 1], how sure the sender is that something is in a cell; None: not stated.
        sent: (H, W) the cells whose features are known, where some were left out on the way; None: all.
        request: (H / b, W / b) in [0, 1], how much the sender asks others for features of each block of b x b cells,
            b from 1 to 255; None: it asks for nothing.
        space: number of the network whose features these are, which no other one understands; 0: not stated.
        priority: (H, W) which cells to send first where not all are sent, the larger the sooner; None: those of the
            largest confidence. It is not sent itself.

    Raises:
        InvalidValueError: shapes differ from the grid's, or `space` is not of 32 bits.
    """

    values: NDArray[np.float32]
    grid: BevGrid
    confidence: NDArray[np.float32] | None = None
    sent: Mask | None = None
    request: NDArray[np.float32] | None = None
    space: int = 0
    priority: NDArray[np.float32] | None = None

    def __post_init__(self) -> None:
        if not isinstance(self.grid, BevGrid):
            raise InvalidValueError(f"grid must be a BevGrid, got {self.grid!r}")
        shape = self.grid.shape
        freeze(self, values=((None, *shape), np.float32), confidence=(shape, np.float32), sent=(shape, np.bool_))
        freeze(self, request=((None, None), np.float32), priority=(shape, np.float32))
        require_count(0, 2**32 - 1, space=self.space)
        if self.request is not None:
            block = self.request_block
            if not 1 <= block <= 255 or self.request.shape != tuple(cells // block for cells in shape):
                raise InvalidValueError(
                    f"request must be of square blocks of {shape} cells, got shape {self.request.shape}"
                )

    @property
    def request_block(self) -> int:
        """b, the edge of the request's blocks in cells; 0: there is no request, or it does not divide the grid."""
        if self.request is None or not len(self.request) or self.grid.shape[0] % len(self.request):
            return 0
        block = self.grid.shape[0] // len(self.request)
        return 0 if self.grid.shape[1] % block else block

    def require_grid(self, grid: BevGrid) -> None:
        """Raise `InvalidValueError` unless the features are on `grid`."""
        if self.grid != grid:
            raise InvalidValueError(f"features must be on the grid {grid}, got {self.grid}: warp them")

    def warp(self, grid: BevGrid, dst_SE3_src: SE3) -> tuple[FeatureMap, Mask]:
        """Resample the features at the cell centres of another grid in another frame, bilinearly, on the ground plane.

        Args:
            grid: the receiver's.
            dst_SE3_src: the motion from the sender's base frame (src) to the receiver's (dst), as `grid` is in dst.

        Returns:
            The features on `grid`, and a mask (H, W) of its cells whose centre lies between centres of the sender's
            cells. Values and confidences of the others are zero. `sent`, `request` and `priority` stay behind.
        """
        centers = grid.cell_centers().reshape(-1, 2)
        ground = np.column_stack([centers, np.full(len(centers), dst_SE3_src.translation[2])])
        x, y, _ = dst_SE3_src.inverse().apply(ground).T
        row, column = self._index(y, self.grid.y_m), self._index(x, self.grid.x_m)
        rows, columns = self.grid.shape
        inside = (row >= 0) & (row <= rows - 1) & (column >= 0) & (column <= columns - 1)
        stated = [] if self.confidence is None else [self.confidence[None]]
        sampled = _bilinear(np.concatenate([self.values, *stated]), row, column, inside).reshape(-1, *grid.shape)
        confidence = None if self.confidence is None else sampled[-1]
        moved = FeatureMap(sampled[: len(self.values)], grid, confidence, space=self.space)
        return moved, inside.reshape(grid.shape)

    def _index(self, place_m: Floats, range_m: tuple[float, float]) -> Floats:
        """Return fractional rows or columns of places; whole numbers but for rounding become whole."""
        index = (place_m - range_m[0]) / self.grid.cell_m - 0.5
        whole = np.rint(index)
        return np.where(np.abs(index - whole) <= _ROUNDING, whole, index)


def _bilinear(values: NDArray[np.float32], row: Floats, column: Floats, inside: Mask) -> NDArray[np.float32]:
    """Interpolate (C, H, W) at N fractional rows and columns; returns (C, N), zeros where not inside."""
    _, rows, columns = values.shape
    out = np.zeros((len(values), len(row)), dtype=np.float32)
    row, column = row[inside], column[inside]
    top, left = (np.floor(index).astype(np.int64) for index in (row, column))
    bottom, right = np.minimum(top + 1, rows - 1), np.minimum(left + 1, columns - 1)
    down, across = (row - top).astype(np.float32), (column - left).astype(np.float32)
    upper = values[:, top, left] * (1 - across) + values[:, top, right] * across
    lower = values[:, bottom, left] * (1 - across) + values[:, bottom, right] * across
    out[:, inside] = upper * (1 - down) + lower * down
    return out


FAST_M_S = 10.0
"""Unit of the velocity that is the last two numbers of a query's feature vector."""


@dataclass(frozen=True, slots=True, eq=False)
class InstanceQueries:
    """K queries, each a feature vector of one object, in the sender's base frame.

    Attributes:
        feature: (K, D) float32.
        boxes: K reference boxes.
        score: (K,) confidence.
        label: (K,) int, an `ObjectClass`.
        space: number of the network whose features these are, which no other one understands; 0: not stated.

    Raises:
        InvalidValueError: shapes do not fit each other, or `space` is not of 32 bits.
    """

    feature: NDArray[np.float32]
    boxes: Boxes3D
    score: Floats
    label: Ints
    space: int = 0

    def __post_init__(self) -> None:
        count = len(self.boxes)
        require_count(0, 2**32 - 1, space=self.space)
        freeze(self, feature=((count, None), np.float32), score=((count,), np.float64), label=((count,), np.int64))

    def __len__(self) -> int:
        return len(self.boxes)

    def __getitem__(self, index: slice | Ints | Mask) -> InstanceQueries:
        kept = self.feature[index], self.boxes[index], self.score[index], self.label[index]
        return InstanceQueries(*kept, space=self.space)
