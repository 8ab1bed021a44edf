"""Projection into an agent's images: of points, and of boxes as crops (DINO-CoDT, He et al., sec. III-G, eq. 5-6).

The paper projects a box's eight corners into a camera and takes the smallest upright rectangle around them. A box may
reach beyond an image's edges or behind its camera, where corners mean nothing, so here the box is cut by the planes of
the camera's field of view, and the rectangle goes around the rest of it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from coopsim.geometry.boxes import Boxes3D
from coopsim.geometry.se3 import Floats
from coopsim.sensors.camera.intrinsics import distort, undistort
from coopsim.support.arrays import frozen
from coopsim.support.checks import require_positive
from coopsim.types import CameraCalibration, Ints, Mask

LEAST_DEPTH_M = 0.05
"""Depth along the optical axis from which a camera sees anything."""

_REMEMBERED = 256


@dataclass(frozen=True, slots=True, eq=False)
class Projected:
    """N points in an image.

    Attributes:
        place_px: (N, 2) column and row; of no meaning for points that are not inside.
        depth_m: (N,) along the optical axis.
        inside: (N,) the point is in front of the camera and within the edges.
    """

    place_px: Floats
    depth_m: Floats
    inside: NDArray[np.bool_]


@dataclass(frozen=True, slots=True, eq=False)
class ImageBounds:
    """Bounds of an image on the plane z = 1, where straight lines are straight.

    Attributes:
        low: (2,) smallest x and y of any of its rays.
        high: (2,) largest ones.
        farthest: longest distance of any of them from the optical axis: the lens may fold points farther out back into
            the image.
    """

    low: Floats
    high: Floats
    farthest: float


def project(calibration: CameraCalibration, points_m: Floats) -> Projected:
    """Project points (N, 3) m of the agent's base frame into a camera's image.

    Raises:
        InvalidValueError: the points are of another shape, or the distortion folds the image over.
    """
    seen = calibration.base_SE3_camera.inverse().apply(frozen(points_m, (None, 3), np.float64, "points_m"))
    depth_m = seen[:, 2]
    ahead = depth_m > LEAST_DEPTH_M
    flat = seen[:, :2] / np.where(ahead, depth_m, 1.0)[:, None]
    if calibration.distortion.any():
        ahead &= np.hypot(*flat.T) <= image_bounds(calibration).farthest
    place_px = places_px(calibration, flat)
    rows, columns = calibration.size
    inside = ahead & (np.abs(place_px - [(columns - 1) / 2, (rows - 1) / 2]) <= [columns / 2, rows / 2]).all(1)
    return Projected(place_px, depth_m, inside)


def places_px(calibration: CameraCalibration, flat: Floats) -> Floats:
    """Return columns and rows (N, 2) of points (N, 2) of the plane z = 1 of the camera's frame."""
    lens, folds = calibration.matrix, calibration.distortion
    if folds.any():
        k1, k2, p1, p2, k3 = folds.tolist()
        flat = distort(flat, (k1, k2, p1, p2, k3))
    place_px: Floats = flat @ lens[:2, :2].T + lens[:2, 2]
    return place_px


def image_bounds(calibration: CameraCalibration) -> ImageBounds:
    """Return the bounds of a camera's image, found once for each lens; raise if the distortion folds the image over."""
    return _bounds(tuple(calibration.size), calibration.matrix.tobytes(), calibration.distortion.tobytes())


@lru_cache(_REMEMBERED)
def _bounds(size: tuple[int, int], matrix: bytes, distortion: bytes) -> ImageBounds:
    lens, folds = np.frombuffer(matrix).reshape(3, 3), np.frombuffer(distortion)
    rows, columns = size
    u, v = np.arange(columns + 1) - 0.5, np.arange(rows + 1) - 0.5
    edge = np.concatenate(
        [np.column_stack([u, np.full(len(u), end)]) for end in (v[0], v[-1])]
        + [np.column_stack([np.full(len(v), end), v]) for end in (u[0], u[-1])]
    )
    flat = (edge - lens[:2, 2]) @ np.linalg.inv(lens[:2, :2]).T
    k1, k2, p1, p2, k3 = folds.tolist()
    flat = undistort(flat, (k1, k2, p1, p2, k3))
    return ImageBounds(flat.min(axis=0), flat.max(axis=0), float(np.hypot(*flat.T).max()))


