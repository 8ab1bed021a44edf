"""Selects the triangles that rays of a spinning LiDAR may hit, and prepares them for `raster_kernel`."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from coopsim.geometry.se3 import Floats
from coopsim.sensors.scene import Parts, Singles
from coopsim.support.kernels import njit
from coopsim.types import Ints

_Vector = tuple[float, float, float]

_WIDEST_RAD = np.float32(3.1)  # a triangle off the axis spans less than half a turn; a nearly half turn may be on it
_AXIS_M2 = 1e-6  # a corner within a millimetre of the axis has no azimuth
_PLANE_M = 1e-7  # a sensor within 0.1 um of a triangle's plane sees its edge
_SLOPE_SLACK = np.float32(1e-5)
_ZERO, _ONE, _TURN = np.float32(0.0), np.float32(1.0), np.float32(2 * math.pi)


class Scene(NamedTuple):
    """Scene of F triangles in P parts, and the sensor's pose: axes as columns (3, 3) and origin (3,) m, world frame."""

    vertices: Floats
    faces: Ints
    parts: Parts
    rotation: Floats
    origin: Floats


class Corners(NamedTuple):
    """Vertices (V, 3) m in the sensor's frame, their azimuths (V,) to 1e-5 rad, and slopes (V,): tangents of
    elevations.
    """

    local: Floats
    azimuth: Singles
    slope: Singles


class Shapes(NamedTuple):
    """Triangles prepared for drawing: those of each part that may be hit, from the row of its first face on.

    Attributes:
        counts: (P,) number of each part's.
        edges: (F, 9) coefficients of cos a, sin a and tan e in three edge functions.
        plane: (F, 3) float64, coefficients of the inverse horizontal distance.
        offset_m: (F,) distance of the sensor from the plane.
        azimuth: (F, 2) first and last, rad.
        rows: (F, 2) first beam, and last beam + 1.
        face: (F,) index into the scene's faces.
    """

    counts: Ints
    edges: Singles
    plane: Floats
    offset_m: Singles
    azimuth: Singles
    rows: NDArray[np.int32]
    face: Ints


@njit(cache=True, nogil=True, error_model="numpy")
def _azimuth(x: np.float32, y: np.float32) -> np.float32:
    """Return atan2(y, x), rad, to 1e-5, by a polynomial that vectorizes (Abramowitz and Stegun 4.4.47)."""
    wide, deep = abs(x), abs(y)
    ratio = min(wide, deep) / max(max(wide, deep), np.float32(1e-20))
    q = ratio * ratio
    tail = np.float32(0.1801410) + q * (np.float32(-0.0851330) + q * np.float32(0.0208351))
    angle = ratio * (np.float32(0.9998660) + q * (np.float32(-0.3302995) + q * tail))
    angle = np.float32(math.pi / 2) - angle if deep > wide else angle
    angle = np.float32(math.pi) - angle if x < _ZERO else angle
    return -angle if y < _ZERO else angle


@njit(cache=True, nogil=True, error_model="numpy")
def _place(scene: Scene, local: Floats) -> None:
    """Write the vertices in the sensor's frame into `local` (V, 3)."""
    vertices, rotation, origin = scene.vertices, scene.rotation, scene.origin
    for v in range(len(vertices)):
        x, y, z = vertices[v, 0] - origin[0], vertices[v, 1] - origin[1], vertices[v, 2] - origin[2]
        for axis in range(3):
            local[v, axis] = rotation[0, axis] * x + rotation[1, axis] * y + rotation[2, axis] * z


@njit(cache=True, nogil=True, error_model="numpy")
def _aim(corners: Corners, first: int, last: int) -> None:
    """Write azimuths and slopes of vertices `first` to `last`."""
    local, azimuth, slope = corners.local, corners.azimuth, corners.slope
    for v in range(first, last):
        x32, y32 = np.float32(local[v, 0]), np.float32(local[v, 1])
        azimuth[v] = _azimuth(x32, y32)
        slope[v] = np.float32(local[v, 2]) / max(np.sqrt(x32 * x32 + y32 * y32), np.float32(1e-6))


