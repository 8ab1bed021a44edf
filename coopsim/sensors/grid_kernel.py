"""Triangles drawn into the grid of a spinning LiDAR's rays, as a rasterizer draws them into an image.

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
from numba import njit
from numpy.typing import NDArray

from coopsim.geometry.se3 import Floats
from coopsim.sensors.geometry import Parts
from coopsim.sensors.grid_shapes import Corners, Shapes, Singles, set_up
from coopsim.types import Ints

LANES = 16
"""Columns that are tested together: the grid's width in memory is a multiple of it."""

_AZIMUTH_SLACK_RAD = 2e-5  # twice the error of the shapes' azimuths
_SECTOR_SLACK_RAD = 1e-3
_NEVER = 1e-12  # 1/m: what is drawn is nearer than that
_ZERO, _ONE = np.float32(0.0), np.float32(1.0)


class Beams(NamedTuple):
    """The rays of B beams and C columns, from the top beam to the bottom one.

    Attributes:
        tangent: (B,) of the elevation, falling.
        shift_rad: (B,) azimuth offset.
        cos: (C',) of the columns' azimuth, where C' is C rounded up to a multiple of `LANES`.
        sin: (C',) of the columns' azimuth.
        columns: C.
        exact: tangent (B,), cos and sin of shift_rad (B,), cos and sin of the columns' azimuth (C,), in float64.
    """

    tangent: Singles
    shift_rad: Singles
    cos: Singles
    sin: Singles
    columns: int
    exact: tuple[Floats, Floats, Floats, Floats, Floats]


@njit(cache=True, nogil=True)
def sweep_sector(
    scene: tuple[Corners, Ints, Parts],
    beams: Beams,
    order: Ints,
    blocks: tuple[int, int],
    hits: tuple[Singles, Ints, Singles],
) -> None:
    """Set up, draw and resolve one sector; calls for distinct ones may run at once.

    Args:
        scene: vertices, faces (F, 3) and parts.
        beams: the rays.
        order: (B,) each row's place in the beam table.
        blocks: of `LANES` columns, from the first to before the last.
        hits: range (m, inf where nothing was hit), face (-1) and cosine of incidence (0), each (B, C) in the order of
            the beam table, out.
    """
    corners, faces, parts = scene
    step_rad = 2 * math.pi / beams.columns
    start = blocks[0] * LANES * step_rad + float(beams.shift_rad.min())
    end = blocks[1] * LANES * step_rad + float(beams.shift_rad.max())
    sector = ((start + end) / 2, (end - start) / 2 + _SECTOR_SLACK_RAD)
    shapes, count = set_up(corners, faces, parts, beams.tangent, sector)
    owner = draw(shapes, count, beams, blocks)
    resolve(shapes, beams, order, (blocks[0] * LANES, min(blocks[1] * LANES, beams.columns)), owner, hits)


# Contracted to fused multiply-adds, which are as exactly opposite for opposite edges as products are.
@njit(cache=True, nogil=True, fastmath={"contract"})
def draw(shapes: Shapes, count: int, beams: Beams, blocks: tuple[int, int]) -> NDArray[np.int32]:
    """Draw shapes into blocks of `LANES` columns, from the first to before the last of `blocks`.

    Args:
        shapes: as `set_up` made them; of two that are equally near, the first stays.
        count: how many there are.
        beams: the rays.
        blocks: the part of the grid to draw, W blocks wide.

    Returns:
        For each ray (B, W * LANES), which of the shapes it meets, or -1.
    """
    # Names for the arrays: taking them out of a tuple in a loop counts references, in turn with all other threads.
    edges, plane, azimuth, rows = shapes.edges, shapes.plane, shapes.azimuth, shapes.rows
    tangents, shifts, cos, sin, columns = beams.tangent, beams.shift_rad, beams.cos, beams.sin, beams.columns
    width = (blocks[1] - blocks[0]) * LANES
    nearness, owner = np.zeros((len(tangents), width), np.float32), np.full((len(tangents), width), np.int32(-1))
    for n in range(count):
        shape = np.int32(n)
        for row in range(rows[n, 0], rows[n, 1]):
            tangent, shift = tangents[row], shifts[row]
            runs = _runs(azimuth[n, 0] - shift, azimuth[n, 1] - shift, columns)
            turn = (_ONE, _ZERO)
            if shift != _ZERO:
                turn = (np.float32(math.cos(shift)), np.float32(math.sin(shift)))
            a0, b0, c0 = _along(edges[n, 0], edges[n, 1], edges[n, 2], turn, tangent)
            a1, b1, c1 = _along(edges[n, 3], edges[n, 4], edges[n, 5], turn, tangent)
            a2, b2, c2 = _along(edges[n, 6], edges[n, 7], edges[n, 8], turn, tangent)
            p, q, r = _along(np.float32(plane[n, 0]), np.float32(plane[n, 1]), np.float32(plane[n, 2]), turn, tangent)
            for start, end in runs:
                for block in range(max(start, blocks[0]), min(end, blocks[1])):
                    # Unsigned, as an index that may be negative keeps this from being vectorized.
                    table, place, line = (
                        np.uint64(block * LANES),
                        np.uint64((block - blocks[0]) * LANES),
                        np.uint64(row),
                    )
                    for lane in range(np.uint64(LANES)):
                        x, y, old = cos[table + lane], sin[table + lane], nearness[line, place + lane]
                        inside = (a0 * x + (b0 * y + c0) >= _ZERO) & (a1 * x + (b1 * y + c1) >= _ZERO)
                        near = p * x + (q * y + r)
                        taken = inside & (a2 * x + (b2 * y + c2) >= _ZERO) & (near > old)
                        nearness[line, place + lane] = near if taken else old
                        owner[line, place + lane] = shape if taken else owner[line, place + lane]
    return owner


