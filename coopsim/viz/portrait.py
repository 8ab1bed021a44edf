"""Pictures of models, each alone on the ground, seen from its front left; and sheets of such pictures."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray
from PIL import Image, ImageDraw

from coopsim.geometry.boxes import Boxes3D
from coopsim.geometry.se3 import SE3
from coopsim.sensors.camera.camera import Camera
from coopsim.sensors.camera.daylight import DAYLIGHTS, Illumination
from coopsim.sensors.camera.intrinsics import Intrinsics
from coopsim.sensors.camera.picture import FramePainter
from coopsim.sensors.camera.renderers.raycast_renderer import RaycastRenderer
from coopsim.sensors.scene import SceneGeometry
from coopsim.world.models.model import Model
from coopsim.world.snapshot import Actors, StaticPart

_FOV_RAD = np.radians(24.0)
_HEADING_RAD, _PITCH_RAD = np.radians(218.0), np.radians(16.0)
_SMOOTHING = 3
"""Pixels drawn for each pixel shown, along either axis."""

_GROUND_COLOR = (160, 164, 160)
_LABEL_PX = 14


def portrait(
    model: Model,
    color: ArrayLike,
    accent: ArrayLike,
    *,
    phase: float = 0.0,
    size_px: tuple[int, int] = (192, 144),
) -> NDArray[np.uint8]:
    """Draw a model as large as fits; return the picture (H, W, 3).

    Args:
        model: to draw.
        color: (3,) uint8, its paint.
        accent: (3,) uint8, its second paint.
        phase: position in its cycle of poses, in [0, 1).
        size_px: width and height.
    """
    width, height = (side * _SMOOTHING for side in size_px)
    camera = Camera("portrait", Intrinsics.from_fov(width, height, _FOV_RAD))
    boxes = Boxes3D(np.array([[0.0, 0.0, model.size_m[2] / 2]]), model.size_m[None], np.zeros(1))
    zero = np.zeros(1, dtype=np.int64)
    first, second = (np.array([paint], dtype=np.uint8) for paint in (color, accent))
    actor = Actors(zero + 1, boxes, np.zeros((1, 2)), zero, zero, first, second, np.array([phase]))
    corners = 500.0 * np.array([[-1.0, -1.0, 0.0], [1.0, -1.0, 0.0], [1.0, 1.0, 0.0], [-1.0, 1.0, 0.0]])
    ground = StaticPart("ground", corners, np.array([[0, 1, 2], [0, 2, 3]]), _GROUND_COLOR, 0.3)
    triangles = SceneGeometry([model], [ground]).triangles(actor)
    renderer, painter = RaycastRenderer(), FramePainter(Illumination(DAYLIGHTS.get("day")), ["rgb"])
    renderer.update(triangles)
    painter.update(actor, triangles)
    rgb = painter.paint(renderer.see(camera, _viewpoint(boxes, camera.intrinsics), None), camera.intrinsics).rgb
    assert rgb is not None, "asked for above"
    fine = rgb.reshape(size_px[1], _SMOOTHING, size_px[0], _SMOOTHING, 3)
    picture: NDArray[np.uint8] = fine.mean(axis=(1, 3)).astype(np.uint8)
    return picture


def contact_sheet(pictures: Sequence[tuple[str, NDArray[np.uint8]]], columns: int) -> Image.Image:
    """Arrange pictures of one size (H, W, 3), each with a line of text below, row by row."""
    height, width = pictures[0][1].shape[:2]
    rows = -(-len(pictures) // columns)
    sheet = Image.new("RGB", (columns * width, rows * (height + _LABEL_PX)), "white")
    draw = ImageDraw.Draw(sheet)
    for k, (text, picture) in enumerate(pictures):
        row, column = divmod(k, columns)
        place = (column * width, row * (height + _LABEL_PX))
        sheet.paste(Image.fromarray(picture), place)
        draw.text((place[0] + 4, place[1] + height + 1), text, fill="black")
    return sheet


def _viewpoint(boxes: Boxes3D, lens: Intrinsics) -> SE3:
    """Return the `world_SE3_camera` from which the box just fits into the picture."""
    cos, sin = np.cos(_PITCH_RAD), np.sin(_PITCH_RAD)
    level = SE3.from_xyz_yaw([0.0, 0.0, 0.0], _HEADING_RAD)
    axes = level.rotation @ np.array([[0.0, -sin, cos], [-1.0, 0.0, 0.0], [0.0, -cos, -sin]])
    right, down, ahead = ((boxes.corners[0] - boxes.center[0]) @ axes).T
    reach = np.array([lens.width, lens.height])[:, None] / 2 / lens.fx_px
    distance = (np.abs([right, down]) / (0.94 * reach) - ahead).max()
    return SE3(axes, boxes.center[0] - distance * axes[:, 2])
