"""Points gathered into pillars: columns of the ground's cells (PointPillars, Lang et al., CVPR 2019, section 2.1).

Unlike there, a pillar takes any number of points, so the result does not depend on their order.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from coopsim.errors import InvalidValueError
from coopsim.nn.detector.ground import surface
from coopsim.nn.detector.local_ground import local_ground
from coopsim.support.checks import require_between, require_flag, require_positive
from coopsim.support.kernels import njit
from coopsim.types import BevGrid

POINT_FEATURES = 10
"""Length of a point's features, see `pillarize`."""

_COARSE_M = 2.4
"""Edge of a cell in which the ground is looked for, about: so many whole pillars."""


@dataclass(frozen=True, slots=True)
class GroundSettings:
    """Rule that tells points on the ground from others. They are dropped: half of all points lie there.

    Attributes:
        relief_m: the ground under a point is within this height of the smooth surface of `coopsim.nn.detector.ground`.
        above_m: points up to this height above the ground are dropped.
        local: the ground is that of `coopsim.nn.detector.local_ground` instead, which has no relief.
    """

    relief_m: float = 0.25
    above_m: float = 0.15
    local: bool = False

    def __post_init__(self) -> None:
        require_positive(above_m=self.above_m)
        require_between(0, 100, relief_m=self.relief_m)
        require_flag(local=self.local)

    def under(self, points: NDArray[np.float32]) -> tuple[NDArray[np.float32], float]:
        """Return the height (P,) m of the ground under points, and how far off it may be, m."""
        return (local_ground(points), 0.0) if self.local else (surface(points), self.relief_m)


MOST_BANDS = 8
"""Largest number of parts of a pillar's height."""


@dataclass(frozen=True, slots=True)
class PillarSettings:
    """Rule by which points are gathered.

    A pillar has a part for each band of heights, and if `apart` one for each band and sweep. The points of a part know
    nothing of those of another: what hangs over an object does not change what is gathered of the object.

    Attributes:
        ground: rule of the ground.
        bands_m: heights over the ground, rising, at which pillars are divided; empty: they are not.
        apart: points of the sweep before have parts of their own.
    """

    ground: GroundSettings = GroundSettings()
    bands_m: tuple[float, ...] = ()
    apart: bool = False

    def __post_init__(self) -> None:
        require_flag(apart=self.apart)
        bands = as_bands("bands_m", self.bands_m)
        object.__setattr__(self, "bands_m", bands)

    @property
    def parts(self) -> int:
        """Number of parts of a pillar."""
        return (len(self.bands_m) + 1) * (1 + self.apart)


def as_bands(name: str, given: object) -> tuple[float, ...]:
    """Return heights at which pillars are divided, as numbers.

    Raises:
        InvalidValueError: they are not positive, do not rise, or are too many.
    """
    if not isinstance(given, (tuple, list)) or len(given) >= MOST_BANDS:
        raise InvalidValueError(f"{name} must be a list of up to {MOST_BANDS - 1} heights, got {given!r}")
    require_positive(**{f"{name}[{k}]": each for k, each in enumerate(given)})
    if any(low >= high for low, high in pairwise(given)):
        raise InvalidValueError(f"{name} must rise, got {list(given)}")
    return tuple(map(float, given))


@dataclass(frozen=True, slots=True, eq=False)
class Pillars:
    """The points of one cloud above ground, by pillar.

    Attributes:
        features: (P, 10) float32 of each point, those of a part of a pillar one after another.
        count: (M B,) int64 number of points of each of the B parts of each pillar that has any.
        cell: (M,) int64 the pillar's number, row x W + column, rising.
        shape: H, W of the grid.
    """

    features: NDArray[np.float32]
    count: NDArray[np.int64]
    cell: NDArray[np.int64]
    shape: tuple[int, int]


@dataclass(frozen=True, slots=True, eq=False)
class PillarBatch:
    """The pillars of A clouds on grids of one shape, as tensors; cells are numbered through all clouds."""

    features: Tensor
    count: Tensor
    cell: Tensor
    clouds: int
    shape: tuple[int, int]

    def to(self, device: torch.device | str) -> PillarBatch:
        """Return the batch on another device."""
        features, count, cell = (each.to(device) for each in (self.features, self.count, self.cell))
        return PillarBatch(features, count, cell, self.clouds, self.shape)


def pillarize(points: NDArray[np.float32], grid: BevGrid, settings: PillarSettings | None = None) -> Pillars:
    """Gather the points above ground into the pillars of a grid; those outside are dropped.

    A point's features are its place relative to the pillar's middle (2, in cells) and to the mean of the points of its
    part of the pillar (3, m), its height above the agent's ground and above the ground under it (m), its intensity, its
    age (s) and the logarithm of the part's number of points. None tells where in the grid the pillar is.

    Args:
        points: (P, 5): x, y, z m in the frame of the grid, whose z = 0 is the ground under the agent; intensity; age s.
        grid: the pillars.
        settings: rule by which they are gathered; None: the default.

    Raises:
        InvalidValueError: points have another shape, or are not finite.
    """
    settings = settings or PillarSettings()
    points = np.ascontiguousarray(points, dtype=np.float32)
    if points.ndim != 2 or points.shape[1] != 5:
        raise InvalidValueError(f"points must be (P, 5): x, y, z, intensity, age; got {points.shape}")
    if not np.isfinite(points).all():
        raise InvalidValueError("points must be finite, got NaN or infinity")
    rows, columns = grid.shape
    coarse = max(1, round(_COARSE_M / grid.cell_m))
    base, relief_m = settings.ground.under(points)
    features, count, cell = _gather(
        points, base, grid.x_m[0], grid.y_m[0], grid.cell_m, rows, columns, coarse,
        relief_m, settings.ground.above_m, np.array(settings.bands_m), settings.apart,
    )  # fmt: skip
    return Pillars(features, count, cell, (rows, columns))


