"""Small scenes made by hand, whose geometry is known exactly."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pytest
import trimesh
from numpy.typing import ArrayLike, NDArray

from coopsim.errors import MissingDependencyError
from coopsim.geometry.boxes import Boxes3D
from coopsim.sensors.camera.camera import Camera, named_rig
from coopsim.sensors.camera.picture import CameraRig
from coopsim.sensors.camera.renderers import make_renderer
from coopsim.sensors.scene import SceneGeometry, Triangles
from coopsim.types import CameraImage
from coopsim.world.models.model import Model
from coopsim.world.snapshot import Actors, AgentBody, StaticPart

AGENTS = ("cav_0", "rsu_0", "driver", "ghost")
CAR = (4.0, 2.0, 1.6)
POST = (0.6, 0.6, 2.0)


def box_model(size_m: Sequence[float], *, reflectivity: float = 0.5, tint: float = 1.0) -> Model:
    mesh = trimesh.creation.box(extents=size_m)
    faces = len(mesh.faces)
    return Model(
        "box",
        0,
        np.array(size_m),
        np.array(mesh.vertices),
        np.array(mesh.faces),
        np.full(faces, tint),
        np.full(faces, reflectivity),
    )


def box_part(
    center_m: ArrayLike, size_m: Sequence[float], *, yaw_rad: float = 0.0, reflectivity: float = 0.5
) -> StaticPart:
    mesh = trimesh.creation.box(extents=size_m, transform=trimesh.transformations.rotation_matrix(yaw_rad, [0, 0, 1]))
    vertices = np.array(mesh.vertices) + np.asarray(center_m)
    return StaticPart("box", vertices, np.array(mesh.faces), (150, 90, 60), reflectivity)


def ground(half_m: float = 150.0, *, reflectivity: float = 0.3) -> StaticPart:
    corners = half_m * np.array([[-1.0, -1.0, 0.0], [1.0, -1.0, 0.0], [1.0, 1.0, 0.0], [-1.0, 1.0, 0.0]])
    return StaticPart("ground", corners, np.array([[0, 1, 2], [0, 2, 3]]), (90, 90, 90), reflectivity)


MODELS = (box_model(CAR), box_model(POST, reflectivity=0.8))


def actors(rows: ArrayLike, *, model: ArrayLike = 0, first_id: int = 1, color: ArrayLike = (200, 20, 20)) -> Actors:
    """Actors that stand on the ground. `rows` (N, 3): x, y m and yaw rad."""
    place = np.asarray(rows, dtype=np.float64).reshape(-1, 3)
    count = len(place)
    which: NDArray[np.int64] = np.broadcast_to(np.asarray(model), (count,)).astype(np.int64)
    size = np.array([shape.size_m for shape in MODELS])[which].reshape(-1, 3)
    boxes = Boxes3D(np.column_stack([place[:, :2], size[:, 2] / 2]), size, place[:, 2])
    colors = np.broadcast_to(np.asarray(color, dtype=np.uint8), (count, 3))
    return Actors(np.arange(first_id, first_id + count), boxes, np.zeros((count, 2)), which, which, colors)


def triangles(who: Actors | None = None, static: Sequence[StaticPart] = ()) -> Triangles:
    return SceneGeometry(MODELS, static).triangles(actors([]) if who is None else who)


def soup(vertices: np.ndarray, instance: int = 0) -> Triangles:
    """Loose triangles of (F, 3, 3)."""
    count = len(vertices)
    return Triangles(
        vertices.reshape(-1, 3),
        np.arange(3 * count).reshape(-1, 3),
        np.full(count, instance),
        np.ones(count),
        np.zeros((count, 3), dtype=np.uint8),
    )


def moller_trumbore(corners: np.ndarray, origin: np.ndarray, rays: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Nearest hit of every ray with (F, 3, 3) triangles (Moller and Trumbore 1997): range (R,) and face (R,)."""
    first, second = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    across = np.cross(rays[:, None], second)
    determinant = np.einsum("rfk,fk->rf", across, first)
    offset = origin - corners[:, 0]
    u = np.einsum("rfk,fk->rf", across, offset) / determinant
    turned = np.cross(offset, first)
    v = rays @ turned.T / determinant
    distance = np.einsum("fk,fk->f", turned, second) / determinant
    hit = (u >= 0) & (v >= 0) & (u + v <= 1) & (distance > 0)
    distance = np.where(hit, distance, np.inf)
    face = distance.argmin(axis=1)
    nearest = distance[np.arange(len(rays)), face]
    return nearest, np.where(np.isfinite(nearest), face, -1)


class Studio:
    """A scene, and cameras that look at it; skips the test where it needs an OpenGL that is not there."""

    def __init__(
        self,
        renderer: str,
        static: Sequence[StaticPart] = (),
        models: Sequence[Model] = MODELS,
        cameras: Mapping[str, Sequence[Camera]] | None = None,
        **how: Any,
    ) -> None:
        rig = named_rig("surround")
        try:
            self.rig = CameraRig(cameras or dict.fromkeys(AGENTS, rig), make_renderer(renderer), **how)
        except MissingDependencyError as error:
            pytest.skip(str(error))
        self._geometry = SceneGeometry(models, static)

    def shoot(self, who: Actors, bodies: Mapping[str, AgentBody]) -> dict[str, dict[str, CameraImage]]:
        return self.rig.render(self._geometry.triangles(who), who, bodies)
