"""Pictures of a world from straight above, drawn from the meshes that the sensors meet."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray
from PIL import Image, ImageDraw

from coopsim.geometry.se3 import SE3, Floats
from coopsim.sensors.camera.camera import Camera
from coopsim.sensors.camera.daylight import DAYLIGHTS, Illumination
from coopsim.sensors.camera.intrinsics import Intrinsics
from coopsim.sensors.camera.picture import FramePainter
from coopsim.sensors.camera.renderers.raycast_renderer import RaycastRenderer
from coopsim.sensors.scene import SceneGeometry
from coopsim.viz import palette
from coopsim.world.snapshot import WorldSource

_HEIGHT_M = 1000.0
"""Of the camera; from here a wall of 10 m leans out by 1 % of its distance from the middle."""

_SMOOTHING = 3
"""Pixels drawn for each pixel shown, along either axis."""

_RING_PX = 5


def draw_overhead(world: WorldSource, centre_m: ArrayLike, side_m: float, size_px: int) -> NDArray[np.uint8]:
    """Draw a square of the world with north up, agents ringed; return the picture (size_px, size_px, 3).

    Args:
        world: as it is now.
        centre_m: (2,) middle of the square.
        side_m: of the square.
        size_px: of the picture.
    """
    middle = np.asarray(centre_m, dtype=np.float64)
    fine_px = size_px * _SMOOTHING
    camera = Camera("above", Intrinsics.from_fov(fine_px, fine_px, float(2 * np.arctan(side_m / 2 / _HEIGHT_M))))
    pose = SE3(np.diag([1.0, -1.0, -1.0]), np.array([*middle, _HEIGHT_M]))
    rgb = _photograph(world, Camera("above", camera.intrinsics, far_m=2 * _HEIGHT_M), pose)
    smooth = rgb.reshape(size_px, _SMOOTHING, size_px, _SMOOTHING, 3).mean(axis=(1, 3)).astype(np.uint8)
    picture = Image.fromarray(smooth)
    agents = np.array([body.world_SE3_base.translation[:2] for body in world.agents().values()]).reshape(-1, 2)
    _ring(picture, size_px / 2 + (agents - middle) * [1, -1] * size_px / side_m)
    return np.asarray(picture)


def _photograph(world: WorldSource, camera: Camera, world_SE3_camera: SE3) -> NDArray[np.uint8]:
    actors = world.actors()
    triangles = SceneGeometry(world.models, world.static).triangles(actors)
    renderer, painter = RaycastRenderer(), FramePainter(Illumination(DAYLIGHTS.get("day")), ["rgb"])
    renderer.update(triangles)
    painter.update(actors, triangles)
    rgb = painter.paint(renderer.see(camera, world_SE3_camera, None), camera.intrinsics).rgb
    assert rgb is not None, "asked for above"
    return rgb


def _ring(picture: Image.Image, spots_px: Floats) -> None:
    draw = ImageDraw.Draw(picture)
    for x, y in spots_px.tolist():
        draw.ellipse((x - _RING_PX, y - _RING_PX, x + _RING_PX, y + _RING_PX), outline=palette.BACKGROUND, width=3)
        draw.ellipse((x - _RING_PX, y - _RING_PX, x + _RING_PX, y + _RING_PX), outline=palette.AGENT, width=2)
