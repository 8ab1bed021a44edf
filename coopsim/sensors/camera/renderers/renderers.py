"""Three ways to find out what each pixel of a camera sees, behind one interface.

OpenGL is the fast one, ray casting does without it, and pyrender is an independent reference for both.
"""

from __future__ import annotations

import warnings
from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

import numpy as np
from numpy.typing import NDArray

from coopsim.errors import MissingDependencyError
from coopsim.geometry.se3 import SE3
from coopsim.sensors.raycast import RayScene
from coopsim.sensors.scene import Triangles
from coopsim.support.checks import require_choice
from coopsim.types import Ints

if TYPE_CHECKING:
    from coopsim.sensors.camera.camera import Camera

RENDERERS = ("auto", "opengl", "raycast", "pyrender")


@dataclass(frozen=True, slots=True, eq=False)
class View:
    """What each pixel's middle sees; one sample, so that all pictures made of it agree.

    Attributes:
        face: (H, W) int, index of the triangle, -1 where there is nothing between near and far.
        depth: (H, W) float32, m along the optical axis; 0 where there is nothing.
    """

    face: Ints
    depth: NDArray[np.float32]


class Renderer(ABC):
    """Finds what is seen.

    Attributes:
        name: as users ask for it.
    """

    name: ClassVar[str]

    @abstractmethod
    def update(self, triangles: Triangles) -> None:
        """Take over a new frame."""

    @abstractmethod
    def see(self, camera: Camera, world_SE3_camera: SE3, own_id: int | None) -> View:
        """The frame from a pose in OpenCV's camera axes (x right, y down, z forward), without the actor `own_id`."""

    @abstractmethod
    def close(self) -> None:
        """Release resources; nothing can be drawn any more."""


def make_renderer(name: str) -> Renderer:
    """The renderer called `name`.

    "auto" is OpenGL where it works: it was measured to be the faster one in software, too.

    Raises:
        UnknownNameError: no such renderer.
        MissingDependencyError: "opengl" or "pyrender" was asked for and does not work here; says what to install.
    """
    require_choice("renderer", name, RENDERERS)
    if name == "raycast":
        return RaycastRenderer()
    # These are `Renderer`s, so they need this file first.
    from coopsim.sensors.camera.renderers.opengl import OpenGLRenderer
    from coopsim.sensors.camera.renderers.pyrender_reference.pyrender_renderer import PyrenderRenderer

    if name == "pyrender":
        return PyrenderRenderer()
    try:
        return OpenGLRenderer()
    except MissingDependencyError as error:
        if name == "opengl":
            raise
        warnings.warn(f"cameras are ray-cast, which is slower: {error}", stacklevel=3)
        return RaycastRenderer()


class RaycastRenderer(Renderer):
    """One ray per pixel, along which the lens looks."""

    name = "raycast"

    def __init__(self) -> None:
        self._frame: Triangles | None = None
        self._scenes: dict[int | None, tuple[RayScene, Ints]] = {}

    def update(self, triangles: Triangles) -> None:
        self._frame, self._scenes = triangles, {}

    def see(self, camera: Camera, world_SE3_camera: SE3, own_id: int | None) -> View:
        lens = camera.intrinsics
        scene, faces = self._scene(own_id)
        toward = world_SE3_camera.rotate(lens.unit_rays)
        hits = scene.cast(world_SE3_camera.translation, toward)
        depth, face = hits.range_m / lens.stretch.reshape(-1), hits.face
        near = depth < camera.near_m
        if near.any():  # hides nothing, as where OpenGL draws
            behind = scene.cast(world_SE3_camera.apply(camera.near_m * lens.rays[near]), toward[near])
            depth[near] = camera.near_m + behind.range_m / lens.stretch.reshape(-1)[near]
            face[near] = behind.face
        depth, face = depth.reshape(lens.size), face.reshape(lens.size)
        seen = depth <= camera.far_m
        # -1, nothing, must not be looked up: it would be the last face.
        face = np.where(seen, faces[face], -1)
        return View(face, np.where(seen, depth, np.float32(0.0)))

    def close(self) -> None:
        self._frame, self._scenes = None, {}

    def _scene(self, own_id: int | None) -> tuple[RayScene, Ints]:
        """The scene without an actor, and the faces that it consists of."""
        assert self._frame is not None, "update before see"
        if own_id not in self._scenes:
            frame = self._frame
            kept = faces_without(frame, own_id)
            self._scenes[own_id] = (RayScene(_of_faces(frame, kept)), np.append(kept, -1))
        return self._scenes[own_id]


def faces_without(triangles: Triangles, own_id: int | None) -> Ints:
    """Indices of all faces but those of an actor."""
    return np.flatnonzero(triangles.instance != own_id) if own_id is not None else np.arange(len(triangles.faces))


def _of_faces(triangles: Triangles, kept: Ints) -> Triangles:
    """The scene with these of its faces."""
    return Triangles(
        triangles.vertices,
        triangles.faces[kept],
        triangles.instance[kept],
        triangles.reflectivity[kept],
        triangles.color[kept],
    )
