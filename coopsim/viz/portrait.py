"""Portraits: of models from the front left, of worlds and towns from straight above, and sheets of them."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray
from PIL import Image, ImageDraw

from coopsim.errors import InvalidValueError
from coopsim.geometry.boxes import Boxes3D
from coopsim.geometry.se3 import SE3, Floats
from coopsim.sensors.camera.camera import Camera
from coopsim.sensors.camera.daylight import DAYLIGHTS, Illumination
from coopsim.sensors.camera.intrinsics import Intrinsics
from coopsim.sensors.camera.picture import FramePainter
from coopsim.sensors.camera.renderers import RaycastRenderer
from coopsim.sensors.scene import SceneGeometry
from coopsim.support.files import require_writable
from coopsim.viz import palette
from coopsim.world.models.model import Model
from coopsim.world.scenario import Scenario
from coopsim.world.snapshot import Actors, StaticPart, WorldSource
from coopsim.world.world import World

_FOV_RAD = np.radians(24.0)
_HEADING_RAD, _PITCH_RAD = np.radians(218.0), np.radians(16.0)
_SMOOTHING = 3
"""Pixels drawn for each pixel shown, along either axis."""

_GROUND_COLOR = (160, 164, 160)
_LABEL_PX = 14

_HEIGHT_M = 1000.0
"""Height of the camera; from here a wall of 10 m leans out by 1 % of its distance from the middle."""

_RING_PX = 5
_MARGIN_M, _TOWN_PX = 15.0, 900

IMAGE_SUFFIXES = (".png", ".jpg", ".jpeg")


def portrait(
    model: Model,
    color: ArrayLike,
    accent: ArrayLike,
    *,
    phase: float = 0.0,
    size_px: tuple[int, int] = (192, 144),
) -> NDArray[np.uint8]:
    """Draw a model as large as fits; return the image (H, W, 3).

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
    return _photograph(SceneGeometry([model], [ground]), actor, camera, _viewpoint(boxes, camera.intrinsics))


def contact_sheet(pictures: Sequence[tuple[str, NDArray[np.uint8]]], columns: int) -> Image.Image:
    """Arrange images of one size (H, W, 3), each with a line of text below, row by row."""
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
    """Return the `world_SE3_camera` from which the box just fits into the image."""
    cos, sin = np.cos(_PITCH_RAD), np.sin(_PITCH_RAD)
    level = SE3.from_xyz_yaw([0.0, 0.0, 0.0], _HEADING_RAD)
    axes = level.rotation @ np.array([[0.0, -sin, cos], [-1.0, 0.0, 0.0], [0.0, -cos, -sin]])
    right, down, ahead = ((boxes.corners[0] - boxes.center[0]) @ axes).T
    reach = np.array([lens.width, lens.height])[:, None] / 2 / lens.fx_px
    distance = (np.abs([right, down]) / (0.94 * reach) - ahead).max()
    return SE3(axes, boxes.center[0] - distance * axes[:, 2])


def draw_overhead(world: WorldSource, centre_m: ArrayLike, side_m: float, size_px: int) -> NDArray[np.uint8]:
    """Draw a square of the world with north up, agents ringed; return the image (size_px, size_px, 3).

    The square's middle is `centre_m` (2,), its edge `side_m`.
    """
    middle = np.asarray(centre_m, dtype=np.float64)
    fine_px = size_px * _SMOOTHING
    lens = Intrinsics.from_fov(fine_px, fine_px, float(2 * np.arctan(side_m / 2 / _HEIGHT_M)))
    pose = SE3(np.diag([1.0, -1.0, -1.0]), np.array([*middle, _HEIGHT_M]))
    camera = Camera("above", lens, far_m=2 * _HEIGHT_M)
    picture = Image.fromarray(_photograph(SceneGeometry(world.models, world.static), world.actors(), camera, pose))
    agents = np.array([body.world_SE3_base.translation[:2] for body in world.agents().values()]).reshape(-1, 2)
    _ring(picture, size_px / 2 + (agents - middle) * [1, -1] * size_px / side_m)
    return np.asarray(picture)


def _photograph(geometry: SceneGeometry, actors: Actors, camera: Camera, world_SE3_camera: SE3) -> NDArray[np.uint8]:
    """Return the image (H, W, 3) of a camera by day, smoothed to 1 / `_SMOOTHING` of the camera's height and width."""
    triangles = geometry.triangles(actors)
    renderer, painter = RaycastRenderer(), FramePainter(Illumination(DAYLIGHTS.get("day")), ["rgb"])
    renderer.update(triangles)
    painter.update(actors, triangles)
    rgb = painter.paint(renderer.see(camera, world_SE3_camera, None), camera.intrinsics).rgb
    assert rgb is not None, "asked for above"
    height, width = (side // _SMOOTHING for side in camera.intrinsics.size)
    smooth: NDArray[np.uint8] = rgb.reshape(height, _SMOOTHING, width, _SMOOTHING, 3).mean(axis=(1, 3)).astype(np.uint8)
    return smooth


def _ring(picture: Image.Image, spots_px: Floats) -> None:
    draw = ImageDraw.Draw(picture)
    for x, y in spots_px.tolist():
        draw.ellipse((x - _RING_PX, y - _RING_PX, x + _RING_PX, y + _RING_PX), outline=palette.BACKGROUND, width=3)
        draw.ellipse((x - _RING_PX, y - _RING_PX, x + _RING_PX, y + _RING_PX), outline=palette.AGENT, width=2)


def require_picture(path: Path) -> None:
    """Raise `InvalidValueError` if an image cannot be written there: to be called before it is drawn."""
    if path.suffix.lower() not in IMAGE_SUFFIXES:
        raise InvalidValueError(f"picture must end in {', '.join(IMAGE_SUFFIXES)}, got {str(path)!r}")
    require_writable(path)


def write_picture(path: Path, town: Scenario, seed: int) -> Path:
    """Draw all of a town from above at the start of the episode with this seed; agents are ringed.

    Raises:
        InvalidValueError: the file cannot be written, or its name is not that of an image.
    """
    require_picture(path)
    corners = np.concatenate(town.layout.road_map.lanes)
    low, high = corners.min(axis=0), corners.max(axis=0)
    side_m = float((high - low).max()) + 2 * _MARGIN_M
    Image.fromarray(draw_overhead(World(town, seed), (low + high) / 2, side_m, _TOWN_PX)).save(path)
    return path
