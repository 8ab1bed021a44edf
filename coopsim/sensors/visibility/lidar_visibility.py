"""Visibility of actors to a LiDAR: the rays that could end on each, those that do, and what hides the rest.

An actor that was alone in the world would get all rays that pass through it. The share of them that end on it is what
data sets such as nuScenes grade as visibility, there by camera pixels, here by the sensor's own rays.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from coopsim.geometry.se3 import Floats
from coopsim.sensors.lidar.lidar import LidarConfig
from coopsim.sensors.raycast import RayScene
from coopsim.sensors.visibility.crossings import count_crossings, height_span, join_crossings, trace_rays
from coopsim.sensors.visibility.ray_candidates import angles_of, reaches
from coopsim.support.arrays import frozen
from coopsim.types import Ints
from coopsim.world.snapshot import Actors, AgentBody


@dataclass(frozen=True, slots=True, eq=False)
class Visibility:
    """Visibility of N actors to one agent's LiDARs.

    Attributes:
        id: (N,) of the actors.
        returns: (N,) received, after drop-out.
        rays: (N,) that would end on each actor if it were alone in the world.
        visible: (N,) share of `rays` that do end on it, in [0, 1]; 0 where there are none.
        occluder: (N,) id of what most of its other rays end on: an actor (the agent's own body is one), `STATIC_ID` for
            scenery, or `NOTHING`. Of several that hide as many rays, the one with the largest id.
    """

    id: Ints
    returns: Ints
    rays: Ints
    visible: Floats
    occluder: Ints

    def __post_init__(self) -> None:
        count = len(self.id)
        for name in ("id", "returns", "rays", "occluder"):
            object.__setattr__(self, name, frozen(getattr(self, name), (count,), np.int64, name))
        object.__setattr__(self, "visible", frozen(self.visible, (count,), np.float64, "visible"))


class VisibilityProbe:
    """Measures visibility for agents that carry the same LiDARs; the rays of all of them count.

    Args:
        configs: the sensors. A revolution that takes time is measured at its end.
    """

    def __init__(self, configs: Sequence[LidarConfig]) -> None:
        directions = [config.beams.directions(config.columns) for config in configs]
        self._sensors = [(config, rays, angles_of(rays)) for config, rays in zip(configs, directions, strict=True)]

    def measure(self, scene: RayScene, body: AgentBody, actors: Actors, returns: Ints) -> Visibility:
        """Measure the visibility of all actors but the agent itself.

        Args:
            scene: the frame's triangles.
            body: the agent.
            actors: those in the scene, N of them, in the world frame.
            returns: (N,) from each that the agent's LiDARs received.
        """
        other = np.ones(len(actors), np.bool_) if body.actor_id is None else actors.id != body.actor_id
        others, parts = actors[other], []
        for config, directions, (azimuth_rad, elevation_rad) in self._sensors:
            world_SE3_sensor = body.world_SE3_base.compose(config.base_SE3_sensor(body.height_m))
            origin_m, turn = world_SE3_sensor.translation, world_SE3_sensor.rotation
            if turn[2, 2] == 1:  # the sensor is upright
                angles = azimuth_rad + world_SE3_sensor.yaw, elevation_rad
            else:
                angles = angles_of(world_SE3_sensor.rotate(directions))
            reach_m = reaches(others.boxes, origin_m, *angles)
            cast = np.flatnonzero(reach_m)
            range_m = config.min_range_m, np.minimum(reach_m[cast], config.max_range_m)
            rays = world_SE3_sensor.rotate(directions[cast])
            parts.append(trace_rays(scene, origin_m, rays, range_m, height_span(others)))
        crossings = join_crossings(parts, [len(directions) for _, directions, _ in self._sensors])
        return Visibility(others.id, returns[other], *count_crossings(crossings, others.id))