LEAST_AREA_PX = 32.0
"""Pixels from which a rectangle shows more than a stain: a person at 24 m in an image of a named rig."""

_BOTTOM = [(0, 1), (1, 2), (2, 3), (3, 0)]
_EDGES = np.array([*_BOTTOM, *((a + 4, b + 4) for a, b in _BOTTOM), *((k, k + 4) for k in range(4))])
_BENT_STEPS = 9


@dataclass(frozen=True, slots=True, eq=False)
class Crops:
    """Rectangles of N boxes in the images of one agent.

    Attributes:
        camera: (N,) number of the camera, in the order of the given ones; -1: no image shows enough of the box.
        place_px: (N, 4) first column, first row, last column and last row, edges of the rectangle as real numbers: the
            pixel (u, v) reaches from u - 0.5 to u + 0.5. NaN without a camera.
    """

    camera: Ints
    place_px: Floats

    @property
    def known(self) -> Mask:
        """Mask (N,) of boxes that an image shows."""
        return self.camera >= 0


def best_crops(cameras: Mapping[str, CameraCalibration], boxes: Boxes3D, least_area_px: float = LEAST_AREA_PX) -> Crops:
    """Find the crop of each box of the agent's base frame: in the image that shows the largest rectangle of it.

    The largest has the most pixels, and is mostly the one that is not cut by the image's edge. Vectors of all crops
    could be averaged instead: that would cost a network's work for each of them, to add what neighbouring cameras show
    of the same side, cut off. Raises where a lens folds its image over.
    """
    require_positive(least_area_px=least_area_px)
    if not cameras or not len(boxes):
        return Crops(np.full(len(boxes), -1), np.full((len(boxes), 4), np.nan))
    shown_px = rectangles(tuple(cameras.values()), boxes)
    area = np.nan_to_num((shown_px[..., 2:] - shown_px[..., :2]).prod(axis=-1))
    camera, box = area.argmax(axis=0), np.arange(len(boxes))
    enough = area[camera, box] >= least_area_px
    return Crops(np.where(enough, camera, -1), np.where(enough[:, None], shown_px[camera, box], np.nan))


def rectangles(cameras: Sequence[CameraCalibration], boxes: Boxes3D) -> Floats:
    """Return the smallest upright rectangles (C, N, 4) around the visible parts of N boxes of the agent's base frame.

    Exact for a pinhole. With a lens that distorts, edges of boxes are bent: points along them stand for them. Columns
    are as in `Crops`; NaN for boxes outside the image.
    """
    bounds = [image_bounds(camera) for camera in cameras]
    low, high = (np.stack([getattr(each, name) for each in bounds]) for name in ("low", "high"))
    turn = np.stack([camera.base_SE3_camera.rotation for camera in cameras])  # (C, 3, 3)
    eye = np.stack([camera.base_SE3_camera.translation for camera in cameras])
    corners = (boxes.corners - eye[:, None, None]) @ turn[:, None]  # (C, N, 8, 3)
    bent = any(camera.distortion.any() for camera in cameras)
    along, kept = _cut_edges(corners, low, high, _BENT_STEPS if bent else 2)
    rays, met = _image_corners(turn, eye, boxes, low, high)
    points = np.concatenate([along, np.broadcast_to(rays[:, None], (*met.shape, 3))], axis=2)
    shown = np.concatenate([kept, met], axis=2)
    flat = points[..., :2] / np.where(shown, points[..., 2], 1.0)[..., None]
    found = np.empty((len(cameras), len(boxes), 4))
    for camera, bound, place, visible, out in zip(cameras, bounds, flat, shown, found, strict=True):
        if camera.distortion.any():
            visible &= np.hypot(place[..., 0], place[..., 1]) <= bound.farthest + 1e-9
        rows, columns = camera.size
        px = np.clip(places_px(camera, place.reshape(-1, 2)), -0.5, [columns - 0.5, rows - 0.5]).reshape(place.shape)
        out[:, :2] = np.where(visible[..., None], px, np.inf).min(axis=1, initial=np.inf)
        out[:, 2:] = np.where(visible[..., None], px, -np.inf).max(axis=1, initial=-np.inf)
    found[~(found[..., :2] < found[..., 2:]).all(axis=-1)] = np.nan
    return found


