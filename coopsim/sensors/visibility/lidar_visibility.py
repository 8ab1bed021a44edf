"""What a LiDAR could see of each actor, what it sees, and what hides the rest.

Every ray is followed through everything that it meets, and not only to where it ends: an actor that was alone in the
world would get all rays that pass through it. The share of them that end on it is what data sets such as nuScenes grade
as visibility, there by camera pixels, here by the sensor's own rays.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from coopsim.geometry.se3 import Floats
from coopsim.sensors.lidar.lidar import LidarConfig
from coopsim.sensors.raycast import RayScene
from coopsim.sensors.scene import STATIC_ID
from coopsim.sensors.visibility.towards import towards
from coopsim.support.arrays import frozen, look_up
from coopsim.types import Ints
from coopsim.world.snapshot import Actors, AgentBody

NOTHING = -1
"""In place of an occluder's id, where nothing is hidden. The scenery's is `STATIC_ID`, as in sweeps."""

_BEYOND_M = 1e-3
"""A ray goes on this far behind what it met."""


@dataclass(frozen=True, slots=True, eq=False)
class Visibility:
    """How well one agent's LiDAR sees each of N actors.

    Attributes:
        id: (N,) of the actors.
        returns: (N,) received, after drop-out.
        rays: (N,) that would end on each if it were alone in the world.
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


@dataclass(frozen=True, slots=True, eq=False)
class Crossings:
    """Where rays pass through actors, in the order of layers.

    Attributes:
        ray: (K,) number of the ray.
        actor: (K,) id of the actor that it passes through: as often as there are faces of it in its way.
        first: (K,) id of what the ray meets first, `STATIC_ID` for scenery.
    """

    ray: Ints
    actor: Ints
    first: Ints


class VisibilityProbe:
    """Measures visibility for agents that carry the same LiDARs; the rays of all of them count.

    Args:
        configs: the sensors. A turn that takes time is measured at its end.
    """

    def __init__(self, configs: Sequence[LidarConfig]) -> None:
        self._sensors = [(config, config.beams.directions(config.columns)) for config in configs]

    def measure(self, scene: RayScene, body: AgentBody, actors: Actors, returns: Ints) -> Visibility:
        """The visibility of all actors but the agent itself.

        Args:
            scene: what there is.
            body: the agent.
            actors: those in the scene, N of them, in the world frame.
            returns: (N,) from each that the agent's LiDARs received.
        """
        other = np.ones(len(actors), np.bool_) if body.actor_id is None else actors.id != body.actor_id
        others, parts = actors[other], []
        for config, directions in self._sensors:
            world_SE3_sensor = body.world_SE3_base.compose(config.base_SE3_sensor(body.height_m))
            origin_m, rays = world_SE3_sensor.translation, world_SE3_sensor.rotate(directions)
            rays = rays[towards(others.boxes, origin_m, rays)]
            range_m = config.min_range_m, config.max_range_m
            parts.append(follow(scene, origin_m, rays, range_m, heights_of(others)))
        crossings = end_to_end(parts, [len(directions) for _, directions in self._sensors])
        return Visibility(others.id, returns[other], *count_crossings(crossings, others.id))


def heights_of(actors: Actors) -> tuple[float, float]:
    """Between which heights (m) there are actors."""
    half_m, middle_m = actors.boxes.size[:, 2] / 2, actors.boxes.center[:, 2]
    return float(np.min(middle_m - half_m, initial=np.inf)), float(np.max(middle_m + half_m, initial=-np.inf))


def end_to_end(parts: Sequence[Crossings], rays: Sequence[int]) -> Crossings:
    """The crossings of several sensors, of so many rays each, whose rays are numbered on."""
    before = np.cumsum([0, *rays])[:-1].tolist()
    ray = [part.ray + start for part, start in zip(parts, before, strict=True)]
    return Crossings(
        np.concatenate(ray),
        np.concatenate([part.actor for part in parts]),
        np.concatenate([part.first for part in parts]),
    )


def follow(
    scene: RayScene,
    origin_m: Floats,
    directions: Floats,
    range_m: tuple[float, float | Floats],
    heights_m: tuple[float, float],
    transparent: int = NOTHING,
) -> Crossings:
    """Follow rays through everything, layer by layer.

    Args:
        scene: what there is.
        origin_m: (3,) from which they start, or (R, 3).
        directions: (R, 3) unit vectors, world frame.
        range_m: nearest and farthest crossing, the latter a number or (R,).
        heights_m: between which there are actors: a ray that has left this for good is followed no further.
        transparent: id of an actor that hides nothing.
    """
    nearest_m, farthest_m = range_m[0], np.broadcast_to(range_m[1], len(directions))
    origins_m = np.broadcast_to(origin_m, directions.shape)
    low_m, high_m = heights_m
    first = np.full(len(directions), NOTHING)
    ray, travelled_m = np.arange(len(directions)), np.zeros(len(directions))
    found: list[Ints] = [np.zeros((0, 2), dtype=np.int64)]
    while len(ray):
        start_m = origins_m[ray] + directions[ray] * travelled_m[:, None]
        height_m, climb = start_m[:, 2], directions[ray, 2]
        ahead = ((height_m >= low_m) | (climb > 0)) & ((height_m <= high_m) | (climb < 0))
        hits = scene.cast(start_m[ahead], directions[ray[ahead]])
        ray, travelled_m = ray[ahead], travelled_m[ahead] + hits.range_m
        met = travelled_m <= farthest_m[ray]
        ray, travelled_m = ray[met], travelled_m[met]
        instance = scene.triangles.instance[hits.face[met]]
        ends = (first[ray] == NOTHING) & (instance != transparent)
        first[ray[ends]] = instance[ends]
        actor = (travelled_m >= nearest_m) & (instance != STATIC_ID)
        found.append(np.column_stack([ray, instance])[actor])
        travelled_m += _BEYOND_M
    crossed = np.concatenate(found)
    return Crossings(crossed[:, 0], crossed[:, 1], first[crossed[:, 0]])


def count_crossings(crossings: Crossings, ids: Ints) -> tuple[Ints, Floats, Ints]:
    """`rays`, `visible` and `occluder` of `Visibility` for the actors `ids` (N,)."""
    order = np.argsort(ids)
    place, known = look_up(ids[order], crossings.actor)
    slot, ray = order[place[known]], crossings.ray[known]
    _, once = np.unique(slot * (np.max(ray, initial=0) + 1) + ray, return_index=True)
    slot, first = slot[once], crossings.first[known][once]
    unhidden = first == ids[slot]
    rays = np.bincount(slot, minlength=len(ids))
    visible = np.bincount(slot[unhidden], minlength=len(ids)) / np.maximum(rays, 1)
    pairs, count = np.unique(np.column_stack([slot, first])[~unhidden], axis=0, return_counts=True)
    occluder = np.full(len(ids), NOTHING)
    rising = np.argsort(count, kind="stable")  # the last written wins, so the one that hides most comes last
    occluder[pairs[rising, 0]] = pairs[rising, 1]
    return rays, visible, occluder
