"""Two ways to draw what a camera sees, behind one interface: OpenGL, and ray casting where there is none."""

from __future__ import annotations

import os
import warnings
from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from coopsim.checks import require_choice
from coopsim.errors import MissingDependencyError
from coopsim.geometry.se3 import SE3, Floats
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

INSTALL = "pip install 'coopsim[camera]', and on Debian: apt-get install libegl1 libgl1-mesa-dri libopengl0"


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
    try:
        return OpenGLRenderer(models, static, config)
    except Exception as error:
        # Whatever is missing (package, library, driver), its loader raises an error of its own kind.
        reason = f"OpenGL does not work here ({type(error).__name__}: {error})"
        if name == "opengl":
            raise MissingDependencyError(f"{reason}. Install it: {INSTALL}") from error
        warnings.warn(f"{reason}; cameras are ray-cast instead. For OpenGL: {INSTALL}", stacklevel=3)
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


class OpenGLRenderer(Renderer):
    """pyrender, off screen. One scene persists; a frame moves its nodes."""

    def __init__(self, models: Sequence[Model], static: Sequence[StaticPart], config: CameraConfig) -> None:
        if "DISPLAY" not in os.environ:
            os.environ.setdefault("PYOPENGL_PLATFORM", "egl")  # read once, when OpenGL is first imported
        import pyrender

        self._pyrender, self._models = pyrender, tuple(models)
        self._offscreen = pyrender.OffscreenRenderer(config.width, config.height)
        self._scene = pyrender.Scene(bg_color=[*(SKY / 255.0), 1.0], ambient_light=[AMBIENT] * 3)
        self._camera = self._scene.add(
            pyrender.IntrinsicsCamera(
                config.focal_px,
                config.focal_px,
                config.width / 2,
                config.height / 2,
                znear=config.near_m,
                zfar=config.far_m,
            )
        )
        sun = pyrender.DirectionalLight(color=np.ones(3), intensity=DIFFUSE * np.pi)
        self._scene.add(sun, pose=_facing(-SUN))
        for part in static:
            color = np.tile(np.array(part.color, dtype=np.uint8), (len(part.faces), 1))
            self._scene.add(self._mesh(part.vertices, part.faces, color))
        self._nodes: dict[int, Any] = {}
        self._looks: dict[int, tuple[int, ...]] = {}

    def update(self, actors: Actors, triangles: Triangles) -> None:
        # A new episode counts ids from the start again: what has another model or colour is another actor.
        rows = zip(actors.model.tolist(), *actors.color.T.tolist(), strict=True)
        looks: dict[int, tuple[int, ...]] = dict(zip(actors.id.tolist(), rows, strict=True))
        for gone in [actor for actor in self._nodes if looks.get(actor) != self._looks[actor]]:
            self._scene.remove_node(self._nodes.pop(gone))
        self._looks = looks
        boxes = actors.boxes
        for k, actor in enumerate(actors.id.tolist()):
            pose = np.eye(4)
            placed = SE3.from_xyz_yaw(boxes.center[k], float(boxes.yaw[k]))
            pose[:3, :3], pose[:3, 3] = placed.rotation, placed.translation
            if actor in self._nodes:
                self._scene.set_pose(self._nodes[actor], pose)
            else:
                self._nodes[actor] = self._scene.add(self._painted(actors, k, triangles), pose=pose)

    def render(self, world_SE3_camera: SE3, own_id: int | None) -> CameraImage:
        pose = np.eye(4)
        # OpenGL's camera looks along -z with y up.
        pose[:3, :3] = world_SE3_camera.rotation * np.array([1.0, -1.0, -1.0])
        pose[:3, 3] = world_SE3_camera.translation
        self._scene.set_pose(self._camera, pose)
        own = self._nodes.get(own_id) if own_id is not None else None
        if own is not None:
            own.mesh.is_visible = False
        try:
            rgb, _ = self._offscreen.render(self._scene)
            # The picture is smoothed over several samples a pixel, of which the depth would be an arbitrary one;
            # segmentation is drawn through the pixels' middles.
            everything = dict.fromkeys(self._scene.mesh_nodes, (1, 1, 1))
            _, depth = self._offscreen.render(self._scene, self._pyrender.RenderFlags.SEG, everything)
        finally:
            if own is not None:
                own.mesh.is_visible = True
        return CameraImage(rgb, depth)

    def close(self) -> None:
        self._offscreen.delete()

    def _painted(self, actors: Actors, k: int, triangles: Triangles) -> Any:
        """The actor's mesh in its own colour. Each has its own: hiding one must not hide its likes."""
        model = self._models[actors.model[k]]
        return self._mesh(model.vertices, model.faces, triangles.color[triangles.instance == actors.id[k]])

    def _mesh(self, vertices: Floats, faces: Any, face_color: Any) -> Any:
        pyrender = self._pyrender
        corners = vertices[faces]  # flat shading: every face has corners, normals and colours of its own
        normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-12)
        primitive = pyrender.Primitive(
            positions=corners.reshape(-1, 3).astype(np.float32),
            normals=np.repeat(normal, 3, axis=0).astype(np.float32),
            # pyrender takes colours for linear and writes sRGB.
            color_0=np.repeat((face_color.astype(np.float32) / 255.0) ** GAMMA, 3, axis=0),
            mode=4,  # triangles
            material=pyrender.MetallicRoughnessMaterial(metallicFactor=0.0, roughnessFactor=1.0, doubleSided=True),
        )
        return pyrender.Mesh([primitive])


def _facing(direction: Floats) -> Floats:
    """(4, 4) pose of a light that shines along `direction` (OpenGL's lights shine along -z)."""
    z = -direction / np.linalg.norm(direction)
    x = np.cross([0.0, 1.0, 0.0], z)
    x /= np.linalg.norm(x)
    pose = np.eye(4)
    pose[:3, :3] = np.column_stack([x, np.cross(z, x), z])
    return pose
