"""Draws triangles into the grid of a spinning LiDAR's rays, as a rasterizer draws them into an image.

All rays start in one point, so a ray d hits the triangle (v0, v1, v2) exactly if d lies on the inner side of the three
planes through the sensor and an edge: d . (v0 x v1), d . (v1 x v2) and d . (v2 x v0) have one sign (the edge functions
of Pineda, SIGGRAPH 1988, in the homogeneous form of Olano and Greer, 1997). With d = (cos a, sin a, tan e) for azimuth
a and elevation e, each is linear in two entries of a table of columns, and so is w = n . d / n . v0, the inverse of the
horizontal distance at which the ray meets the triangle's plane: no trigonometry, no division, 16 columns at a time.
Two triangles that share an edge evaluate it to exactly opposite numbers, so no ray slips through between them.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from coopsim.geometry.se3 import Floats
from coopsim.sensors.lidar.triangle_setup import Shapes
from coopsim.sensors.scene import Singles
from coopsim.support.kernels import njit
from coopsim.types import Ints

LANES = 16
"""Columns that are tested together: the grid's width in memory is a multiple of it."""

_AZIMUTH_SLACK_RAD = 2e-5  # twice the error of the shapes' azimuths
_LEAST_NEARNESS_PER_M = 1e-12
_ZERO, _ONE = np.float32(0.0), np.float32(1.0)


class Beams(NamedTuple):
    """Rays of B beams and C columns, from the top beam to the bottom one.

    Attributes:
        tangent: (B,) of the elevation, falling.
        shift_rad: (B,) azimuth offset.
        cos: (C',) of the columns' azimuth, where C' is C rounded up to a multiple of `LANES`; `sin` likewise.
        columns: C.
        order: (B,) each row's index in the beam table.
        exact: tangent (B,), cos and sin of shift_rad (B,), cos and sin of the columns' azimuth (C',), in float64.
    """

    tangent: Singles
    shift_rad: Singles
    cos: Singles
    sin: Singles
    columns: int
    order: Ints
    exact: tuple[Floats, Floats, Floats, Floats, Floats]


class Canvas(NamedTuple):
    """Nearest shapes along the rays of B beams, in W blocks of `LANES` columns.

    Attributes:
        nearness: (B, W * LANES) inverse of the horizontal distance, 1/m; 0 where nothing is.
        owner: (B, W * LANES) row in `Shapes`, -1 where nothing is.
    """

    nearness: Singles
    owner: NDArray[np.int32]


# Contracted to fused multiply-adds, which are as exactly opposite for opposite edges as products are.
@njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"})
def draw(starts: Ints, shapes: Shapes, beams: Beams, blocks: tuple[int, int], canvas: Canvas) -> None:
    """Draw shapes, whose parts begin at `starts` (P + 1,), into the canvas of a half-open range of blocks of `LANES`
    columns.

    Of two shapes that are equally near, the first stays.
    """
    # Local names for the arrays: taking them out of a tuple inside the loop costs reference counting.
    counts, edges, plane, azimuth, rows = shapes.counts, shapes.edges, shapes.plane, shapes.azimuth, shapes.rows
    tangents, shifts, cos, sin, columns = beams.tangent, beams.shift_rad, beams.cos, beams.sin, beams.columns
    nearness, owner = canvas.nearness, canvas.owner
    nearness[:], owner[:] = _ZERO, np.int32(-1)
    for part in range(len(starts) - 1):
        for n in range(starts[part], starts[part] + counts[part]):
            shape = np.int32(n)
            for row in range(rows[n, 0], rows[n, 1]):
                tangent, shift = tangents[row], shifts[row]
                runs = _block_runs(azimuth[n, 0] - shift, azimuth[n, 1] - shift, columns)
                turn = (_ONE, _ZERO)
                if shift != _ZERO:
                    turn = (np.float32(math.cos(shift)), np.float32(math.sin(shift)))
                a0, b0, c0 = _along(edges[n, 0], edges[n, 1], edges[n, 2], turn, tangent)
                a1, b1, c1 = _along(edges[n, 3], edges[n, 4], edges[n, 5], turn, tangent)
                a2, b2, c2 = _along(edges[n, 6], edges[n, 7], edges[n, 8], turn, tangent)
                p, q, r = _along(
                    np.float32(plane[n, 0]), np.float32(plane[n, 1]), np.float32(plane[n, 2]), turn, tangent
                )
                for start, end in runs:
                    for block in range(max(start, blocks[0]), min(end, blocks[1])):
                        # Unsigned: an index that may be negative prevents vectorization.
                        table, place = np.uint64(block * LANES), np.uint64((block - blocks[0]) * LANES)
                        line = np.uint64(row)
                        for lane in range(np.uint64(LANES)):
                            x, y, old = cos[table + lane], sin[table + lane], nearness[line, place + lane]
                            inside = (a0 * x + (b0 * y + c0) >= _ZERO) & (a1 * x + (b1 * y + c1) >= _ZERO)
                            near = p * x + (q * y + r)
                            taken = inside & (a2 * x + (b2 * y + c2) >= _ZERO) & (near > old)
                            nearness[line, place + lane] = near if taken else old
                            owner[line, place + lane] = shape if taken else owner[line, place + lane]


