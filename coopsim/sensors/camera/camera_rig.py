"""Pictures of all agents' cameras in a frame."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from coopsim.sensors.camera.camera import Camera
from coopsim.sensors.camera.daylight import DAYLIGHTS, Illumination
from coopsim.sensors.camera.picture import FramePainter
from coopsim.sensors.camera.renderer import Renderer
from coopsim.sensors.scene import Triangles
from coopsim.types import CameraImage
from coopsim.types.sensing import OBSERVED_MODES
from coopsim.world.snapshot import Actors, AgentBody


class CameraRig:
    """The cameras of all agents.

    Args:
        cameras: of each agent, by its name.
        renderer: draws the frames (see `coopsim.sensors.camera.renderers.choice.make_renderer`).
        modes: contents of the pictures, of `coopsim.sensors.camera.picture.MODES`.
        illumination: None is a clear day.
    """

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
        """Return the pictures of a frame, by agent and camera. An agent's own body is not in its pictures.

        Args:
            triangles: the frame, in the world frame.
            actors: in the frame.
            agents: whose cameras draw.
        """
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
