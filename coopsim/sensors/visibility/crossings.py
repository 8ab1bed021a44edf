"""Rays traced through everything that they meet, and not only to where they end."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from coopsim.geometry.se3 import Floats
from coopsim.sensors.raycast import RayScene
from coopsim.sensors.scene import STATIC_ID
from coopsim.support.arrays import look_up
from coopsim.types import Ints
from coopsim.world.snapshot import Actors

NOTHING = -1
"""Occluder's id where nothing is hidden. The scenery's is `STATIC_ID`, as in sweeps."""

_STEP_M = 1e-3
"""Distance behind a crossing at which a ray goes on."""


@dataclass(frozen=True, slots=True, eq=False)
class Crossings:
    """Passages of rays through actors, in the order of layers.

    Attributes:
        ray: (K,) index of the ray.
        actor: (K,) id of the actor that it passes through, once for each of its faces in the way.
        first: (K,) id of what the ray meets first, `STATIC_ID` for scenery.
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
    """Trace rays through everything, layer by layer.

    Args:
        scene: the frame's triangles.
        origin_m: (3,) start of all rays, or (R, 3).
        directions: (R, 3) unit vectors, world frame.
        range_m: nearest and farthest crossing, the latter a number or (R,).
        heights_m: span in which there are actors: a ray that has left it for good is traced no further.
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
    """Count crossings by actor.

    Args:
        crossings: of all rays.
        ids: (N,) of the actors.

    Returns:
        Rays (N,) that pass through each actor, the share (N,) of them that meets it first, and the id (N,) of what most
        of the others meet first.
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
