"""Cameras drawn by OpenGL off screen: one pass writes which triangle each pixel sees, and how deep.

That is a visibility buffer (Burns and Hunt, "The Visibility Buffer", JCGT 2013): every picture that is asked for is
looked up from it afterwards, so that more modes cost no further passes.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from coopsim.errors import MissingDependencyError
from coopsim.geometry.se3 import SE3, Floats
from coopsim.sensors.geometry import Triangles
from coopsim.sensors.intrinsics import MOST_PIXELS, Intrinsics
from coopsim.sensors.renderers import Renderer, View

if TYPE_CHECKING:
    from coopsim.sensors.camera import Camera

INSTALL = "pip install 'coopsim[camera]', and on Debian: apt-get install libegl1 libgl1-mesa-dri libopengl0"

Pixels = NDArray[np.float32]

_VERTEX = """
#version 330
uniform mat4 clip_SE3_scene;
in vec3 position;
void main() { gl_Position = clip_SE3_scene * vec4(position, 1.0); }
"""

# 1 / gl_FragCoord.w is the depth along the optical axis. On a plane its inverse is linear in the pixels: with the
# slopes, the depth is known beside the pixel's middle, too.
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

_FINER = 2
"""Pixels of the pinhole's picture for one of a lens that distorts, along either axis."""


class OpenGLRenderer(Renderer):
    """Draws through EGL, with or without a screen, in hardware or software. One scene persists, its vertices move.

    Raises:
        MissingDependencyError: OpenGL does not work here; says why and what to install.
    """

    name = "opengl"

    def __init__(self) -> None:
        self._context: Any = _context()
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

    def see(self, camera: Camera, world_SE3_camera: SE3, own_id: int | None) -> View:
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
            self._context.release()  # and with it all that was made in it
        self._context, self._scene, self._canvases = None, None, {}


class _Scene:
    """A scene's triangles in the renderer's memory.

    Attributes:
        origin_m: (3,) from which its vertices are measured: they are of float32, which far away is too coarse.
    """

    def __init__(self, context: Any, program: Any, triangles: Triangles) -> None:
        self.origin_m = np.zeros(3)
        self._faces, self._instance = triangles.faces, triangles.instance
        self._first_face = program["first_face"]
        self._vertices = context.buffer(reserve=max(12, 12 * len(triangles.vertices)), dynamic=True)
        self._order = context.buffer(triangles.faces.astype(np.int32).tobytes() or bytes(12))
        self._array = context.vertex_array(program, [(self._vertices, "3f", "position")], self._order)

    def holds(self, triangles: Triangles) -> bool:
        """Whether these differ from the ones it was made for by where their vertices are, at most."""
        return triangles.faces is self._faces and triangles.instance is self._instance

    def move(self, triangles: Triangles) -> None:
        """Have the vertices where they are in these triangles."""
        if len(triangles.vertices):
            moving = triangles.vertices[triangles.faces[triangles.instance > 0].ravel()]
            around = moving if len(moving) else triangles.vertices
            self.origin_m = np.append(around[:, :2].mean(axis=0), 0.0)
            self._vertices.write((triangles.vertices - self.origin_m).astype(np.float32).tobytes())

    def draw(self, own_id: int | None) -> None:
        """Draw all but one actor."""
        shown = np.concatenate([[False], self._instance != (-1 if own_id is None else own_id), [False]])
        changes = np.flatnonzero(shown[1:] != shown[:-1]).reshape(-1, 2)
        for first, end in changes.tolist():  # an actor's faces lie together: two runs at most
            self._first_face.value = first
            self._array.render(vertices=3 * (end - first), first=3 * first)

    def release(self) -> None:
        for part in (self._array, self._order, self._vertices):
            part.release()


