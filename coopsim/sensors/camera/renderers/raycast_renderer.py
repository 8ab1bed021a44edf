"""Cameras drawn by ray casting, without OpenGL."""

from __future__ import annotations

import numpy as np

from coopsim.geometry.se3 import SE3
from coopsim.sensors.camera.camera import Camera
from coopsim.sensors.camera.renderer import Renderer, View
from coopsim.sensors.raycast import RayScene
from coopsim.sensors.scene import Triangles
from coopsim.types import Ints


class RaycastRenderer(Renderer):
    """Casts one ray per pixel, in the direction in which the lens looks."""

    name = "raycast"

    def __init__(self) -> None:
        self._frame: Triangles | None = None
        self._scenes: dict[int | None, tuple[RayScene, Ints]] = {}

    def update(self, triangles: Triangles) -> None:
        self._frame, self._scenes = triangles, {}

    def see(self, camera: Camera, world_SE3_camera: SE3, own_id: int | None) -> View:
        lens = camera.intrinsics
        scene, faces = self._scene_without(own_id)
        toward = world_SE3_camera.rotate(lens.unit_rays)
        hits = scene.cast(world_SE3_camera.translation, toward)
        depth, face = hits.range_m / lens.stretch.reshape(-1), hits.face
        near = depth < camera.near_m
        if near.any():  # surfaces that are too near hide nothing, as in OpenGL
            behind = scene.cast(world_SE3_camera.apply(camera.near_m * lens.rays[near]), toward[near])
            depth[near] = camera.near_m + behind.range_m / lens.stretch.reshape(-1)[near]
            face[near] = behind.face
        depth, face = depth.reshape(lens.size), face.reshape(lens.size)
        seen = depth <= camera.far_m
        return View(np.where(seen, faces[face], -1), np.where(seen, depth, np.float32(0.0)))

    def close(self) -> None:
        self._frame, self._scenes = None, {}

    def _scene_without(self, own_id: int | None) -> tuple[RayScene, Ints]:
        """Return the scene without an actor, and the frame's index of each of its faces, then -1 for no face."""
        frame = self._frame
        assert frame is not None, "update before see"
        if own_id not in self._scenes:
            kept = frame.faces_without(own_id)
            scene = Triangles(
                frame.vertices,
                frame.faces[kept],
                frame.instance[kept],
                frame.reflectivity[kept],
                frame.color[kept],
            )
            self._scenes[own_id] = (RayScene(scene), np.append(kept, -1))
        return self._scenes[own_id]
