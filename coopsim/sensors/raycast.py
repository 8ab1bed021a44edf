"""Rays against triangles, by Intel's Embree through embreex."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from coopsim.geometry.se3 import Floats
from coopsim.sensors.geometry import Triangles
from coopsim.types import Ints


@dataclass(frozen=True, slots=True, eq=False)
class RayHits:
    """Where R rays end.

    Attributes:
        range_m: (R,) float32, inf where nothing was hit.
        face: (R,) int, index of the face, -1 where nothing was hit.
    """

    range_m: NDArray[np.float32]
    face: Ints


class RayScene:
    """A frame's triangles, ready for rays; built once and shared by all sensors.

    Args:
        triangles: the scene in the world frame.
    """

    def __init__(self, triangles: Triangles) -> None:
        from embreex.mesh_construction import TriangleMesh
        from embreex.rtcore_scene import EmbreeScene

        self.triangles = triangles
        self.normals = triangles.normals
        moving = triangles.vertices[triangles.faces[triangles.instance > 0].ravel()]
        # Embree computes in float32: kilometres from the origin that is centimetres. Measure from the actors' middle.
        around = moving if len(moving) else triangles.vertices
        self._origin = np.append(around[:, :2].mean(axis=0), 0.0) if len(around) else np.zeros(3)
        self._scene = EmbreeScene(robust=True)  # else rays slip through between faces that share an edge
        local = np.ascontiguousarray(triangles.vertices - self._origin, dtype=np.float32)
        self._mesh = TriangleMesh(self._scene, local, np.ascontiguousarray(triangles.faces, dtype=np.int32))

    def cast(self, origin_m: Floats, directions: NDArray[np.floating]) -> RayHits:
        """Cast rays from one point, or each from its own.

        Args:
            origin_m: (3,) or (R, 3), world frame.
            directions: (R, 3) unit vectors, world frame.
        """
        rays = np.ascontiguousarray(directions, dtype=np.float32)
        start = np.asarray(origin_m - self._origin, dtype=np.float32)
        found = self._scene.run(np.ascontiguousarray(np.broadcast_to(start, rays.shape)), rays, output=True)
        face = np.asarray(found["primID"], dtype=np.int64)
        range_m = np.where(face >= 0, found["tfar"], np.inf).astype(np.float32)
        return RayHits(range_m, face)
