"""The height of the ground, read off the very triangles that sensors see."""

from __future__ import annotations

import numpy as np

from coopsim.geometry.se3 import SE3, Floats
from coopsim.support.kernels import njit
from coopsim.world.relief.relief_grid import CELL_M, ReliefGrid, grid_of, height_at, is_over


class Relief:
    """Ground that is flat, at 0, but for raised surfaces.

    Where surfaces lie over each other the highest one counts, as for a ray from above.

    Args:
        triangles: (T, 3, 3) m, world frame, counter-clockwise from above and none of them upright.

    Attributes:
        grid: the triangles, by place.
    """

    def __init__(self, triangles: Floats) -> None:
        self.grid = grid_of(triangles)

    def heights(self, points: Floats) -> Floats:
        """Return the heights (N,) m of the ground at points (N, 2) m in the world frame."""
        heights: Floats = _heights(np.ascontiguousarray(points, dtype=np.float64), self.grid)
        return heights

    def raised(self, pose: SE3) -> SE3:
        """Return a pose over flat ground as it is over this ground."""
        x, y, z = pose.translation.tolist()
        return SE3(pose.rotation, np.array([x, y, z + self.heights(np.array([[x, y]]))[0]]))


@njit(cache=True, nogil=True)
def _heights(points: Floats, grid: ReliefGrid) -> Floats:
    """Return the highest surface's heights (N,) at points (N, 2), at least 0."""
    heights, rows, columns = np.zeros(len(points)), grid.cells[0], grid.cells[1]
    for n in range(len(points)):
        x, y = points[n, 0], points[n, 1]
        i, j = np.floor((x - grid.low[0]) / CELL_M), np.floor((y - grid.low[1]) / CELL_M)
        if not (0 <= i < rows and 0 <= j < columns):  # nor is NaN within
            continue
        cell = int(i) * columns + int(j)
        for k in range(grid.start[cell], grid.start[cell + 1]):
            triangle = grid.triangles[grid.found[k]]
            if is_over(triangle, x, y):
                heights[n] = max(heights[n], height_at(triangle, x, y))
    return heights
