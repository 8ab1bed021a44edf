"""Cameras: where they are on an agent, and what those of all agents see in a frame."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from coopsim.errors import InvalidValueError, UnknownNameError
from coopsim.geometry.se3 import SE3
from coopsim.sensors.camera.daylight import DAYLIGHTS, Daylight, Illumination
from coopsim.sensors.camera.intrinsics import Intrinsics
from coopsim.sensors.camera.picture import FramePainter
from coopsim.sensors.camera.renderers.renderers import Renderer, make_renderer
from coopsim.sensors.limits import FARTHEST_M, FARTHEST_MOUNT_M, NEAREST_M
from coopsim.sensors.scene import Triangles
from coopsim.support.checks import require_between, require_finite_number
from coopsim.types import CameraCalibration, CameraImage
from coopsim.types.sensing import OBSERVED_MODES
from coopsim.world.snapshot import Actors, AgentBody


@dataclass(frozen=True, slots=True)
class Camera:
    """A camera, and where an agent carries it.

    Attributes:
        name: unique in its rig.
        intrinsics: its lens and chip.
        x_m: ahead of the agent's middle. This and the next two are in [-100, 100].
        y_m: to the left of it.
        above_m: height over the agent's body; negative below its top.
        yaw_rad: to the left.
        pitch_rad: downwards.
        roll_rad: clockwise, seen from behind.
        near_m: what is nearer along the optical axis is not drawn; at least 0.001.
        far_m: what is farther is not drawn; at most 10 km.

    Raises:
        InvalidValueError: a number that is not accepted, or a name that is none.
    """

    name: str
    intrinsics: Intrinsics = field(default_factory=Intrinsics.from_fov)
    x_m: float = 0.0
    y_m: float = 0.0
    above_m: float = 0.15
    yaw_rad: float = 0.0
    pitch_rad: float = 0.0
    roll_rad: float = 0.0
    near_m: float = 0.2
    far_m: float = 300.0

    def __post_init__(self) -> None:
        if not (isinstance(self.name, str) and self.name.isidentifier()):
            raise InvalidValueError(f"name of a camera must be a word, as 'front_left', got {self.name!r}")
        if not isinstance(self.intrinsics, Intrinsics):
            raise InvalidValueError(
                f"intrinsics of camera {self.name!r} must be Intrinsics, as Intrinsics.from_fov(320, 180), "
                f"got {self.intrinsics!r}"
            )
        of = f"of camera {self.name!r}"
        for place in ("x_m", "y_m", "above_m"):
            require_between(-FARTHEST_MOUNT_M, FARTHEST_MOUNT_M, **{f"{place} {of}": getattr(self, place)})
        for turn in ("yaw_rad", "pitch_rad", "roll_rad"):
            require_finite_number(**{f"{turn} {of}": getattr(self, turn)})
        require_between(NEAREST_M, FARTHEST_M, **{f"near_m {of}": self.near_m, f"far_m {of}": self.far_m})
        if self.near_m >= self.far_m:
            raise InvalidValueError(f"near_m must be less than far_m {of}, got {self.near_m!r} and {self.far_m!r}")

    def base_SE3_camera(self, body_height_m: float) -> SE3:
        """Where it is on an agent of this height; camera axes are OpenCV's (x right, y down, z forward)."""
        cos, sin = np.cos(self.pitch_rad), np.sin(self.pitch_rad)
        mount = SE3.from_xyz_yaw([self.x_m, self.y_m, body_height_m + self.above_m], self.yaw_rad)
        # Columns: the camera's x, y, z in the axes of something that looks ahead with x forward, y left, z up.
        pitched = np.array([[0.0, -sin, cos], [-1.0, 0.0, 0.0], [0.0, -cos, -sin]])
        cos, sin = np.cos(self.roll_rad), np.sin(self.roll_rad)
        rolled = np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
        return mount.compose(SE3(pitched @ rolled, np.zeros(3)))

    def calibration(self, body_height_m: float) -> CameraCalibration:
        """What a policy may know of it, on an agent of this height."""
        lens = self.intrinsics
        return CameraCalibration(lens.size, lens.matrix, np.array(lens.distortion), self.base_SE3_camera(body_height_m))


class CameraRig:
    """The cameras of all agents. What they look at persists; a frame moves it.

    Args:
        cameras: of each agent, by its name.
        modes: what pictures consist of, of `coopsim.sensors.camera.picture.MODES`.
        renderer: "auto" (OpenGL if it works, else ray casting, with one warning), "opengl", "raycast" or "pyrender".
        illumination: None is a clear day.
    """

    def __init__(
        self,
        cameras: Mapping[str, Sequence[Camera]],
        *,
        modes: Sequence[str] = OBSERVED_MODES,
        renderer: str = "auto",
        illumination: Illumination | None = None,
    ) -> None:
        self._cameras = cameras
        light = illumination or Illumination(DAYLIGHTS.get("day"))
        self._painter = FramePainter(light, modes)
        self._renderer: Renderer = make_renderer(renderer)

    @property
    def renderer(self) -> str:
        """What draws: "opengl", "raycast" or "pyrender"."""
        return self._renderer.name

    def render(
        self, triangles: Triangles, actors: Actors, agents: Mapping[str, AgentBody]
    ) -> dict[str, dict[str, CameraImage]]:
        """What every agent's cameras see, by agent and camera. An agent's own body is not in its pictures.

        Args:
            triangles: the frame, in the world frame.
            actors: those that are in it.
            agents: who looks; of others' cameras nothing is drawn.
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


def as_daylight(time_of_day: object) -> Daylight:
    """A `Daylight`, or the one of that name.

    Raises:
        UnknownNameError: there is none.
    """
    if isinstance(time_of_day, Daylight):
        return time_of_day
    if not isinstance(time_of_day, str):
        raise UnknownNameError("time_of_day", time_of_day, DAYLIGHTS.names())
    return DAYLIGHTS.get(time_of_day)