def hidden_shares(crops: Crops, away_m: Floats) -> Floats:
    """Return the share (N,) of each box's rectangle that the rectangle of one nearer box in the same image covers.

    Rectangles reach beyond their boxes, so it is a bound: where it is large, the crop may show something else. `away_m`
    (N,) is the boxes' distance.
    """
    low, high = crops.place_px[:, :2], crops.place_px[:, 2:]
    both = np.minimum(high[:, None], high) - np.maximum(low[:, None], low)
    front = (away_m < away_m[:, None]) & (crops.camera == crops.camera[:, None]) & crops.known
    area = (high - low).prod(axis=1)
    covered = np.where(front, np.maximum(both, 0).prod(axis=-1), 0.0).max(axis=1, initial=0.0)
    share: Floats = np.where(crops.known, covered / np.where(crops.known, area, 1.0), 0.0)
    return share


def _cut_edges(corners: Floats, low: Floats, high: Floats, steps: int) -> tuple[Floats, Mask]:
    """Cut the edges of boxes, by corners (C, N, 8, 3) in the cameras' frames, by the five planes of the field of view.

    `low` and `high` (C, 2) bound each image on the plane z = 1. Returns S `steps` points on the rest of each edge (C,
    N, 12 S, 3), and a mask (C, N, 12 S) of edges of which anything is left.
    """
    xy, z = corners[..., :2], corners[..., 2:]
    low, high = low[:, None, None], high[:, None, None]
    inward = np.concatenate([z - LEAST_DEPTH_M, xy - low * z, high * z - xy], axis=-1)
    first, last = inward[:, :, _EDGES[:, 0]], inward[:, :, _EDGES[:, 1]]  # (C, N, 12, 5): >= 0 on the inner side
    with np.errstate(divide="ignore", invalid="ignore"):  # an edge along a plane is not cut by it
        cut = first / (first - last)
    begin = np.where((first < 0) & (last >= 0), cut, 0.0).max(axis=-1)
    end = np.where((first >= 0) & (last < 0), cut, 1.0).min(axis=-1)
    kept = (begin <= end) & ~((first < 0) & (last < 0)).any(axis=-1)
    share = begin[..., None] + np.linspace(0, 1, steps) * (end - begin)[..., None]  # (C, N, 12, S)
    start, stop = corners[:, :, _EDGES[:, 0], None], corners[:, :, _EDGES[:, 1], None]
    points = start + share[..., None] * (stop - start)
    return points.reshape(*corners.shape[:2], len(_EDGES) * steps, 3), np.repeat(kept, steps, axis=-1)


def _image_corners(turn: Floats, eye: Floats, boxes: Boxes3D, low: Floats, high: Floats) -> tuple[Floats, Mask]:
    """Return the rays (C, 4, 3) through images' corners, in the cameras' frames, and the mask (C, N, 4) of boxes they
    meet.

    A box so near that none of its edges is in the image still fills it. Cameras are at `eye` (C, 3) with rotations
    `turn` (C, 3, 3) in the base frame; `low` and `high` (C, 2) bound each image on the plane z = 1.
    """
    rays = np.ones((len(turn), 4, 3))
    rays[:, :, 0] = np.stack([low[:, 0], high[:, 0], high[:, 0], low[:, 0]], axis=1)
    rays[:, :, 1] = np.stack([low[:, 1], low[:, 1], high[:, 1], high[:, 1]], axis=1)
    cos, sin = np.cos(boxes.yaw), np.sin(boxes.yaw)
    to_box = np.zeros((len(boxes), 3, 3))  # to be multiplied from the right
    to_box[:, 0, 0], to_box[:, 1, 0], to_box[:, 0, 1], to_box[:, 1, 1], to_box[:, 2, 2] = cos, sin, -sin, cos, 1.0
    start = (eye[:, None] - boxes.center)[:, :, None] @ to_box  # (C, N, 1, 3)
    way = (rays @ turn.swapaxes(1, 2))[:, None] @ to_box  # (C, N, 4, 3)
    way = np.where(np.abs(way) < 1e-12, 1e-12, way)
    half = boxes.size[:, None] / 2
    sides = np.stack([(-half - start) / way, (half - start) / way])
    enter, leave = sides.min(axis=0).max(axis=-1), sides.max(axis=0).min(axis=-1)
    met: Mask = (enter <= leave) & (leave > LEAST_DEPTH_M)
    return rays, met