@njit(cache=True, nogil=True, error_model="numpy")
def _along(
    x: np.float32, y: np.float32, z: np.float32, turn: tuple[np.float32, np.float32], tangent: np.float32
) -> tuple[np.float32, np.float32, np.float32]:
    """Return coefficients of (cos a, sin a, 1) for the rays of a beam whose azimuth is a plus the angle of `turn`."""
    cos, sin = turn
    return x * cos + y * sin, y * cos - x * sin, z * tangent


@njit(cache=True, nogil=True, error_model="numpy")
def _block_runs(first_rad: float, last_rad: float, columns: int) -> tuple[tuple[int, int], tuple[int, int]]:
    """Return the blocks with columns between two azimuths as two half-open runs, before and beyond the seam."""
    per_rad = columns / (2 * math.pi)
    slack = _AZIMUTH_SLACK_RAD * per_rad
    first, last = math.ceil(first_rad * per_rad - slack), math.floor(last_rad * per_rad + slack)
    if last < first:
        return (0, 0), (0, 0)  # it lies between two columns
    start = first % columns
    end = min(start + last - first, start + columns - 1)
    beyond = (end - columns) // LANES + 1 if end >= columns else 0
    return (start // LANES, min(end, columns - 1) // LANES + 1), (0, beyond)


@njit(cache=True, nogil=True, error_model="numpy")
def resolve(
    shapes: Shapes,
    beams: Beams,
    blocks: tuple[int, int],
    owner: NDArray[np.int32],
    hits: tuple[Singles, Ints, Singles],
) -> None:
    """Write range (inf for none), face (-1) and cosine of incidence (0) of the drawn shapes into `hits`, each (B, C).

    Rows are in the order of the beam table, columns those of `blocks`. The nearest shape was found in float32; its
    range is computed again in float64, as far away and at grazing incidence float32 would be off by some millimetres.
    """
    range_m, face, cosine = hits
    plane, offset_m, faces = shapes.plane, shapes.offset_m, shapes.face
    tangents, shift_cos, shift_sin, cos, sin = beams.exact
    first = blocks[0] * LANES
    for row in range(len(tangents)):
        beam, tangent, c, s = beams.order[row], tangents[row], shift_cos[row], shift_sin[row]
        stretch = math.sqrt(1.0 + tangent * tangent)
        for column in range(first, min(blocks[1] * LANES, beams.columns)):
            n = owner[row, column - first]
            if n < 0:
                range_m[beam, column], face[beam, column], cosine[beam, column] = np.inf, -1, 0.0
                continue
            x, y = cos[column] * c - sin[column] * s, sin[column] * c + cos[column] * s
            near = max(plane[n, 0] * x + plane[n, 1] * y + plane[n, 2] * tangent, _LEAST_NEARNESS_PER_M)
            range_m[beam, column], face[beam, column] = stretch / near, faces[n]
            cosine[beam, column] = min(offset_m[n] * near / stretch, 1.0)
