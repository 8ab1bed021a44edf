"""Cameras drawn by pyrender (https://github.com/mmatl/pyrender): the reference for the other renderers.

Scene, camera, matrices, rasterising and depth are pyrender's; the shader that writes which triangle is seen is ours.
"""

from __future__ import annotations

import os
from typing import Any

import numpy as np
from numpy.typing import NDArray

from coopsim.errors import InvalidValueError, MissingDependencyError
from coopsim.geometry.se3 import SE3, Floats
from coopsim.sensors.camera.camera import Camera
from coopsim.sensors.camera.intrinsics import Intrinsics, LensLookup
from coopsim.sensors.camera.renderer import PixelHits, Renderer
from coopsim.sensors.scene import Triangles
from coopsim.types import Ints

INSTALL = "pip install 'coopsim[pyrender]', and on Debian: apt-get install libegl1 libgl1-mesa-dri libopengl0"

_MOST_FACES = (2**24 - 1) // 2
"""Each side of a face has a number, in the 24 bits of a colour, where 0 is nothing."""


class PyrenderRenderer(Renderer):
    """Draws through EGL, with or without a screen.

    Depths are as fine as a depth buffer of 24 bits: with a camera's default `near_m` and `far_m`, beyond 100 m to some
    centimetres.

    Raises:
        MissingDependencyError: pyrender, or OpenGL, does not work here; says why and what to install.
    """

    name = "pyrender"

    def __init__(self) -> None:
        try:
            _choose_egl()
            import pyrender

            from coopsim.sensors.camera.pyrender_reference.pyrender_context import Context, TriangleRenderer

            self._pyrender: Any = pyrender
            self._context: Any = Context()
            self._drawing: Any = TriangleRenderer()
        except Exception as error:
            # Each loader (package, library, driver) raises its own kind of error.
            reason = f"pyrender does not work here ({type(error).__name__}: {error})"
            raise MissingDependencyError(f"{reason}. Install it: {INSTALL}") from error
        self._frame: _Frame | None = None
        self._lookups: dict[Intrinsics, LensLookup] = {}

    def update(self, triangles: Triangles) -> None:
        if len(triangles.faces) > _MOST_FACES:
            raise InvalidValueError(f"pyrender draws at most {_MOST_FACES} triangles here, got {len(triangles.faces)}")
        self._frame = _Frame(self._pyrender, triangles)

    def see(self, camera: Camera, world_SE3_camera: SE3, own_id: int | None) -> PixelHits:
        assert self._frame is not None, "update before see"
        lens = camera.intrinsics
        if not lens.distorts:
            return self._draw(self._frame, lens, camera, world_SE3_camera, own_id)
        if lens not in self._lookups:
            self._lookups[lens] = LensLookup(lens)
        lookup = self._lookups[lens]
        seen = self._draw(self._frame, lookup.pinhole, camera, world_SE3_camera, own_id)
        slopes = self._frame.slopes(lookup.pinhole, world_SE3_camera)[seen.face]
        face, closeness = lookup.apply(seen.face, np.concatenate([_inverse(seen.depth)[..., None], slopes], axis=-1))
        return PixelHits(np.where(closeness > 0, face, -1), _inverse(np.maximum(closeness, 0.0)))

    def close(self) -> None:
        if self._context is not None:
            with self._context.current():
                self._drawing.delete()
            self._context.delete_context()
        self._context, self._drawing, self._frame = None, None, None

    def _draw(
        self, frame: _Frame, pinhole: Intrinsics, camera: Camera, world_SE3_camera: SE3, own_id: int | None
    ) -> PixelHits:
        """Return the view of the camera if its lens were this pinhole."""
        faces, mesh = frame.mesh(own_id)
        if mesh is None:
            return PixelHits(np.full(pinhole.size, -1), np.zeros(pinhole.size, dtype=np.float32))
        scene = self._pyrender.Scene()
        # pyrender's image begins at 0, ours half a pixel before the middle of the first pixel.
        eye = self._pyrender.IntrinsicsCamera(
            pinhole.fx_px, pinhole.fy_px, pinhole.cx_px + 0.5, pinhole.cy_px + 0.5, camera.near_m, camera.far_m
        )
        scene.add(eye, pose=frame.pose(world_SE3_camera))
        shown = {scene.add(mesh): 0}
        self._drawing.viewport_width, self._drawing.viewport_height = pinhole.width, pinhole.height
        flags = self._pyrender.RenderFlags
        with self._context.current():
            # Only the segmentation pass takes one sample per pixel, through its middle.
            color, depth = self._drawing.render(scene, flags.SEG | flags.OFFSCREEN, shown)
        number = color.astype(np.int32) @ np.array([1 << 16, 1 << 8, 1], dtype=np.int32)
        seen = number > 0
        return PixelHits(np.where(seen, faces[(number - 1) % len(faces)], -1), np.where(seen, depth, np.float32(0.0)))


