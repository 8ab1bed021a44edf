"""Renderers: OpenGL off screen, ray casting for machines without it, and their choice by name.

OpenGL writes in one pass the triangle and the depth that each pixel sees. This is a visibility buffer (Burns and Hunt,
"The Visibility Buffer", JCGT 2013): every mode of image is looked up from it, so that more modes cost no more passes.
"""

from __future__ import annotations

import warnings
from typing import Any

import numpy as np
from numpy.typing import NDArray

from coopsim.errors import MissingDependencyError
from coopsim.geometry.se3 import SE3, Floats
from coopsim.sensors.camera.camera import Camera
from coopsim.sensors.camera.intrinsics import Intrinsics, LensLookup
from coopsim.sensors.camera.renderer import PixelHits, Renderer
from coopsim.sensors.scene import RayScene, Triangles
from coopsim.support.checks import require_choice
from coopsim.types import Ints

INSTALL = "pip install 'coopsim[camera]', and on Debian: apt-get install libegl1 libgl1-mesa-dri libopengl0"

_VERTEX = """
#version 330
uniform mat4 clip_SE3_scene;
in vec3 position;
void main() { gl_Position = clip_SE3_scene * vec4(position, 1.0); }
"""

# 1 / gl_FragCoord.w is the depth along the optical axis. On a plane its inverse is linear in the pixels: the slopes
# give the depth off the pixel's middle.
_FRAGMENT = """
#version 330
uniform int first_face;
layout(location = 0) out int face;
layout(location = 1) out vec3 inverse_depth;
void main() {
    face = first_face + gl_PrimitiveID;
    inverse_depth = vec3(gl_FragCoord.w, dFdx(gl_FragCoord.w), dFdy(gl_FragCoord.w));
}
"""


class OpenGLRenderer(Renderer):
    """Renderer by EGL, with or without a screen, in hardware or software. The scene persists, its vertices move."""

    name = "opengl"

    def __init__(self) -> None:
        self._context: Any = make_context()
        self._program = self._context.program(vertex_shader=_VERTEX, fragment_shader=_FRAGMENT)
        self._scene: _Scene | None = None
        self._canvases: dict[Intrinsics, _Canvas] = {}

    def update(self, triangles: Triangles) -> None:
        with self._context:
            if self._scene is None or not self._scene.holds(triangles):
                if self._scene is not None:
                    self._scene.release()
                self._scene = _Scene(self._context, self._program, triangles)
            self._scene.move(triangles)

    def see(self, camera: Camera, world_SE3_camera: SE3, own_id: int | None) -> PixelHits:
        assert self._scene is not None, "update before see"
        with self._context:
            if camera.intrinsics not in self._canvases:
                self._canvases[camera.intrinsics] = _Canvas(self._context, camera.intrinsics)
            canvas = self._canvases[camera.intrinsics]
            clip_SE3_camera = canvas.projection(camera.near_m, camera.far_m)
            scene_SE3_camera = SE3(world_SE3_camera.rotation, world_SE3_camera.translation - self._scene.origin_m)
            matrix = clip_SE3_camera @ _matrix(scene_SE3_camera.inverse())
            self._program["clip_SE3_scene"].write(matrix.T.astype(np.float32).tobytes())  # columns first
            canvas.clear()
            self._scene.draw(own_id)
            return canvas.read()

    def close(self) -> None:
        if self._context is not None:
            self._context.release()  # together with everything made in it
        self._context, self._scene, self._canvases = None, None, {}


class _Scene:
    """Triangles of a scene in the renderer's memory.

    Vertices are measured from `origin_m` (3,): they are float32, which is too coarse far from the origin.
    """

    def __init__(self, context: Any, program: Any, triangles: Triangles) -> None:
        self.origin_m = np.zeros(3)
        self._faces, self._instance = triangles.faces, triangles.instance
        self._first_face = program["first_face"]
        self._vertices = context.buffer(reserve=max(12, 12 * len(triangles.vertices)), dynamic=True)
        self._order = context.buffer(triangles.faces.astype(np.int32).tobytes() or bytes(12))
        self._array = context.vertex_array(program, [(self._vertices, "3f", "position")], self._order)

    def holds(self, triangles: Triangles) -> bool:
        """Return whether these triangles differ from those of this scene in the positions of vertices at most."""
        return triangles.faces is self._faces and triangles.instance is self._instance

    def move(self, triangles: Triangles) -> None:
        """Move the vertices to their positions in these triangles."""
        if len(triangles.vertices):
            self.origin_m = triangles.middle_m
            self._vertices.write((triangles.vertices - self.origin_m).astype(np.float32).tobytes())

    def draw(self, own_id: int | None) -> None:
        """Draw all actors but one."""
        shown = np.concatenate([[False], self._instance != (-1 if own_id is None else own_id), [False]])
        changes = np.flatnonzero(shown[1:] != shown[:-1]).reshape(-1, 2)
        for first, end in changes.tolist():  # an actor's faces are consecutive: two runs at most
            self._first_face.value = first
            self._array.render(vertices=3 * (end - first), first=3 * first)

    def release(self) -> None:
        for part in (self._array, self._order, self._vertices):
            part.release()