@njit(cache=True, nogil=True, error_model="numpy")
def _outline(local: Floats, first: int, last: int) -> tuple[float, float, float]:
    """Bound vertices `first` to `last` by an upright box: return the sensor's distance from it (m, 0 inside), and
    middle and half width (rad) of the azimuths of the cylinder around it.
    """
    low_x, low_y, low_z, high_x, high_y, high_z = np.inf, np.inf, np.inf, -np.inf, -np.inf, -np.inf
    for v in range(first, last):
        low_x, high_x = min(low_x, local[v, 0]), max(high_x, local[v, 0])
        low_y, high_y = min(low_y, local[v, 1]), max(high_y, local[v, 1])
        low_z, high_z = min(low_z, local[v, 2]), max(high_z, local[v, 2])
    ahead_m, aside_m, above_m = max(low_x, -high_x, 0.0), max(low_y, -high_y, 0.0), max(low_z, -high_z, 0.0)
    away_m = math.sqrt(ahead_m * ahead_m + aside_m * aside_m + above_m * above_m)
    x, y = (low_x + high_x) / 2, (low_y + high_y) / 2
    distance, radius = math.hypot(x, y), math.hypot(high_x - low_x, high_y - low_y) / 2
    if not distance > radius:
        return away_m, 0.0, math.pi
    return away_m, math.atan2(y, x), math.asin(radius / distance)


@njit(cache=True, nogil=True, error_model="numpy")
def _reaches(middle: float, half: float, sector: tuple[float, float]) -> bool:
    """Return whether azimuths, given by middle and half width, overlap a sector, given likewise."""
    apart = middle - sector[0]
    return bool(abs(apart - 2 * math.pi * np.rint(apart / (2 * math.pi))) <= half + sector[1])


@njit(cache=True, nogil=True, error_model="numpy")
def _cross(p: _Vector, q: _Vector) -> _Vector:
    return p[1] * q[2] - p[2] * q[1], p[2] * q[0] - p[0] * q[2], p[0] * q[1] - p[1] * q[0]


@njit(cache=True, nogil=True, error_model="numpy")
def _dot(p: _Vector, q: _Vector) -> float:
    return p[0] * q[0] + p[1] * q[1] + p[2] * q[2]


@njit(cache=True, nogil=True, error_model="numpy")
def _less(p: _Vector, q: _Vector) -> _Vector:
    return p[0] - q[0], p[1] - q[1], p[2] - q[2]


@njit(cache=True, nogil=True, error_model="numpy")
def _is_on_axis(p0: _Vector, p1: _Vector, p2: _Vector, turn: _Vector) -> bool:
    """Return whether the sensor's axis meets a triangle or nearly a corner; `turn` has each edge's sense about it."""
    nearest_m2 = min(p0[0] * p0[0] + p0[1] * p0[1], p1[0] * p1[0] + p1[1] * p1[1], p2[0] * p2[0] + p2[1] * p2[1])
    left, right = turn[0] >= 0.0, turn[0] <= 0.0
    for way in turn[1:]:
        left, right = left and way >= 0.0, right and way <= 0.0
    return left or right or nearest_m2 < _AXIS_M2


@njit(cache=True, nogil=True, error_model="numpy")
def _first_not_above(tangent: Singles, slope: np.float32) -> int:
    """Return the first row of falling tangents that is not above a slope."""
    low, high = 0, len(tangent)
    while low < high:
        middle = (low + high) // 2
        if tangent[middle] > slope:
            low = middle + 1
        else:
            high = middle
    return low