def collate(clouds: Sequence[Pillars]) -> PillarBatch:
    """Join clouds of one shape into a batch.

    Raises:
        InvalidValueError: there is no cloud, or they have different shapes.
    """
    shapes = {cloud.shape for cloud in clouds}
    if len(shapes) != 1:
        raise InvalidValueError(f"a batch takes clouds on grids of one shape, got {sorted(shapes) or 'no cloud'}")
    (shape,) = shapes
    size = shape[0] * shape[1]
    return PillarBatch(
        torch.from_numpy(np.concatenate([cloud.features for cloud in clouds])),
        torch.from_numpy(np.concatenate([cloud.count for cloud in clouds])),
        torch.from_numpy(np.concatenate([cloud.cell + number * size for number, cloud in enumerate(clouds)])),
        len(clouds),
        shape,
    )


@njit(cache=True, nogil=True)
def _gather(points, base, x_low, y_low, cell_m, rows, columns, coarse, relief_m, above_m, bands_m, apart):  # type: ignore[no-untyped-def]
    """Return features (P', 10), counts (M B,) and cells (M,) of the points inside and above ground."""
    total = len(points)
    place = np.empty(total, np.int64)
    low_rows, low_columns = rows // coarse + 3, columns // coarse + 3
    lowest = np.full((low_rows, low_columns), np.float32(relief_m))
    for k in range(total):
        column = int(np.floor((points[k, 0] - x_low) / cell_m))
        row = int(np.floor((points[k, 1] - y_low) / cell_m))
        if row < 0 or column < 0 or row >= rows or column >= columns:
            place[k] = -1
            continue
        place[k] = row * columns + column
        i, j = row // coarse + 1, column // coarse + 1
        lowest[i, j] = min(lowest[i, j], max(points[k, 2] - base[k], -relief_m))
    floor = lowest.copy()  # of each coarse cell and its eight neighbours
    for i in range(1, low_rows - 1):
        for j in range(1, low_columns - 1):
            floor[i, j] = lowest[i - 1 : i + 2, j - 1 : j + 2].min()
    pillar = np.full(rows * columns, -1)
    ground = np.empty(total, np.float32)
    for k in range(total):
        if place[k] < 0:
            continue
        row, column = place[k] // columns, place[k] % columns
        ground[k] = base[k] + min(floor[row // coarse + 1, column // coarse + 1], np.float32(0.0) + relief_m)
        if points[k, 2] - ground[k] <= above_m:
            place[k] = -1
        else:
            pillar[place[k]] = 0
    filled = np.flatnonzero(pillar == 0)
    pillar[filled] = np.arange(len(filled))
    parts = (len(bands_m) + 1) * (2 if apart else 1)
    number = np.zeros(len(filled) * parts + 1, np.int64)
    for k in range(total):
        if place[k] >= 0:
            place[k] = pillar[place[k]] * parts + _part(points[k, 2] - ground[k], points[k, 4], bands_m, apart)
            number[place[k] + 1] += 1
    start = np.cumsum(number)
    kept = start[-1]
    order = np.empty(kept, np.int64)
    for k in range(total):
        if place[k] >= 0:
            order[start[place[k]]] = k
            start[place[k]] += 1
    count = number[1:]
    features = np.empty((kept, 10), np.float32)
    done = 0
    for m in range(len(count)):
        if count[m] == 0:
            continue
        row, column = filled[m // parts] // columns, filled[m // parts] % columns
        middle_x, middle_y = x_low + (column + 0.5) * cell_m, y_low + (row + 0.5) * cell_m
        mean_x = mean_y = mean_z = 0.0
        for k in order[done : done + count[m]]:
            mean_x += points[k, 0]
            mean_y += points[k, 1]
            mean_z += points[k, 2]
        mean_x, mean_y, mean_z = mean_x / count[m], mean_y / count[m], mean_z / count[m]
        dense = np.log(np.float32(count[m])) / 4
        for at in range(done, done + count[m]):
            k = order[at]
            features[at, 0] = (points[k, 0] - middle_x) / cell_m
            features[at, 1] = (points[k, 1] - middle_y) / cell_m
            features[at, 2] = points[k, 0] - mean_x
            features[at, 3] = points[k, 1] - mean_y
            features[at, 4] = points[k, 2] - mean_z
            features[at, 5] = min(points[k, 2], np.float32(8.0)) / 2
            features[at, 6] = min(points[k, 2] - ground[k], np.float32(8.0)) / 2
            features[at, 7] = points[k, 3]
            features[at, 8] = points[k, 4] * 5
            features[at, 9] = dense
        done += count[m]
    return features, count, filled


@njit(cache=True, nogil=True)
def _part(height_m, age_s, bands_m, apart):  # type: ignore[no-untyped-def]
    """Return the number of the part of a pillar that a point is in: bands from below, those of the sweep now first."""
    part = 0
    for top_m in bands_m:
        if height_m >= top_m:
            part += 1
    return part + len(bands_m) + 1 if apart and age_s > 0 else part
