"""Visibility of actors to an agent's LiDARs and cameras: the rays that could end on each, and those that do.

An actor that was alone in the world would get all rays that pass through it. The share of them that end on it is what
data sets such as nuScenes grade as visibility. Rays are those of the LiDARs, or one through the middle of each pixel;
they are traced through everything that they meet, layer by layer.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from coopsim.geometry.boxes import Boxes3D
from coopsim.geometry.se3 import Floats
from coopsim.sensors.camera.camera import Camera
from coopsim.sensors.lidar.lidar import LidarConfig
from coopsim.sensors.scene import STATIC_ID, RayScene
from coopsim.support.arrays import freeze, look_up
from coopsim.support.kernels import njit
from coopsim.types import Ints
from coopsim.world.snapshot import Actors, AgentBody

_CELLS = 360
"""Cells of the full turn of azimuth, and as many from nadir to zenith."""

_SLACK_M = 0.01
"""Enlargement of the boxes: actors fill theirs to a millimetre."""


def angles_of(directions: Floats) -> tuple[Floats, Floats]:
    """Return the azimuths (R,) and elevations (R,), rad, of unit vectors (R, 3)."""
    azimuth_rad: Floats = np.arctan2(directions[:, 1], directions[:, 0])
    elevation_rad: Floats = np.arcsin(np.clip(directions[:, 2], -1.0, 1.0))
    return azimuth_rad, elevation_rad


def ranges_to_boxes(boxes: Boxes3D, origin_m: Floats, azimuth_rad: Floats, elevation_rad: Floats) -> Floats:
    """Return the distances (R,) m within which rays meet all the boxes that they meet; 0 for rays that meet none.

    Conservative, by each box's upright bounding cylinder. Rays start at `origin_m` (3,); angles are (R,), of any number
    of turns.
    """
    around, up = _cells(azimuth_rad, elevation_rad)
    found: Floats = _ranges_by_cell(boxes, origin_m)[around % _CELLS, np.minimum(up, _CELLS - 1)]
    return found


def _ranges_by_cell(boxes: Boxes3D, origin_m: Floats) -> Floats:
    """Return the distances (_CELLS, _CELLS) by azimuth and elevation, m, to the far sides of cylinders; 0: none."""
    away = boxes.center - origin_m
    distance_m = np.hypot(away[:, 0], away[:, 1])
    radius_m = np.hypot(boxes.size[:, 0], boxes.size[:, 1]) / 2 + _SLACK_M
    half_rad = np.where(distance_m > radius_m, np.arcsin(np.minimum(radius_m / np.maximum(distance_m, 1e-9), 1)), np.pi)
    nearest_m, farthest_m = np.maximum(distance_m - radius_m, 0.0), distance_m + radius_m
    half_m = boxes.size[:, 2] / 2 + _SLACK_M
    lowest_m, highest_m = away[:, 2] - half_m, away[:, 2] + half_m
    lowest_rad = np.arctan2(lowest_m, np.where(lowest_m < 0, nearest_m, farthest_m))
    highest_rad = np.arctan2(highest_m, np.where(highest_m > 0, nearest_m, farthest_m))
    middle_rad = np.arctan2(away[:, 1], away[:, 0])
    first = _cells(middle_rad - half_rad, lowest_rad)
    last = _cells(middle_rad + half_rad, highest_rad)
    reach_m = np.hypot(farthest_m, np.maximum(np.abs(lowest_m), np.abs(highest_m)))
    return _paint(*first, *last, reach_m)


@njit(cache=True, nogil=True)
def _paint(right: Ints, bottom: Ints, left: Ints, top: Ints, reach_m: Floats) -> Floats:
    """Return the largest number of the rectangles (N,) on each cell (_CELLS, _CELLS); the first axis is a circle."""
    cells = np.zeros((_CELLS, _CELLS))
    for n in range(len(reach_m)):
        for turn in range(right[n], min(left[n], right[n] + _CELLS - 1) + 1):
            for up in range(bottom[n], min(top[n], _CELLS - 1) + 1):
                cells[turn % _CELLS, up] = max(cells[turn % _CELLS, up], reach_m[n])
    return cells


def _cells(azimuth_rad: Floats, elevation_rad: Floats) -> tuple[Ints, Ints]:
    """Return the cells of directions, counted from -pi and from the nadir."""
    around, up = (azimuth_rad / (2 * np.pi) + 0.5) * _CELLS, (elevation_rad / np.pi + 0.5) * _CELLS
    return np.floor(around).astype(np.int64), np.floor(up).astype(np.int64)


NOTHING = -1
"""Occluder's id where nothing is hidden. The scenery's is `STATIC_ID`, as in sweeps."""

_STEP_M = 1e-3
"""Distance behind a crossing at which a ray goes on."""


@dataclass(frozen=True, slots=True, eq=False)
class Crossings:
    """Passages of rays through actors, in the order of layers.

    Attributes:
        ray: (K,) index of the ray.
        actor: (K,) id of the crossed actor, once for each of its faces in the way.
        first: (K,) id of the ray's first hit, `STATIC_ID` for scenery.
    """

    ray: Ints
    actor: Ints
    first: Ints


def height_span(actors: Actors) -> tuple[float, float]:
    """Return the heights (m) of the lowest and the highest point of the actors' boxes."""
    half_m, middle_m = actors.boxes.size[:, 2] / 2, actors.boxes.center[:, 2]
    return float(np.min(middle_m - half_m, initial=np.inf)), float(np.max(middle_m + half_m, initial=-np.inf))


