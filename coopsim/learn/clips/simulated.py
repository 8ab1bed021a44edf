"""Clips from the simulator: the world, its LiDARs, its cameras, frame by frame."""

from __future__ import annotations

import hashlib
import math
import warnings
from collections.abc import Iterator, Mapping
from contextlib import closing
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from numpy.typing import NDArray

from coopsim.errors import CrowdedWarning
from coopsim.geometry.se3 import Floats
from coopsim.learn.clips.arrays import round_points
from coopsim.learn.clips.clip import BLOCK, AgentScene, Clip, Picture, Scene, nearest_in_blocks
from coopsim.learn.clips.left_hand import in_mirror
from coopsim.learn.clips.world import ClipWorld, draw_world
from coopsim.learn.clips.world_recipe import WorldRecipe
from coopsim.localization.localizer import LocalizationConfig, Localizer
from coopsim.sensors.camera.daylight import DAYLIGHTS, Illumination
from coopsim.sensors.camera.picture import MODES, CameraRig
from coopsim.sensors.camera.renderers import make_renderer
from coopsim.sensors.lidar.lidar import Lidar
from coopsim.sensors.lidar.returns import count_instances, count_returns
from coopsim.sensors.scene import RayScene, SceneGeometry, Triangles
from coopsim.support.checks import require_count
from coopsim.support.rng import require_seed, stream
from coopsim.types import CameraCalibration, CameraImage, Ints, Sweep, seconds_to_ns, stack_xyz_yaw
from coopsim.world.snapshot import Actors, AgentBody, WorldSource
from coopsim.world.world import World


@dataclass(frozen=True, slots=True)
class SimulatedClips:
    """Clips of worlds that are drawn from a recipe; the agents' cars are driven by the traffic.

    A frame is what an environment of the same world shows, bit by bit but for the rounding of points; of a clip with
    traffic on the left, what it shows in a mirror. No environment is made, which would sense also before a clip's
    start, exchange, score and pack.

    Another seed gives other clips.
    """

    recipe: WorldRecipe
    seed: int = 0

    def __post_init__(self) -> None:
        require_seed(self.seed)

    def clip(self, index: int) -> Clip:
        """Return a clip: the same bits for the same recipe, seed and index, in any process and any order.

        Images are the same bits only with the same renderer: OpenGL where it works, else ray casting.

        Raises:
            InvalidValueError: the index is no count, or the recipe asks for agents that a place has no room for.
        """
        require_count(0, index=index)
        with warnings.catch_warnings():
            # A drawn density asks for more than some places hold; there are then as many as fit, which is as good.
            warnings.simplefilter("ignore", CrowdedWarning)
            drawn = draw_world(self.recipe, self.seed, int(index))
            scenes = tuple(_scenes(drawn, self.recipe.frames))
        place = drawn.scenario.name if drawn.scenario.place_seed is None else f"town {drawn.scenario.place_seed}"
        recipe = hashlib.sha256(repr(self.recipe).encode()).hexdigest()[:8]
        clip = Clip(f"{place}, recipe {recipe}, seed {self.seed}, clip {index}", drawn.dt_s, scenes)
        return in_mirror(clip) if drawn.is_left_hand else clip


def _scenes(drawn: ClipWorld, frames: int) -> Iterator[Scene]:
    world = World(drawn.scenario, drawn.seed)
    if drawn.start_s > 0:
        world.step(drawn.start_s)
    with closing(ClipSensing(drawn, world)) as sensing:
        for step_s, time_s in _steps(drawn, frames):
            if step_s:
                world.step(step_s)
            yield sensing.sense(seconds_to_ns(time_s))


def _steps(drawn: ClipWorld, frames: int) -> Iterator[tuple[float, float]]:
    """Yield the time since the scene before and that since the first one, of frames and the sweeps before them."""
    wait_s, early_s = drawn.dt_s, drawn.sweep_s
    for frame in range(frames):
        yield (wait_s - (early_s or 0.0) if frame else 0.0), frame * wait_s
        if early_s is not None:
            yield early_s, frame * wait_s + early_s


_LIDAR = "lidar"
_DRONE_PITCH_RAD = math.pi / 4  # of drones' LiDARs downwards, as in environments


