"""Crops: the parts of an agent's pictures that show its boxes (DINO-CoDT, He et al., sec. III-G, eq. 5-6).

The paper projects a box's eight corners into a camera and takes the smallest upright rectangle around them. A box may
reach beyond a picture's edges or behind its camera, where corners mean nothing, so here the box is cut by the planes of
what the camera sees, and the rectangle goes around what is left of it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from coopsim.geometry.boxes import Boxes3D
from coopsim.geometry.se3 import Floats
from coopsim.sensors.camera.projection import LEAST_DEPTH_M, picture_bounds, places_px
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
    if not cameras or not len(boxes):
        return Crops(np.full(len(boxes), -1), np.full((len(boxes), 4), np.nan))
    shown_px = rectangles(tuple(cameras.values()), boxes)
    area = np.nan_to_num((shown_px[..., 2:] - shown_px[..., :2]).prod(axis=-1))
    camera, box = area.argmax(axis=0), np.arange(len(boxes))
    enough = area[camera, box] >= least_area_px
    return Crops(np.where(enough, camera, -1), np.where(enough[:, None], shown_px[camera, box], np.nan))


def rectangles(cameras: Sequence[CameraCalibration], boxes: Boxes3D) -> Floats:
    """Return the smallest upright rectangles around what pictures show of boxes.

    Exact for a pinhole. With a lens that distorts, edges of boxes are bent: points along them stand for them.

    Args:
        cameras: C, at least one.
        boxes: N, in the agent's base frame.

    Returns:
        (C, N, 4) first column, first row, last column, last row, as of `Crops`; NaN for boxes outside the picture.
    """
    bounds = [picture_bounds(camera) for camera in cameras]
    low, high = (np.stack([getattr(each, name) for each in bounds]) for name in ("low", "high"))
    turn = np.stack([camera.base_SE3_camera.rotation for camera in cameras])  # (C, 3, 3)
    eye = np.stack([camera.base_SE3_camera.translation for camera in cameras])
    corners = (boxes.corners - eye[:, None, None]) @ turn[:, None]  # (C, N, 8, 3)
    bent = any(camera.distortion.any() for camera in cameras)
    along, kept = _cut_edges(corners, low, high, _BENT_STEPS if bent else 2)
    rays, met = _picture_corners(turn, eye, boxes, low, high)
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


def _cut_edges(corners: Floats, low: Floats, high: Floats, steps: int) -> tuple[Floats, Mask]:
    """Cut the edges of boxes by the five planes of what cameras see.

    Args:
        corners: (C, N, 8, 3) in the frame of each of C cameras.
        low: (C, 2) smallest x and y of each picture on the plane z = 1.
        high: (C, 2) largest ones.
        steps: S, points along each edge.

    Returns:
        Points on what is left of the edges (C, N, 12 S, 3), and whether anything is left (C, N, 12 S).
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


def _picture_corners(turn: Floats, eye: Floats, boxes: Boxes3D, low: Floats, high: Floats) -> tuple[Floats, Mask]:
    """Return the rays through pictures' corners, and which boxes they meet.

    A box so near that none of its edges is in the picture still fills it.

    Args:
        turn: (C, 3, 3) rotation of each of C cameras in the base frame.
        eye: (C, 3) its place.
        boxes: N.
        low: (C, 2) smallest x and y of each picture on the plane z = 1.
        high: (C, 2) largest ones.

    Returns:
        (C, 4, 3) in the frames of the cameras, and (C, N, 4).
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
