"""Pinhole cameras: where they are, and how agents carry them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from coopsim.arrays import frozen, require_finite
from coopsim.checks import require_count, require_positive
from coopsim.errors import InvalidValueError
from coopsim.geometry.se3 import SE3, Floats
from coopsim.sensors.geometry import SceneGeometry
from coopsim.sensors.renderers import Renderer, make_renderer
from coopsim.types import CameraImage
from coopsim.world.snapshot import Actors, AgentBody, Model, StaticPart

CAMERAS: Mapping[str, float] = {"front": 0.0, "left": np.pi / 2, "rear": np.pi, "right": -np.pi / 2}
"""Names of an agent's cameras, and the heading (rad) of each in the agent's base frame."""


@dataclass(frozen=True, slots=True)
class CameraConfig:
    """An ideal pinhole camera; all of a rig are alike.

    Attributes:
        width: pixels.
        height: pixels.
        horizontal_fov_rad: opening angle, in (0, pi).
        above_m: height over the agent's body.
        near_m: nearest thing that is drawn.
        far_m: farthest thing that is drawn.
        unit_pitch_rad: how far the cameras of a roadside unit look down.
    """

    width: int = 320
    height: int = 180
    horizontal_fov_rad: float = np.radians(100.0)
    above_m: float = 0.15
    near_m: float = 0.2
    far_m: float = 300.0
    unit_pitch_rad: float = np.radians(20.0)

    def __post_init__(self) -> None:
        require_count(1, width=self.width, height=self.height)
        require_positive(horizontal_fov_rad=self.horizontal_fov_rad, near_m=self.near_m, far_m=self.far_m)
        mount = frozen([self.above_m, self.unit_pitch_rad], (2,), np.float64, "above_m and unit_pitch_rad")
        require_finite(mount, "above_m and unit_pitch_rad")
        if self.horizontal_fov_rad >= np.pi:
            raise InvalidValueError(f"horizontal_fov_rad must be in (0, pi), got {self.horizontal_fov_rad!r}")
        if self.near_m >= self.far_m:
            raise InvalidValueError(f"0 < near_m < far_m is needed, got {self.near_m!r} and {self.far_m!r}")

    @property
    def focal_px(self) -> float:
        """Focal length in pixels; pixels are square."""
        return float(self.width / 2 / np.tan(self.horizontal_fov_rad / 2))

    def rays(self) -> Floats:
        """(H * W, 3) directions through the pixels' middles, row by row, in camera axes, 1 along the optical axis.

        Camera axes are OpenCV's: x right, y down, z forward.
        """
        columns = (np.arange(self.width) + 0.5 - self.width / 2) / self.focal_px
        rows = (np.arange(self.height) + 0.5 - self.height / 2) / self.focal_px
        x, y = np.meshgrid(columns, rows)
        return np.stack([x, y, np.ones_like(x)], axis=-1).reshape(-1, 3)


class CameraRig:
    """Four cameras on top of every agent, looking ahead, left, back and right.

    Args:
        models: that actors' `model` counts into.
        static: the scenery.
        config: of all cameras.
        renderer: "auto" (OpenGL if it works, else ray casting, with one warning), "opengl" or "raycast".
    """

    def __init__(
        self,
        models: Sequence[Model],
        static: Sequence[StaticPart],
        config: CameraConfig | None = None,
        renderer: str = "auto",
    ) -> None:
        self.config = config or CameraConfig()
        self._geometry = SceneGeometry(models, static)
        self._renderer: Renderer = make_renderer(renderer, models, static, self.config)

    @staticmethod
    def sizes(config: CameraConfig | None = None) -> dict[str, tuple[int, int]]:
        """Height and width of each camera's image, by name."""
        config = config or CameraConfig()
        return dict.fromkeys(CAMERAS, (config.height, config.width))

    def render(self, actors: Actors, agents: Mapping[str, AgentBody]) -> dict[str, dict[str, CameraImage]]:
        """What every agent's cameras see, by agent and camera. An agent's own body is not in its pictures."""
        self._renderer.update(actors, self._geometry.triangles(actors))
        return {
            name: {
                camera: self._renderer.render(
                    body.world_SE3_base.compose(self.base_SE3_camera(body, heading)), body.actor_id
                )
                for camera, heading in CAMERAS.items()
            }
            for name, body in agents.items()
        }

    def base_SE3_camera(self, body: AgentBody, heading_rad: float) -> SE3:
        """Where a camera is on an agent; camera axes are OpenCV's (x right, y down, z forward)."""
        pitch = self.config.unit_pitch_rad if body.kind == "rsu" else 0.0
        level = SE3.from_xyz_yaw([0.0, 0.0, body.height_m + self.config.above_m], heading_rad)
        cos, sin = np.cos(pitch), np.sin(pitch)
        # Columns: the camera's x, y, z in the axes of something that looks ahead with x forward, y left, z up.
        axes = np.array([[0.0, -sin, cos], [-1.0, 0.0, 0.0], [0.0, -cos, -sin]])
        return level.compose(SE3(axes, np.zeros(3)))

    def close(self) -> None:
        """Release the renderer's resources."""
        self._renderer.close()