class _Frame:
    """A frame as pyrender's meshes."""

    def __init__(self, pyrender: Any, triangles: Triangles) -> None:
        self._pyrender, self._triangles = pyrender, triangles
        self._origin_m = triangles.middle_m
        self._meshes: dict[int | None, tuple[Ints, Any]] = {}

    def mesh(self, own_id: int | None) -> tuple[Ints, Any]:
        """Return the indices of all faces but one actor's, and their mesh (None without faces).

        Every face is in the mesh twice, first all from outside, then all from inside: in this pass pyrender leaves out
        faces that look away.
        """
        if own_id not in self._meshes:
            kept = self._triangles.faces_without(own_id)
            outside = self._triangles.faces[kept]
            local = (self._triangles.vertices - self._origin_m).astype(np.float32)
            both = np.concatenate([outside, outside[:, ::-1]])
            mesh = self._pyrender.Mesh([self._pyrender.Primitive(local, indices=both)]) if len(kept) else None
            self._meshes[own_id] = (kept, mesh)
        return self._meshes[own_id]

    def pose(self, world_SE3_camera: SE3) -> Floats:
        """Return the pose (4, 4) of a camera in this frame's meshes. OpenGL's camera looks along -z with y up."""
        pose = np.eye(4)
        pose[:3, :3] = world_SE3_camera.rotation * [1.0, -1.0, -1.0]
        pose[:3, 3] = world_SE3_camera.translation - self._origin_m
        return pose

    def slopes(self, pinhole: Intrinsics, world_SE3_camera: SE3) -> NDArray[np.float32]:
        """Return the growth (F, 2) of inverse depth on each face from a column, and from a row, to the next, 1/m.

        On the plane n p = d the depth z in the direction r, with r_z = 1, is d / n r: its inverse is linear in r.
        """
        triangles = self._triangles
        normal = triangles.normals
        first = triangles.vertices[triangles.faces[:, 0]] - world_SE3_camera.translation
        distance = np.einsum("fk,fk->f", normal, first)[:, None]
        focal_px = np.array([pinhole.fx_px, pinhole.fy_px])
        growth = (normal @ world_SE3_camera.rotation)[:, :2] / focal_px
        # A camera in a face's plane does not see the face.
        slopes: Floats = np.divide(growth, distance, out=np.zeros_like(growth), where=distance != 0)
        return slopes.astype(np.float32)


def _inverse(values: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return 1 / value, and 0 for 0."""
    inverse = np.zeros_like(values)
    np.divide(np.float32(1.0), values, out=inverse, where=values > 0)
    return inverse


def _choose_egl() -> None:
    """Select EGL for PyOpenGL, which reads the variable once, when first imported."""
    platform = os.environ.setdefault("PYOPENGL_PLATFORM", "egl")
    if platform != "egl":
        raise ImportError(f"PYOPENGL_PLATFORM must be unset or 'egl', got {platform!r}")
