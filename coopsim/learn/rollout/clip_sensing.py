"""The sensors of a clip's agents: LiDARs, cameras and odometry."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from coopsim.learn.clips.clip import AgentScene, Picture, Scene
from coopsim.learn.clips.compact_points import round_points
from coopsim.learn.rollout.clip_pictures import ClipPictures
from coopsim.learn.rollout.clip_world import ClipWorld
from coopsim.localization.localizer import LocalizationConfig, Localizer
from coopsim.sensors.lidar.lidar import Lidar
from coopsim.sensors.lidar.tally import count_returns
from coopsim.sensors.raycast import RayScene
from coopsim.sensors.scene import SceneGeometry
from coopsim.support.rng import stream
from coopsim.types import Ints, Sweep, stack_xyz_yaw
from coopsim.world.snapshot import AgentBody, WorldSource

_LIDAR = "lidar"
_DRONE_PITCH_RAD = math.pi / 4  # by which drones' LiDARs look down, as in environments


class ClipSensing:
    """Senses a world, frame by frame, with the random streams of environments. Close it at the clip's end.

    Args:
        drawn: says which LiDAR, cameras, weather and seed.
        world: at the clip's first frame.
    """

    def __init__(self, drawn: ClipWorld, world: WorldSource) -> None:
        self._world = world
        self._geometry = SceneGeometry(world.models, world.static)
        looks_down = replace(drawn.lidar, pitch_rad=drawn.lidar.pitch_rad + _DRONE_PITCH_RAD)
        bodies, on_ground = world.agents(), Lidar(drawn.lidar, drawn.weather)
        in_air = (
            Lidar(looks_down, drawn.weather) if any(body.kind == "drone" for body in bodies.values()) else on_ground
        )
        self._lidars = {"cav": on_ground, "rsu": on_ground, "drone": in_air}
        self._rngs = {name: stream(drawn.seed, "lidar", name, _LIDAR) for name in bodies}
        self._localizers = {
            name: Localizer(LocalizationConfig(), drawn.seed, name, drawn.dt_s, stands=body.kind == "rsu")
            for name, body in bodies.items()
        }
        self._cameras = ClipPictures(drawn, bodies) if drawn.cameras else None

    def sense(self, time_ns: int) -> Scene:
        """Return the scene as it is now; called once in each frame, in order."""
        actors, bodies = self._world.actors(), self._world.agents()
        triangles = self._geometry.triangles(actors)
        rays = RayScene(triangles)
        sweeps = [self._sweep(rays, body) for body in bodies.values()]
        pictures, pixels = self._cameras.take(triangles, actors, bodies) if self._cameras else ({}, None)
        return Scene(
            time_ns=time_ns,
            agents=tuple(
                self._agent(body, sweep, pictures.get(body.name, ()))
                for body, sweep in zip(bodies.values(), sweeps, strict=True)
            ),
            object_id=actors.id,
            boxes=actors.boxes.array,
            velocity=actors.velocity,
            label=actors.label,
            returns=_returns(actors.id, list(bodies.values()), sweeps),
            pixels=pixels,
        )

    def close(self) -> None:
        """Release the cameras' resources."""
        if self._cameras is not None:
            self._cameras.close()

    def _sweep(self, rays: RayScene, body: AgentBody) -> Sweep:
        lidar = self._lidars[body.kind]
        return lidar.sense(rays, body.world_SE3_base, body.height_m, body.actor_id, self._rngs[body.name])

    def _agent(self, body: AgentBody, sweep: Sweep, pictures: tuple[Picture, ...]) -> AgentScene:
        pose = body.world_SE3_base
        _, odometry = self._localizers[body.name].localize(pose)
        points: NDArray[np.float32] = np.column_stack([sweep.points, sweep.intensity])
        return AgentScene(
            body.name, body.kind, stack_xyz_yaw(pose), odometry.xyz_yaw, round_points(points), body.actor_id, pictures
        )


def _returns(ids: Ints, bodies: list[AgentBody], sweeps: list[Sweep]) -> Ints:
    """Return the number of returns (N, A) that each agent has from each object but itself."""
    returns = np.stack([count_returns({_LIDAR: sweep}, ids) for sweep in sweeps], axis=1)
    for column, body in enumerate(bodies):
        if body.actor_id is not None:
            returns[ids == body.actor_id, column] = 0
    return returns
