"""Images of cameras: colour, depth, instance and class by the triangle and depth that each pixel sees."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from coopsim.errors import InvalidValueError
from coopsim.sensors.camera.camera import Camera
from coopsim.sensors.camera.daylight import DAYLIGHTS, GAMMA, Illumination, to_srgb
from coopsim.sensors.camera.intrinsics import Intrinsics
from coopsim.sensors.camera.renderer import PixelHits, Renderer
from coopsim.sensors.scene import STATIC_ID, Triangles
from coopsim.support.checks import require_choice
from coopsim.types import CameraImage
from coopsim.types.sensing import OBSERVED_MODES, TRUTH_MODES
from coopsim.world.snapshot import Actors, AgentBody

MODES = OBSERVED_MODES + TRUTH_MODES

NO_CLASS = 255
"""Class of scenery and sky in a semantic image."""


def require_modes(modes: object) -> tuple[str, ...]:
    """Return the names of modes as a tuple; raise unless there is at least one, and each once."""
    accepted = f"different names out of {', '.join(MODES)}, at least one"
    if isinstance(modes, str) or not isinstance(modes, Sequence) or not modes:
        raise InvalidValueError(f"camera_modes must be {accepted}; got {modes!r}")
    for mode in modes:
        require_choice("camera_modes", mode, MODES)
    if len(set(modes)) < len(modes):
        raise InvalidValueError(f"camera_modes must be {accepted}; got {modes!r}")
    return tuple(modes)


class FramePainter:
    """Images of views, frame by frame, in some of `MODES`.

    Colour, instance and class are computed once per frame and face, and looked up per pixel. The last row of every
    table is the sky, which a view's -1 selects.
    """

    def __init__(self, illumination: Illumination, modes: Sequence[str]) -> None:
        self._light, self._modes = illumination, require_modes(modes)
        self._haze = illumination.extinction_per_m > 0
        self._shade: NDArray[np.float32]
        self._rgb: NDArray[np.uint8]
        self._instance: NDArray[np.int64]
        self._semantic: NDArray[np.uint8]

    def update(self, actors: Actors, triangles: Triangles) -> None:
        """Take over a new frame, as actors and as triangles."""
        if "rgb" in self._modes:
            sky = self._light.sky.astype(np.float32)
            shade = self._light.shade(triangles.color, triangles.normals)
            shade[triangles.shining] = (triangles.color[triangles.shining] / 255.0) ** GAMMA
            self._shade = np.vstack([shade, sky])
            self._rgb = to_srgb(self._shade)
        instance = np.append(triangles.instance, STATIC_ID)
        self._instance = instance
        order = np.argsort(actors.id)
        ids, labels = actors.id[order], actors.label[order]
        row = np.searchsorted(ids, instance)
        labels = np.append(labels, NO_CLASS)  # for instances beyond the last id
        self._semantic = np.where(instance == STATIC_ID, NO_CLASS, labels[row]).astype(np.uint8)

    def paint(self, view: PixelHits, intrinsics: Intrinsics) -> CameraImage:
        """Return the image of a view through a camera with these intrinsics."""
        wanted = self._modes
        return CameraImage(
            rgb=self._colored(view, intrinsics) if "rgb" in wanted else None,
            depth=view.depth if "depth" in wanted else None,
            instance=self._instance[view.face] if "instance" in wanted else None,
            semantic=self._semantic[view.face] if "semantic" in wanted else None,
        )

    def _colored(self, view: PixelHits, intrinsics: Intrinsics) -> NDArray[np.uint8]:
        if not self._haze:
            return self._rgb[view.face]
        # The sky is infinitely far: its light is the light that the air scatters, so depth 0 does no harm.
        distance_m = view.depth * intrinsics.stretch
        through = np.exp(-self._light.extinction_per_m * distance_m)[..., None]
        airlight = self._shade[-1]
        return to_srgb(airlight + through * (self._shade[view.face] - airlight))


class CameraRig:
    """Cameras of all agents, by agent's name. Without an illumination it is a clear day."""

    def __init__(
        self,
        cameras: Mapping[str, Sequence[Camera]],
        renderer: Renderer,
        *,
        modes: Sequence[str] = OBSERVED_MODES,
        illumination: Illumination | None = None,
    ) -> None:
        self._cameras, self._renderer = cameras, renderer
        self._painter = FramePainter(illumination or Illumination(DAYLIGHTS.get("day")), modes)

    @property
    def renderer(self) -> str:
        """Name of the renderer: "opengl", "raycast" or "pyrender"."""
        return self._renderer.name

    def render(
        self, triangles: Triangles, actors: Actors, agents: Mapping[str, AgentBody]
    ) -> dict[str, dict[str, CameraImage]]:
        """Return the images of a frame, by agent and camera. An agent's own body is not in its images."""
        self._renderer.update(triangles)
        self._painter.update(actors, triangles)
        return {
            name: {camera.name: self._shoot(camera, body) for camera in self._cameras.get(name, ())}
            for name, body in agents.items()
        }

    def _shoot(self, camera: Camera, body: AgentBody) -> CameraImage:
        pose = body.world_SE3_base.compose(camera.base_SE3_camera(body.height_m))
        return self._painter.paint(self._renderer.see(camera, pose, body.actor_id), camera.intrinsics)

    def close(self) -> None:
        """Release the renderer's resources."""
        self._renderer.close()