class _Canvas:
    """What is drawn on for one kind of camera, and how a picture is read from it.

    A rasteriser draws what a pinhole sees. Behind a lens that distorts, every pixel looks up the nearest one of a finer
    and wider pinhole's picture, and the depth on that triangle in its own direction.
    """

    def __init__(self, context: Any, intrinsics: Intrinsics) -> None:
        self._lookup = _Lookup(intrinsics) if intrinsics.distorts else None
        self._matrix = intrinsics.matrix if self._lookup is None else self._lookup.matrix
        height, width = intrinsics.size if self._lookup is None else self._lookup.size
        self._width, self._height = width, height
        self._face = context.texture((width, height), 1, dtype="i4")
        self._inverse = context.texture((width, height), 3, dtype="f4")
        self._buffer = context.framebuffer([self._face, self._inverse], context.depth_renderbuffer((width, height)))

    def projection(self, near_m: float, far_m: float) -> Floats:
        """(4, 4), from camera axes to OpenGL's clip space, with the picture's first row at the bottom: read first."""
        scale = 2 / np.array([self._width, self._height])
        matrix = np.zeros((4, 4))
        matrix[:2, :3] = self._matrix[:2] * scale[:, None]
        matrix[:2, 2] += 0.5 * scale - 1  # pixels' middles are whole numbers
        matrix[2, 2:] = np.array([far_m + near_m, -2 * far_m * near_m]) / (far_m - near_m)
        matrix[3, 2] = 1.0
        return matrix

    def clear(self) -> None:
        self._buffer.use()
        self._buffer.clear()

    def read(self) -> View:
        """What was drawn."""
        shape = (self._height, self._width)
        face = np.frombuffer(self._face.read(), np.int32).reshape(shape)
        inverse = np.frombuffer(self._inverse.read(), np.float32).reshape(*shape, 3)
        closeness = inverse[..., 0]
        if self._lookup is not None:
            face, closeness = self._lookup.apply(face, inverse)
        seen = closeness > 0
        depth = np.divide(1.0, closeness, out=np.zeros_like(closeness), where=seen)
        return View(np.where(seen, face, -1), depth)


class _Lookup:
    """Which pixel of a finer and wider pinhole's picture each pixel of a lens that distorts looks up.

    Attributes:
        matrix: (3, 3), the pinhole's.
        size: height and width of its picture.
    """

    def __init__(self, intrinsics: Intrinsics) -> None:
        seen = intrinsics.rays[:, :2]
        low, high = seen.min(axis=0), seen.max(axis=0)
        focal_px = _FINER * np.array([intrinsics.fx_px, intrinsics.fy_px])
        focal_px = np.minimum(focal_px, (MOST_PIXELS - 2) / np.maximum(high - low, 1e-9))
        self.matrix = np.array([[focal_px[0], 0.0, -focal_px[0] * low[0]], [0.0, focal_px[1], -focal_px[1] * low[1]]])
        width, height = (np.ceil(focal_px * (high - low)) + 1).astype(int).tolist()
        self.size = (height, width)
        place = focal_px * (seen - low)
        nearest = np.clip(np.rint(place), 0, np.array([width, height]) - 1)
        self._shape = intrinsics.size
        self._index = (nearest[:, 1] * width + nearest[:, 0]).astype(np.int64)
        self._beside = (place - nearest).astype(np.float32)

    def apply(self, face: NDArray[np.int32], inverse: Pixels) -> tuple[NDArray[np.int32], Pixels]:
        """Face and inverse depth, (H, W), in the directions of the lens's pixels."""
        found = inverse.reshape(-1, 3)[self._index]
        exact = found[:, 0] + found[:, 1] * self._beside[:, 0] + found[:, 2] * self._beside[:, 1]
        closeness = np.where(found[:, 0] > 0, exact, np.float32(0.0))
        return face.ravel()[self._index].reshape(self._shape), closeness.reshape(self._shape)


def _matrix(pose: SE3) -> Floats:
    """(4, 4)."""
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = pose.rotation, pose.translation
    return matrix


def _context() -> Any:
    """An OpenGL context without a window.

    Raises:
        MissingDependencyError: says what is missing and what to install.
    """
    try:
        import moderngl

        # By the names under which distributions' run-time packages have them.
        egl: dict[str, Any] = {"backend": "egl", "libgl": "libOpenGL.so.0", "libegl": "libEGL.so.1"}
        context: Any = moderngl.create_context(standalone=True, **egl)
    except Exception as error:
        # Whatever is missing (package, library, driver), its loader raises an error of its own kind.
        reason = f"OpenGL does not work here ({type(error).__name__}: {error})"
        raise MissingDependencyError(f"{reason}. Install it: {INSTALL}") from error
    context.enable(moderngl.DEPTH_TEST)
    return context
