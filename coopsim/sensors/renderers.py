"""Two ways to draw what a camera sees, behind one interface: OpenGL, and ray casting where there is none."""

from __future__ import annotations

import warnings
from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from coopsim.checks import require_choice
from coopsim.errors import MissingDependencyError
from coopsim.geometry.se3 import SE3
from coopsim.sensors.geometry import Triangles
from coopsim.sensors.raycast import RayScene
from coopsim.types import CameraImage
from coopsim.world.snapshot import Actors, Model, StaticPart

if TYPE_CHECKING:
    from coopsim.sensors.camera import CameraConfig

SKY = np.array([168, 196, 222], dtype=np.uint8)
SUN = np.array([0.35, 0.25, 0.9]) / np.linalg.norm([0.35, 0.25, 0.9])
"""Unit vector towards the light, world frame."""

AMBIENT, DIFFUSE, GAMMA = 0.55, 0.5, 2.2
RENDERERS = ("auto", "opengl", "raycast")


class Renderer(ABC):
    """Draws frames."""

    @abstractmethod
    def update(self, actors: Actors, triangles: Triangles) -> None:
        """Take over a new frame: the actors, and the same as triangles."""

    @abstractmethod
    def render(self, world_SE3_camera: SE3, own_id: int | None) -> CameraImage:
        """The frame from a pose in OpenCV's camera axes (x right, y down, z forward), without the actor `own_id`."""

    @abstractmethod
    def close(self) -> None:
        """Release resources; nothing can be drawn any more."""


def make_renderer(name: str, models: Sequence[Model], static: Sequence[StaticPart], config: CameraConfig) -> Renderer:
    """The renderer called `name`.

    Raises:
        UnknownNameError: no such renderer.
        MissingDependencyError: "opengl" was asked for and does not work here; says what to install.
    """
    require_choice("renderer", name, RENDERERS)
    if name == "raycast":
        return RaycastRenderer(config)
    from coopsim.sensors.opengl import OpenGLRenderer  # it is a `Renderer`, so it needs this file first

    try:
        return OpenGLRenderer(models, static, config)
    except MissingDependencyError as error:
        if name == "opengl":
            raise
        warnings.warn(f"cameras are ray-cast: {error}", stacklevel=3)
        return RaycastRenderer(config)


class RaycastRenderer(Renderer):
    """One ray per pixel; a face is as bright as it is turned to the sun."""

    def __init__(self, config: CameraConfig) -> None:
        self._config = config
        self._rays = config.rays()
        self._length = np.linalg.norm(self._rays, axis=1)
        self._frame: Triangles | None = None
        self._scenes: dict[int | None, RayScene] = {}

    def update(self, actors: Actors, triangles: Triangles) -> None:
        self._frame, self._scenes = triangles, {}

    def render(self, world_SE3_camera: SE3, own_id: int | None) -> CameraImage:
        config, scene = self._config, self._scene(own_id)
        directions = world_SE3_camera.rotate(self._rays / self._length[:, None])
        hits = scene.cast(world_SE3_camera.translation, directions)
        depth = hits.range_m / self._length
        seen = (hits.face >= 0) & (depth >= config.near_m) & (depth <= config.far_m)
        face = hits.face[seen]
        light = AMBIENT + DIFFUSE * np.maximum(scene.normals[face] @ SUN, 0.0)
        light **= 1 / GAMMA  # light adds up linearly, colours are sRGB; OpenGL shades in the same way
        rgb = np.broadcast_to(SKY, (len(depth), 3)).copy()
        rgb[seen] = np.clip(scene.triangles.color[face] * light[:, None], 0, 255)
        shape = (config.height, config.width)
        return CameraImage(rgb.reshape(*shape, 3), np.where(seen, depth, 0.0).reshape(shape))

    def close(self) -> None:
        self._frame, self._scenes = None, {}

    def _scene(self, own_id: int | None) -> RayScene:
        assert self._frame is not None, "update before render"
        if own_id not in self._scenes:
            self._scenes[own_id] = RayScene(without(self._frame, own_id))
        return self._scenes[own_id]


def without(triangles: Triangles, instance: int | None) -> Triangles:
    """The scene without one actor."""
    if instance is None:
        return triangles
    kept = triangles.instance != instance
    return Triangles(
        triangles.vertices,
        triangles.faces[kept],
        triangles.instance[kept],
        triangles.reflectivity[kept],
        triangles.color[kept],
    )