@njit(cache=True, nogil=True, error_model="numpy")
def _span(
    azimuth: tuple[np.float32, np.float32, np.float32], slope: tuple[np.float32, np.float32, np.float32], on_axis: bool
) -> tuple[np.float32, np.float32, np.float32, np.float32]:
    """Return first and last azimuth (rad), lowest and highest slope of a triangle, by its corners' azimuths and slopes.

    An edge's slope over azimuth is a sinusoid: between two corners above the horizon it rises to at most their slope
    divided by the cosine of half the angle between them.
    """
    low, high = min(slope[0], min(slope[1], slope[2])), max(slope[0], max(slope[1], slope[2]))
    left, right = azimuth[1] - azimuth[0], azimuth[2] - azimuth[0]
    left -= _TURN * np.float32(np.rint(left / _TURN))
    right -= _TURN * np.float32(np.rint(right / _TURN))
    first, last = min(_ZERO, min(left, right)), max(_ZERO, max(left, right))
    width = last - first
    if on_axis or width > _WIDEST_RAD:
        first, last, bulge = _ZERO, _TURN, np.float32(np.inf)
    elif width < _ONE:
        bulge = _ONE + np.float32(0.15) * width * width
    else:
        bulge = np.float32(1.0 / math.cos(0.5 * width))
    high = high * bulge if high > _ZERO else high
    low = low * bulge if low < _ZERO else low
    return azimuth[0] + first, azimuth[0] + last, low, high


@njit(cache=True, nogil=True, error_model="numpy")
def set_up(
    scene: Scene, tangent: Singles, sector: tuple[float, float], reach_m: float, corners: Corners, shapes: Shapes
) -> None:
    """Fill `corners` and `shapes` with all that `draw` needs of the triangles that may hit a ray.

    Beams have the tangents (B,), falling. The azimuths of the rays are a sector, by middle and half width (rad). Parts
    beyond `reach_m` are left out.
    """
    faces, parts = scene.faces, scene.parts
    local, azimuth, slope = corners.local, corners.azimuth, corners.slope
    edges, plane, offset_m = shapes.edges, shapes.plane, shapes.offset_m
    bounds, rows, owner = shapes.azimuth, shapes.rows, shapes.face
    _place(scene, local)
    for part in range(len(parts.closed)):
        n = parts.face_start[part]
        shapes.counts[part] = 0
        first_vertex, last_vertex = parts.vertex_start[part], parts.vertex_start[part + 1]
        away_m, middle, half = _outline(local, first_vertex, last_vertex)
        if away_m > reach_m or not _reaches(middle, half, sector):
            continue
        _aim(corners, first_vertex, last_vertex)
        outer_only = parts.closed[part] and away_m > 0.0
        for f in range(parts.face_start[part], parts.face_start[part + 1]):
            i, j, k = faces[f, 0], faces[f, 1], faces[f, 2]
            p0 = (local[i, 0], local[i, 1], local[i, 2])
            p1 = (local[j, 0], local[j, 1], local[j, 2])
            p2 = (local[k, 0], local[k, 1], local[k, 2])
            # Products of two corners, not of differences: a neighbouring triangle has the same two corners in reverse,
            # so exactly the opposite product.
            a = _cross(p1, p2)
            volume = _dot(p0, a)
            if outer_only and volume > 0.0:
                continue
            b, c = _cross(p2, p0), _cross(p0, p1)
            on_axis = _is_on_axis(p0, p1, p2, (a[2], b[2], c[2]))
            first, last, low, high = _span(
                (azimuth[i], azimuth[j], azimuth[k]), (slope[i], slope[j], slope[k]), on_axis
            )
            if not _reaches(float(first + last) / 2, float(last - first) / 2, sector):
                continue
            top = _first_not_above(tangent, high + _SLOPE_SLACK * (_ONE + abs(high)))
            bottom = _first_not_above(tangent, low - _SLOPE_SLACK * (_ONE + abs(low)))
            if top >= bottom:
                continue
            normal = _cross(_less(p1, p0), _less(p2, p0))
            offset, length = _dot(p0, normal), math.sqrt(_dot(normal, normal))
            if not abs(offset) > _PLANE_M * length:
                continue
            sign = math.copysign(1.0, volume)
            for axis in range(3):
                edges[n, axis], edges[n, 3 + axis], edges[n, 6 + axis] = sign * a[axis], sign * b[axis], sign * c[axis]
                plane[n, axis] = normal[axis] / offset
            offset_m[n], owner[n] = abs(offset) / length, f
            bounds[n, 0], bounds[n, 1], rows[n, 0], rows[n, 1] = first, last, top, bottom
            n += 1
        shapes.counts[part] = n - parts.face_start[part]
