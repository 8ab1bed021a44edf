"""Cameras drawn by OpenGL, through pyrender, off screen."""

from __future__ import annotations

import os
from collections.abc import Sequence
from importlib import import_module
from typing import TYPE_CHECKING, Any

import numpy as np

from coopsim.errors import MissingDependencyError
from coopsim.geometry.se3 import SE3, Floats
from coopsim.sensors.geometry import Triangles, static_triangles
from coopsim.sensors.renderers import AMBIENT, DIFFUSE, GAMMA, SKY, SUN, Renderer
from coopsim.types import CameraImage
from coopsim.world.snapshot import Actors, Model, StaticPart

if TYPE_CHECKING:
    from coopsim.sensors.camera import CameraConfig

INSTALL = "pip install 'coopsim[camera]', and on Debian: apt-get install libegl1 libgl1-mesa-dri libopengl0"


class OpenGLRenderer(Renderer):
    """pyrender, off screen. One scene persists; a frame moves its nodes."""

    def __init__(self, models: Sequence[Model], static: Sequence[StaticPart], config: CameraConfig) -> None:
        self._offscreen = _offscreen(config)
        import pyrender

        self._pyrender, self._models = pyrender, tuple(models)
        self._pose_counts = np.array([len(model.poses) for model in self._models], dtype=np.int64)
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
        if static:  # in one piece: each mesh costs a call of its own, in every picture
            scenery = static_triangles(static)
            self._scene.add(self._mesh(scenery.vertices, scenery.faces, scenery.color))
        self._nodes: dict[int, Any] = {}
        self._looks: dict[int, list[int]] = {}

    def update(self, actors: Actors, triangles: Triangles) -> None:
        # A new episode counts ids from the start again: what has another model or colour is another actor. Who walks
        # is drawn anew in every pose.
        pose = actors.pose(self._pose_counts)
        rows = np.column_stack([actors.model, pose, actors.color, actors.accent]).tolist()
        looks: dict[int, list[int]] = dict(zip(actors.id.tolist(), rows, strict=True))
        for gone in [actor for actor in self._nodes if looks.get(actor) != self._looks[actor]]:
            self._scene.remove_node(self._nodes.pop(gone))
        self._looks = looks
        boxes = actors.boxes
        for k, actor in enumerate(actors.id.tolist()):
            place = np.eye(4)
            placed = SE3.from_xyz_yaw(boxes.center[k], float(boxes.yaw[k]))
            place[:3, :3], place[:3, 3] = placed.rotation, placed.translation
            if actor in self._nodes:
                self._scene.set_pose(self._nodes[actor], place)
            else:
                model = self._models[actors.model[k]]
                color = triangles.color[triangles.instance == actor]
                # Each has its own mesh: hiding one must not hide its likes.
                self._nodes[actor] = self._scene.add(self._mesh(model.poses[pose[k]], model.faces, color), pose=place)

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
        if self._offscreen is not None:
            self._offscreen.delete()
            self._offscreen = None

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


def _offscreen(config: CameraConfig) -> Any:
    """Something of pyrender's that draws pictures of the camera's size.

    Raises:
        MissingDependencyError: says what is missing and what to install.
    """
    if "DISPLAY" not in os.environ:
        os.environ.setdefault("PYOPENGL_PLATFORM", "egl")  # read once, when OpenGL is first imported
    try:
        import pyrender

        offscreen = pyrender.OffscreenRenderer(config.width, config.height)
    except Exception as error:
        # Whatever is missing (package, library, driver), its loader raises an error of its own kind.
        reason = f"OpenGL does not work here ({type(error).__name__}: {error})"
        raise MissingDependencyError(f"{reason}. Install it: {INSTALL}") from error
    _leave_display_to_last(offscreen._platform)
    return offscreen


_IN_USE: set[Any] = set()
"""Platforms (in pyrender's sense) whose display must stay."""


def _leave_display_to_last(platform: Any) -> None:
    """Let renderers close one by one: pyrender ends EGL for all of the process as soon as one of them closes."""
    if not hasattr(platform, "_egl_display"):
        return  # a window system's
    delete_all = platform.delete_context
    _IN_USE.add(platform)

    def delete_own() -> None:
        _IN_USE.discard(platform)
        if _IN_USE:
            import_module("OpenGL.EGL").eglDestroyContext(platform._egl_display, platform._egl_context)
            platform._egl_display = None  # which leaves pyrender nothing to end
        delete_all()

    platform.delete_context = delete_own