@njit(cache=True, nogil=True)
def _along(
    x: np.float32, y: np.float32, z: np.float32, turn: tuple[np.float32, np.float32], tangent: np.float32
) -> tuple[np.float32, np.float32, np.float32]:
    """Coefficients of (cos a, sin a, 1) for the rays of a beam, whose azimuth is a plus the angle of `turn`."""
    cos, sin = turn
    return x * cos + y * sin, y * cos - x * sin, z * tangent


@njit(cache=True, nogil=True)
def _runs(first_rad: float, last_rad: float, columns: int) -> tuple[tuple[int, int], tuple[int, int]]:
    """Blocks with columns between two azimuths, up to and beyond the seam: first and behind the last, of each."""
    per_rad = columns / (2 * math.pi)
    slack = _AZIMUTH_SLACK_RAD * per_rad
    first, last = math.ceil(first_rad * per_rad - slack), math.floor(last_rad * per_rad + slack)
    if last < first:
        return (0, 0), (0, 0)  # it lies between two columns
    start = first % columns
    end = min(start + last - first, start + columns - 1)
    beyond = (end - columns) // LANES + 1 if end >= columns else 0
    return (start // LANES, min(end, columns - 1) // LANES + 1), (0, beyond)


@njit(cache=True, nogil=True)
def resolve(
    shapes: Shapes,
    beams: Beams,
    order: Ints,
    columns: tuple[int, int],
    owner: NDArray[np.int32],
    hits: tuple[Singles, Ints, Singles],
) -> None:
    """From what was drawn to `hits`, as `sweep_sector` says.

    Who is nearest was found in float32; how near is computed once more, as far away and at grazing incidence that would
    be some millimetres off.

    Args:
        shapes: that were drawn.
        beams: the rays.
        order: (B,) each row's place in the beam table.
        columns: the first and the one behind the last to do.
        owner: (B, W * LANES) as `draw` returned it, of which the first column is the first to do.
        hits: out.
    """
    range_m, face, cosine = hits
    plane, offset_m, faces = shapes.plane, shapes.offset_m, shapes.face
    tangents, shift_cos, shift_sin, cos, sin = beams.exact
    for row in range(len(order)):
        beam, tangent, c, s = order[row], tangents[row], shift_cos[row], shift_sin[row]
        stretch = math.sqrt(1.0 + tangent * tangent)
        for column in range(columns[0], columns[1]):
            n = owner[row, column - columns[0]]
            if n < 0:
                range_m[beam, column], face[beam, column], cosine[beam, column] = np.inf, -1, 0.0
                continue
            x, y = cos[column] * c - sin[column] * s, sin[column] * c + cos[column] * s
            near = max(plane[n, 0] * x + plane[n, 1] * y + plane[n, 2] * tangent, _NEVER)
            range_m[beam, column], face[beam, column] = stretch / near, faces[n]
            cosine[beam, column] = min(offset_m[n] * near / stretch, 1.0)
