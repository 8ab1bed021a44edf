"""Crops: the parts of an agent's pictures that show its boxes (DINO-CoDT, He et al., sec. III-G, eq. 5-6).

The paper projects a box's eight corners into a camera and takes the smallest upright rectangle around them. A box may
reach beyond a picture's edges or behind its camera, where corners mean nothing, so here the box is cut by the planes of
what the camera sees, and the rectangle goes around what is left of it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from coopsim.geometry.boxes import Boxes3D
from coopsim.geometry.se3 import Floats
from coopsim.sensors.camera.projection import LEAST_DEPTH_M, PictureBounds, picture_bounds, places_px
from coopsim.support.checks import require_positive
from coopsim.types import CameraCalibration, Ints, Mask

LEAST_AREA_PX = 32.0
"""Pixels from which a rectangle shows more than a stain: a person at 24 m in a picture of a named rig."""

_BOTTOM = [(0, 1), (1, 2), (2, 3), (3, 0)]
_EDGES = np.array([*_BOTTOM, *((a + 4, b + 4) for a, b in _BOTTOM), *((k, k + 4) for k in range(4))])
_BENT_STEPS = 9


@dataclass(frozen=True, slots=True, eq=False)
class Crops:
    """Where the pictures of one agent show its N boxes.

    Attributes:
        camera: (N,) number of the camera, in the order of the given ones; -1: no picture shows enough of the box.
        place_px: (N, 4) first column, first row, last column and last row, edges of the rectangle as real numbers: the
            pixel (u, v) reaches from u - 0.5 to u + 0.5. NaN without a camera.
    """

    camera: Ints
    place_px: Floats

    @property
    def known(self) -> Mask:
        """Mask (N,) of boxes that a picture shows."""
        return self.camera >= 0


def best_crops(cameras: Mapping[str, CameraCalibration], boxes: Boxes3D, least_area_px: float = LEAST_AREA_PX) -> Crops:
    """Find the crop of each box: in the picture that shows the largest rectangle of it.

    The largest has the most pixels, and is mostly the one that is not cut by the picture's edge. Vectors of all crops
    could be averaged instead: that would cost a network's work for each of them, to add what neighbouring cameras show
    of the same side, cut off.

    Args:
        cameras: by name.
        boxes: N, in the agent's base frame.
        least_area_px: area of the smallest crop, in pixels.

    Raises:
        InvalidValueError: the area is not positive, or a lens folds its picture over.
    """
    require_positive(least_area_px=least_area_px)
    camera, place_px = np.full(len(boxes), -1), np.full((len(boxes), 4), np.nan)
    largest = np.full(len(boxes), np.nextafter(least_area_px, 0))
    for number, calibration in enumerate(cameras.values()):
        shown_px = rectangles(calibration, boxes)
        area = (shown_px[:, 2] - shown_px[:, 0]) * (shown_px[:, 3] - shown_px[:, 1])
        better = area > largest  # not where it is NaN
        camera[better], place_px[better], largest[better] = number, shown_px[better], area[better]
    return Crops(camera, place_px)


def rectangles(calibration: CameraCalibration, boxes: Boxes3D) -> Floats:
    """Return the smallest upright rectangles around what a picture shows of boxes.

    Exact for a pinhole. With a lens that distorts, edges of boxes are bent: points along them stand for them.

    Args:
        calibration: of the camera.
        boxes: N, in the agent's base frame.

    Returns:
        (N, 4) first column, first row, last column, last row, as of `Crops`; NaN for boxes outside the picture.
    """
    bounds, bent = picture_bounds(calibration), bool(calibration.distortion.any())
    camera_SE3_base = calibration.base_SE3_camera.inverse()
    corners = camera_SE3_base.apply(boxes.corners.reshape(-1, 3)).reshape(-1, 8, 3)
    along, kept = _cut_edges(corners, bounds, _BENT_STEPS if bent else 2)
    rays, met = _picture_corners(calibration, boxes, bounds)
    points = np.concatenate([along, np.broadcast_to(rays, (len(boxes), 4, 3))], axis=1)
    shown = np.concatenate([kept, met], axis=1)
    flat = points[..., :2] / np.where(shown, points[..., 2], 1.0)[..., None]
    if bent:
        shown &= np.hypot(flat[..., 0], flat[..., 1]) <= bounds.farthest + 1e-9
    place_px = places_px(calibration, flat.reshape(-1, 2)).reshape(flat.shape)
    rows, columns = calibration.size
    place_px = np.clip(place_px, -0.5, [columns - 0.5, rows - 0.5])
    low = np.where(shown[..., None], place_px, np.inf).min(axis=1, initial=np.inf)
    high = np.where(shown[..., None], place_px, -np.inf).max(axis=1, initial=-np.inf)
    found = np.concatenate([low, high], axis=1)
    found[~(low < high).all(axis=1)] = np.nan
    return found


def _cut_edges(corners: Floats, bounds: PictureBounds, steps: int) -> tuple[Floats, Mask]:
    """Cut the edges of boxes by the five planes of what a camera sees.

    Args:
        corners: (N, 8, 3) in the camera's frame.
        bounds: of its picture.
        steps: S, points along each edge.

    Returns:
        Points on what is left of the edges (N, 12 S, 3), and whether anything is left (N, 12 S).
    """
    x, y, z = np.moveaxis(corners, -1, 0)
    (left, top), (right, bottom) = bounds.low, bounds.high
    inward = np.stack([z - LEAST_DEPTH_M, x - left * z, right * z - x, y - top * z, bottom * z - y], axis=-1)
    first, last = inward[:, _EDGES[:, 0]], inward[:, _EDGES[:, 1]]  # (N, 12, 5): >= 0 on the inner side
    with np.errstate(divide="ignore", invalid="ignore"):  # an edge along a plane is not cut by it
        cut = first / (first - last)
    begin = np.where((first < 0) & (last >= 0), cut, 0.0).max(axis=-1)
    end = np.where((first >= 0) & (last < 0), cut, 1.0).min(axis=-1)
    kept = (begin <= end) & ~((first < 0) & (last < 0)).any(axis=-1)
    share = begin[..., None] + np.linspace(0, 1, steps) * (end - begin)[..., None]  # (N, 12, S)
    start, stop = corners[:, _EDGES[:, 0], None], corners[:, _EDGES[:, 1], None]
    points = start + share[..., None] * (stop - start)
    return points.reshape(len(corners), len(_EDGES) * steps, 3), np.repeat(kept, steps, axis=1)


def _picture_corners(calibration: CameraCalibration, boxes: Boxes3D, bounds: PictureBounds) -> tuple[Floats, Mask]:
    """Return the rays through a picture's corners, (4, 3) in the camera's frame, and which boxes they meet (N, 4).

    A box so near that none of its edges is in the picture still fills it.
    """
    (left, top), (right, bottom) = bounds.low, bounds.high
    rays = np.array([[left, top, 1.0], [right, top, 1.0], [right, bottom, 1.0], [left, bottom, 1.0]])
    ways, eye = rays @ calibration.base_SE3_camera.rotation.T, calibration.base_SE3_camera.translation
    cos, sin = np.cos(boxes.yaw), np.sin(boxes.yaw)
    base_to_box = np.zeros((len(boxes), 3, 3))
    base_to_box[:, 0, 0], base_to_box[:, 0, 1], base_to_box[:, 1, 0], base_to_box[:, 1, 1] = cos, sin, -sin, cos
    base_to_box[:, 2, 2] = 1.0
    start = np.einsum("nij,nj->ni", base_to_box, eye - boxes.center)[:, None]  # (N, 1, 3)
    way = np.einsum("nij,kj->nki", base_to_box, ways)  # (N, 4, 3)
    way = np.where(np.abs(way) < 1e-12, 1e-12, way)
    half = boxes.size[:, None] / 2
    sides = np.stack([(-half - start) / way, (half - start) / way])
    enter, leave = sides.min(axis=0).max(axis=-1), sides.max(axis=0).min(axis=-1)
    met: Mask = (enter <= leave) & (leave > LEAST_DEPTH_M)
    return rays, met


def hidden_shares(crops: Crops, away_m: Floats) -> Floats:
    """Return which share of each box's rectangle (N,) the rectangle of one nearer box in the same picture covers.

    Rectangles reach beyond what they go around, so it is a bound: where it is large, the crop may show something else.

    Args:
        crops: of N boxes.
        away_m: (N,) their distance, which says who is in front.
    """
    low, high = crops.place_px[:, :2], crops.place_px[:, 2:]
    both = np.minimum(high[:, None], high) - np.maximum(low[:, None], low)
    front = (away_m < away_m[:, None]) & (crops.camera == crops.camera[:, None]) & crops.known
    area = (high - low).prod(axis=1)
    covered = np.where(front, np.maximum(both, 0).prod(axis=-1), 0.0).max(axis=1, initial=0.0)
    share: Floats = np.where(crops.known, covered / np.where(crops.known, area, 1.0), 0.0)
    return share
