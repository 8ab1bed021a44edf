"""Ray casting against triangles by Intel's Embree, through embreex."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from coopsim.geometry.se3 import Floats
from coopsim.sensors.scene import Triangles
from coopsim.types import Ints


@dataclass(frozen=True, slots=True, eq=False)
class RayHits:
    """The first hits of R rays.

    Attributes:
        range_m: (R,) float32, inf where nothing was hit.
        face: (R,) int, index of the face, -1 where nothing was hit.
    """

    range_m: NDArray[np.float32]
    face: Ints


class RayScene:
    """A frame's triangles, shared by all sensors.

    What rays need beyond the triangles is made when first asked for: the grid's sweeps
    (`coopsim.sensors.lidar.cast.ray_grid`) do
    without.

    Args:
        triangles: the scene in the world frame.
    """

    def __init__(self, triangles: Triangles) -> None:
        self.triangles = triangles

    @cached_property
    def normals(self) -> Floats:
        """Outward unit normals, (F, 3)."""
        return self.triangles.normals

    @cached_property
    def _origin(self) -> Floats:
        """Origin of embree's coordinates, whose float32 would be off by centimetres at kilometres from it."""
        return self.triangles.middle_m

    @cached_property
    def _embree(self) -> tuple[Any, Any]:
        """The scene, and its mesh, which must live as long."""
        from embreex.mesh_construction import TriangleMesh
        from embreex.rtcore_scene import EmbreeScene

        scene = EmbreeScene(robust=True)  # otherwise rays slip through between faces that share an edge
        local = np.ascontiguousarray(self.triangles.vertices - self._origin, dtype=np.float32)
        return scene, TriangleMesh(scene, local, np.ascontiguousarray(self.triangles.faces, dtype=np.int32))

    def cast(self, origin_m: Floats, directions: NDArray[np.floating]) -> RayHits:
        """Cast rays and return their first hits.

        Args:
            origin_m: (3,) start of all rays, or (R, 3), world frame.
            directions: (R, 3) unit vectors, world frame.
        """
        rays = np.ascontiguousarray(directions, dtype=np.float32)
        start = np.asarray(origin_m - self._origin, dtype=np.float32)
        scene, _ = self._embree
        found = scene.run(np.ascontiguousarray(np.broadcast_to(start, rays.shape)), rays, output=True)
        face = np.asarray(found["primID"], dtype=np.int64)
        range_m = np.where(face >= 0, found["tfar"], np.inf).astype(np.float32)
        return RayHits(range_m, face)