class _Canvas:
    """The buffers of one kind of camera.

    A rasteriser draws the view of a pinhole; that of a distorting lens is looked up from it (see `LensLookup`).
    """

    def __init__(self, context: Any, intrinsics: Intrinsics) -> None:
        self._lookup = LensLookup(intrinsics) if intrinsics.distorts else None
        self._drawn = intrinsics if self._lookup is None else self._lookup.pinhole
        width, height = self._drawn.width, self._drawn.height
        self._face = context.texture((width, height), 1, dtype="i4")
        self._inverse = context.texture((width, height), 3, dtype="f4")
        self._buffer = context.framebuffer([self._face, self._inverse], context.depth_renderbuffer((width, height)))

    def projection(self, near_m: float, far_m: float) -> Floats:
        """Return the matrix (4, 4) from camera axes to OpenGL's clip space, the first pixel row at the bottom."""
        scale = 2 / np.array([self._drawn.width, self._drawn.height])
        matrix = np.zeros((4, 4))
        matrix[:2, :3] = self._drawn.matrix[:2] * scale[:, None]
        matrix[:2, 2] += 0.5 * scale - 1  # the middle of a pixel is a whole number
        matrix[2, 2:] = np.array([far_m + near_m, -2 * far_m * near_m]) / (far_m - near_m)
        matrix[3, 2] = 1.0
        return matrix

    def clear(self) -> None:
        self._buffer.use()
        self._buffer.clear()

    def read(self) -> PixelHits:
        """Return the view that was drawn."""
        shape = self._drawn.size
        face: NDArray[np.integer] = np.frombuffer(self._face.read(), np.int32).reshape(shape)
        inverse = np.frombuffer(self._inverse.read(), np.float32).reshape(*shape, 3)
        closeness = inverse[..., 0]
        if self._lookup is not None:
            face, closeness = self._lookup.apply(face, inverse)
        seen = closeness > 0
        depth = np.divide(1.0, closeness, out=np.zeros_like(closeness), where=seen)
        return PixelHits(np.where(seen, face, -1), depth)


def _matrix(pose: SE3) -> Floats:
    """Return a pose as a matrix (4, 4)."""
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = pose.rotation, pose.translation
    return matrix


def make_context() -> Any:
    """Make an OpenGL context without a window; raise `MissingDependencyError` that says what to install."""
    try:
        import moderngl

        # Names of the libraries in distributions' run-time packages.
        egl: dict[str, Any] = {"backend": "egl", "libgl": "libOpenGL.so.0", "libegl": "libEGL.so.1"}
        context: Any = moderngl.create_context(standalone=True, **egl)
    except Exception as error:
        # Each loader (package, library, driver) raises its own kind of error.
        reason = f"OpenGL does not work here ({type(error).__name__}: {error})"
        raise MissingDependencyError(f"{reason}. Install it: {INSTALL}") from error
    context.enable(moderngl.DEPTH_TEST)
    return context


class RaycastRenderer(Renderer):
    """Casts one ray per pixel, in the direction in which the lens looks."""

    name = "raycast"

    def __init__(self) -> None:
        self._frame: Triangles | None = None
        self._scenes: dict[int | None, tuple[RayScene, Ints]] = {}

    def update(self, triangles: Triangles) -> None:
        self._frame, self._scenes = triangles, {}

    def see(self, camera: Camera, world_SE3_camera: SE3, own_id: int | None) -> PixelHits:
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
        return PixelHits(np.where(seen, faces[face], -1), np.where(seen, depth, np.float32(0.0)))

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


RENDERERS = ("auto", "opengl", "raycast", "pyrender")


def resolved_renderer(name: str) -> str:
    """Return which renderer `make_renderer` makes on this machine: a name other than "auto"."""
    if name != "auto":
        return name
    try:
        OpenGLRenderer().close()
    except MissingDependencyError:
        return "raycast"
    return "opengl"


def make_renderer(name: str) -> Renderer:
    """Make the renderer called `name`; "auto" is OpenGL if it works, else ray casting, with one warning.

    OpenGL is fast, ray casting does without it, pyrender is the reference of both.

    Raises:
        UnknownNameError: no such renderer.
        MissingDependencyError: "opengl" or "pyrender" was asked for and does not work here; says what to install.
    """
    require_choice("renderer", name, RENDERERS)
    if name == "raycast":
        return RaycastRenderer()
    if name == "pyrender":
        from coopsim.sensors.camera.pyrender_reference.pyrender_renderer import PyrenderRenderer

        return PyrenderRenderer()
    try:
        return OpenGLRenderer()
    except MissingDependencyError as error:
        if name == "opengl":
            raise
        warnings.warn(f"cameras are ray-cast, which is slower: {error}", stacklevel=2)
        return RaycastRenderer()