class ClipSensing:
    """Sensors of a world at a clip's first frame, with the random streams of environments. Close it at the end."""

    def __init__(self, drawn: ClipWorld, world: WorldSource) -> None:
        self._world, self._realism, self._drawn = world, drawn.realism, drawn
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
        scale = None
        if self._realism is not None:
            carriers = [body.actor_id for body in bodies.values() if body.actor_id is not None]
            actors, scale = self._realism.sized(actors, np.isin(actors.id, carriers))
        triangles = self._geometry.triangles(actors, scale, self._world.map.lights)
        if self._realism is not None:
            triangles = self._realism.painted(triangles, actors)
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
            boxes=self._lifted(actors.boxes.array),
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
        lidar, own_id = self._lidars[body.kind], None if self._drawn.sees_carrier else body.actor_id
        under_m = self._drawn.under_lidar_m(body.kind, body.height_m)
        return lidar.sense(rays, body.world_SE3_base, under_m, own_id, self._rngs[body.name])

    def _agent(self, body: AgentBody, sweep: Sweep, pictures: tuple[Picture, ...]) -> AgentScene:
        pose = body.world_SE3_base
        _, odometry = self._localizers[body.name].localize(pose)
        points: NDArray[np.float32] = np.column_stack([sweep.points, sweep.intensity])
        at = self._lifted(stack_xyz_yaw(pose))
        if self._realism is not None:
            there = pose.apply(points[:, :3])[:, :2]
            points[:, 2] += self._realism.ground.heights(there) - (at[2] - pose.translation[2])
        return AgentScene(body.name, body.kind, at, odometry.xyz_yaw, round_points(points), body.actor_id, pictures)

    def _lifted(self, rows: Floats) -> Floats:
        """Return rows (..., K) that begin with x, y, z in the world, by as much higher as the ground is there."""
        if self._realism is None:
            return rows
        lifted = rows.copy()
        lifted[..., 2] += self._realism.ground.heights(rows[..., :2].reshape(-1, 2)).reshape(rows.shape[:-1])
        return lifted


def _returns(ids: Ints, bodies: list[AgentBody], sweeps: list[Sweep]) -> Ints:
    """Return the number of returns (N, A) that each agent has from each object but itself."""
    returns = np.stack([count_returns({_LIDAR: sweep}, ids) for sweep in sweeps], axis=1)
    for column, body in enumerate(bodies):
        if body.actor_id is not None:
            returns[ids == body.actor_id, column] = 0
    return returns


class ClipPictures:
    """Cameras of a clip's agents, for the thread in which it was made. Close it at the clip's end."""

    def __init__(self, drawn: ClipWorld, bodies: Mapping[str, AgentBody]) -> None:
        rigs = {name: drawn.cameras[body.kind] for name, body in bodies.items()}
        self._calibrations = {
            name: [camera.calibration(bodies[name].height_m) for camera in cameras] for name, cameras in rigs.items()
        }
        light = Illumination(DAYLIGHTS.get(drawn.time_of_day), drawn.weather)
        self._rig = CameraRig(rigs, make_renderer(_renderer_here()), modes=MODES, illumination=light)

    def take(
        self, triangles: Triangles, actors: Actors, bodies: Mapping[str, AgentBody]
    ) -> tuple[dict[str, tuple[Picture, ...]], Ints]:
        """Return each agent's images, and the number of pixels (N, A) of each actor in those of each agent."""
        images = {name: list(own.values()) for name, own in self._rig.render(triangles, actors, bodies).items()}
        pictures = {
            name: tuple(_picture(*each) for each in zip(self._calibrations[name], own, strict=True))
            for name, own in images.items()
        }
        pixels = [
            sum((_count(image, actors.id) for image in own), np.zeros(len(actors), np.int64)) for own in images.values()
        ]
        return pictures, np.stack(pixels, axis=1)

    def close(self) -> None:
        """Release the renderer's resources."""
        self._rig.close()


@cache  # "auto" would warn in every clip where OpenGL is missing
def _renderer_here() -> str:
    """Return the name of the fastest renderer that works here."""
    renderer = make_renderer("auto")
    renderer.close()
    return renderer.name


def _picture(calibration: CameraCalibration, image: CameraImage) -> Picture:
    assert image.rgb is not None and image.depth is not None and image.semantic is not None
    depth_m, label = nearest_in_blocks(image.depth, image.semantic, BLOCK)
    return Picture(calibration, image.rgb, depth_m.astype(np.float16), label)


def _count(image: CameraImage, ids: Ints) -> Ints:
    assert image.instance is not None
    return count_instances(image.instance.reshape(-1), ids)
