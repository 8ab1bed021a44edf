"""Visibility of actors to an agent's cameras: the pixels that could show each, those that do, and what hides the rest.

The same as `coopsim.sensors.visibility.lidar_visibility`, by one ray through the middle of each pixel.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from coopsim.geometry.se3 import Floats
from coopsim.sensors.camera.camera import Camera
from coopsim.sensors.raycast import RayScene
from coopsim.sensors.visibility.crossings import (
    NOTHING,
    Crossings,
    count_crossings,
    height_span,
    join_crossings,
    trace_rays,
)
from coopsim.sensors.visibility.ray_candidates import angles_of, reaches
from coopsim.support.arrays import frozen
from coopsim.types import Ints
from coopsim.world.snapshot import Actors, AgentBody


@dataclass(frozen=True, slots=True, eq=False)
class PixelVisibility:
    """Visibility of N actors to one agent's cameras together.

    Attributes:
        id: (N,) of the actors.
        pixels: (N,) that would show each actor if it were alone in the world.
        visible: (N,) share of `pixels` that do show it, in [0, 1]; 0 where there are none.
        occluder: (N,) id of what most of its other pixels show, as in `Visibility`.
    """

    id: Ints
    pixels: Ints
    visible: Floats
    occluder: Ints

    def __post_init__(self) -> None:
        count = len(self.id)
        for name in ("id", "pixels", "occluder"):
            object.__setattr__(self, name, frozen(getattr(self, name), (count,), np.int64, name))
        object.__setattr__(self, "visible", frozen(self.visible, (count,), np.float64, "visible"))


def measure_pixels(cameras: Sequence[Camera], scene: RayScene, body: AgentBody, actors: Actors) -> PixelVisibility:
    """Measure the visibility of all actors but the agent itself, whose own body is not in its pictures.

    Args:
        cameras: the agent's.
        scene: the frame's triangles.
        body: the agent.
        actors: those in the scene, N of them, in the world frame.
    """
    others = actors if body.actor_id is None else actors[actors.id != body.actor_id]
    parts = [_crossings(camera, scene, body, others) for camera in cameras]
    crossings = join_crossings(parts, [camera.intrinsics.width * camera.intrinsics.height for camera in cameras])
    return PixelVisibility(others.id, *count_crossings(crossings, others.id))


def _crossings(camera: Camera, scene: RayScene, body: AgentBody, others: Actors) -> Crossings:
    pose, lens = body.world_SE3_base.compose(camera.base_SE3_camera(body.height_m)), camera.intrinsics
    rays = pose.rotate(lens.unit_rays)
    reach_m = reaches(others.boxes, pose.translation, *angles_of(rays))
    ahead = np.flatnonzero(reach_m)
    start_m = pose.apply(camera.near_m * lens.rays[ahead])
    far_m = (camera.far_m - camera.near_m) * lens.stretch.reshape(-1)[ahead].astype(np.float64)
    range_m = 0.0, np.minimum(far_m, reach_m[ahead])
    own = NOTHING if body.actor_id is None else body.actor_id
    return trace_rays(scene, start_m, rays[ahead], range_m, height_span(others), own)