def trace_rays(
    scene: RayScene,
    origin_m: Floats,
    directions: Floats,
    range_m: tuple[float, float | Floats],
    heights_m: tuple[float, float],
    transparent: int = NOTHING,
) -> Crossings:
    """Trace rays along `directions` (R, 3), from one origin (3,) or (R, 3), through everything, layer by layer.

    Crossings count between the nearest and the farthest of `range_m`, the latter a number or (R,). Actors are between
    `heights_m`: a ray that has left them for good is traced no further. The actor `transparent` hides nothing.
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
        ahead &= travelled_m <= farthest_m[ray]
        hits = scene.cast(start_m[ahead], directions[ray[ahead]])
        ray, travelled_m = ray[ahead], travelled_m[ahead] + hits.range_m
        met = travelled_m <= farthest_m[ray]
        ray, travelled_m = ray[met], travelled_m[met]
        instance = scene.triangles.instance[hits.face[met]]
        ends = (first[ray] == NOTHING) & (instance != transparent)
        first[ray[ends]] = instance[ends]
        actor = (travelled_m >= nearest_m) & (instance != STATIC_ID)
        found.append(np.column_stack([ray, instance])[actor])
        travelled_m += _STEP_M
    crossed = np.concatenate(found)
    return Crossings(crossed[:, 0], crossed[:, 1], first[crossed[:, 0]])


def join_crossings(parts: Sequence[Crossings], rays: Sequence[int]) -> Crossings:
    """Join the crossings of several sensors, numbering their rays consecutively; `rays` counts those of each sensor."""
    before = np.cumsum([0, *rays])[:-1].tolist()
    ray = [part.ray + start for part, start in zip(parts, before, strict=True)]
    return Crossings(
        np.concatenate(ray),
        np.concatenate([part.actor for part in parts]),
        np.concatenate([part.first for part in parts]),
    )


def count_crossings(crossings: Crossings, ids: Ints) -> tuple[Ints, Floats, Ints]:
    """Count crossings of all rays by actor.

    Returns:
        Rays (N,) that pass through each of the actors `ids` (N,), the share (N,) of them that meets it first, and the
            id (N,)
        of the most frequent first hit of the others.
    """
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


@dataclass(frozen=True, slots=True, eq=False)
class Visibility:
    """Visibility of N actors to one agent's LiDARs.

    Attributes:
        id: (N,) of the actors.
        returns: (N,) received, after drop-out.
        rays: (N,) that would end on each actor if it were alone in the world.
        visible: (N,) share of `rays` that do end on it, in [0, 1]; 0 where there are none.
        occluder: (N,) id of the actor (the agent's own body is one) that most of its other rays end on, `STATIC_ID` for
            scenery, or `NOTHING`. Of several that hide as many rays, the largest id.
    """

    id: Ints
    returns: Ints
    rays: Ints
    visible: Floats
    occluder: Ints

    def __post_init__(self) -> None:
        whole, real = ((len(self.id),), np.int64), ((len(self.id),), np.float64)
        freeze(self, id=whole, returns=whole, rays=whole, visible=real, occluder=whole)


class VisibilityProbe:
    """Measurement of visibility to agents that carry the same LiDARs; the rays of all of them count.

    A revolution that takes time is measured at its end.
    """

    def __init__(self, configs: Sequence[LidarConfig]) -> None:
        directions = [config.beams.directions(config.columns) for config in configs]
        self._sensors = [(config, rays, angles_of(rays)) for config, rays in zip(configs, directions, strict=True)]

    def measure(self, scene: RayScene, body: AgentBody, actors: Actors, returns: Ints) -> Visibility:
        """Measure the visibility of all N actors but the agent itself; `returns` (N,) are its LiDARs' from each."""
        other = np.ones(len(actors), np.bool_) if body.actor_id is None else actors.id != body.actor_id
        others, parts = actors[other], []
        for config, directions, (azimuth_rad, elevation_rad) in self._sensors:
            world_SE3_sensor = body.world_SE3_base.compose(config.base_SE3_sensor(body.height_m))
            origin_m, turn = world_SE3_sensor.translation, world_SE3_sensor.rotation
            if turn[2, 2] == 1:  # the sensor is upright
                angles = azimuth_rad + world_SE3_sensor.yaw, elevation_rad
            else:
                angles = angles_of(world_SE3_sensor.rotate(directions))
            reach_m = ranges_to_boxes(others.boxes, origin_m, *angles)
            cast = np.flatnonzero(reach_m)
            range_m = config.min_range_m, np.minimum(reach_m[cast], config.max_range_m)
            rays = world_SE3_sensor.rotate(directions[cast])
            parts.append(trace_rays(scene, origin_m, rays, range_m, height_span(others)))
        crossings = join_crossings(parts, [len(directions) for _, directions, _ in self._sensors])
        return Visibility(others.id, returns[other], *count_crossings(crossings, others.id))


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
        whole, real = ((len(self.id),), np.int64), ((len(self.id),), np.float64)
        freeze(self, id=whole, pixels=whole, visible=real, occluder=whole)


def measure_pixels(cameras: Sequence[Camera], scene: RayScene, body: AgentBody, actors: Actors) -> PixelVisibility:
    """Measure the visibility of all actors but the agent itself, whose own body is not in its images."""
    others = actors if body.actor_id is None else actors[actors.id != body.actor_id]
    parts = [_crossings(camera, scene, body, others) for camera in cameras]
    crossings = join_crossings(parts, [camera.intrinsics.width * camera.intrinsics.height for camera in cameras])
    return PixelVisibility(others.id, *count_crossings(crossings, others.id))


def _crossings(camera: Camera, scene: RayScene, body: AgentBody, others: Actors) -> Crossings:
    pose, lens = body.world_SE3_base.compose(camera.base_SE3_camera(body.height_m)), camera.intrinsics
    rays = pose.rotate(lens.unit_rays)
    reach_m = ranges_to_boxes(others.boxes, pose.translation, *angles_of(rays))
    ahead = np.flatnonzero(reach_m)
    start_m = pose.apply(camera.near_m * lens.rays[ahead])
    far_m = (camera.far_m - camera.near_m) * lens.stretch.reshape(-1)[ahead].astype(np.float64)
    range_m = 0.0, np.minimum(far_m, reach_m[ahead])
    own = NOTHING if body.actor_id is None else body.actor_id
    return trace_rays(scene, start_m, rays[ahead], range_m, height_span(others), own)
