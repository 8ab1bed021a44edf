"""A film's third dimension: what stands in the place, and in each frame boxes with heights and every agent's points."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from coopsim.geometry.boxes import Boxes3D
from coopsim.geometry.se3 import Floats, wrap_angle
from coopsim.types import Ints, Mask
from coopsim.world.places.relief import Relief
from coopsim.world.snapshot import AgentBody, StaticPart

LENGTH_M, CLOUD_M, ANGLE_RAD, SCORE = 0.01, 0.05, 1e-4, 1e-3
"""Units of the integers that store lengths, points, headings and scores of tracks."""

CLOUD_POINTS = 8000
"""Points that a frame keeps of each agent: at 5 cm they take 1.1 bytes each."""

KINDS = ("ground", "grass", "yard", "parking", "pavement", "road", "marking", "house", "plant", "thing")
"""Kinds of solids, each with a colour of its own; the flat ones first, in the order of painting."""

FLAT = KINDS[: KINDS.index("house")]
_KIND_OF = {
    **{name: name for name in KINDS},
    **dict.fromkeys(("kerb",), "pavement"),
    **dict.fromkeys(("hump",), "road"),
    **dict.fromkeys(("building", "roof", "wall", "garden_wall"), "house"),
    **dict.fromkeys(("tree", "trunk", "leaves", "bush", "hedge"), "plant"),
}
_LEFT_OUT = ("window",)  # on the walls of houses, and as many triangles as these

_VOXEL_M = 0.25
_NEAR_GROUND_M = 0.2
_REACH_M = {"plant": 90.0, "thing": 90.0}
"""Distance from the agents' ways up to which solids are kept; it is `_FAR_M` for the other kinds that stand up."""

_FAR_M = 200.0
_STEEP = 0.3  # of the upward part of a face's normal: steeper ones are no ground
_INT16_MAX = 2**15 - 1

Rows3 = NDArray[np.int32]
"""Boxes (N, 8): id, x, y, z of the middle, length, width, height, in the world frame, and yaw; tracks have a score."""

Planes = NDArray[np.uint8]
"""Points (K, 6): low bytes of x, y, z and then high bytes, of the steps from point to point in `CLOUD_M`."""


@dataclass(frozen=True, slots=True, eq=False)
class Solid:
    """Meshes of one kind.

    Attributes:
        kind: one of `KINDS`.
        vertices: (V, 4) `LENGTH_M`: x, y, z in the world frame, and the lowest z of the part.
        faces: (F, 3) vertices, counter-clockwise from outside.
    """

    kind: str
    vertices: NDArray[np.int32]
    faces: NDArray[np.int32]


@dataclass(frozen=True, slots=True, eq=False)
class SpaceFrame:
    """A frame in three dimensions.

    Attributes:
        bodies: (5,) x, y, z of the base, heading and height of each agent.
        truth: all actors.
        tracks: (M, 9) tracks by the agent that reported them.
        clouds: points by agent, from `bodies`, in world axes.
        ground: (K,) mask of each agent's points on the ground.
        seen: ids of the actors from which an agent's own LiDAR got returns, as far as its score counts them.
    """

    bodies: Mapping[str, NDArray[np.int32]]
    truth: Rows3
    tracks: Mapping[str, Rows3]
    clouds: Mapping[str, Planes]
    ground: Mapping[str, NDArray[np.uint8]]
    seen: Mapping[str, Ints]


def body_row(body: AgentBody) -> NDArray[np.int32]:
    """Return x, y, z, heading and height (5,) of an agent."""
    pose = body.world_SE3_base
    x, y, z = pose.translation / LENGTH_M
    heading = float(np.arctan2(pose.rotation[1, 0], pose.rotation[0, 0])) / ANGLE_RAD
    return np.round([x, y, z, heading, body.height_m / LENGTH_M]).astype(np.int32)


def short_ids(ids: Ints) -> Ints:
    """Return ids (N,) as films have them, in 31 bits; those of a situation's people are longer."""
    found: Ints = ids % 2**31
    return found


def box_rows(ids: Ints, boxes: Boxes3D, score: Floats | None = None) -> Rows3:
    """Return boxes as whole numbers (N, 8), with a score as (N, 9)."""
    lengths = np.column_stack([boxes.center, boxes.size]) / LENGTH_M
    columns = [short_ids(ids), lengths, wrap_angle(boxes.yaw) / ANGLE_RAD]
    columns += [] if score is None else [np.clip(score, -1000, 1000) / SCORE]
    return np.clip(np.round(np.column_stack(columns)), -(2**31) + 1, 2**31 - 1).astype(np.int32)


def spread(points: Floats, count: int) -> Floats:
    """Return at most `count` of the points (N, 3) m in their order, of each cube of 0.25 m the first one at most.

    So the dense rings around an agent go, and far walls and cars stay.
    """
    cube = np.floor(points / _VOXEL_M).astype(np.int64)
    cube -= cube.min(axis=0, initial=0)
    span = cube.max(axis=0, initial=0) + 1
    _, first = np.unique((cube[:, 0] * span[1] + cube[:, 1]) * span[2] + cube[:, 2], return_index=True)
    kept = np.sort(first)
    if len(kept) > count:
        kept = kept[np.linspace(0, len(kept) - 1, count).astype(np.int64)]
    return points[kept]


def pack_cloud(points: Floats, origin: Floats) -> Planes:
    """Pack points (N, 3) m about an origin (3,); those beyond 1.6 km are left out by `within_reach`."""
    steps = np.round((points - origin) / CLOUD_M).astype(np.int64)
    steps = np.diff(steps, axis=0, prepend=0).astype(np.int64) & 0xFFFF
    return np.column_stack([steps & 0xFF, steps >> 8]).astype(np.uint8)


def unpack_cloud(planes: Planes, origin: Floats) -> Floats:
    """Return the points (K, 3) m of `pack_cloud`, exact to half a step."""
    steps = planes[:, :3].astype(np.int64) + (planes[:, 3:].astype(np.int64) << 8)
    points: Floats = np.cumsum(steps, axis=0).astype(np.uint16).astype(np.int16) * CLOUD_M + origin
    return points


def within_reach(points: Floats, origin: Floats) -> Mask:
    """Return the mask (N,) of the points that fit into 16 bits about an origin."""
    reached: Mask = np.all(np.abs(points - origin) < CLOUD_M * _INT16_MAX, axis=1)
    return reached


def solids_of(parts: Iterable[StaticPart], places: Floats) -> tuple[Solid, ...]:
    """Return meshes by kind: of what stands up those near to an agent's place (P, 2), and all of the ground."""
    by_kind: dict[str, list[StaticPart]] = {}
    for part in parts:
        kind = _KIND_OF.get(part.name, "thing")
        if part.name not in _LEFT_OUT and len(part.faces) and _is_near(part, kind, places):
            by_kind.setdefault(kind, []).append(part)
    return tuple(_joined(kind, by_kind[kind]) for kind in KINDS if kind in by_kind)


def _is_near(part: StaticPart, kind: str, places: Floats) -> bool:
    if kind in FLAT or not len(places):
        return True
    low, high = part.vertices[:, :2].min(axis=0), part.vertices[:, :2].max(axis=0)
    beyond = np.maximum(np.maximum(low - places, places - high), 0.0)
    return bool(np.hypot(beyond[:, 0], beyond[:, 1]).min() <= _REACH_M.get(kind, _FAR_M))


def _joined(kind: str, parts: Sequence[StaticPart]) -> Solid:
    first = np.cumsum([0, *(len(part.vertices) for part in parts)])
    corners = [
        np.column_stack([part.vertices, np.full(len(part.vertices), part.vertices[:, 2].min())]) for part in parts
    ]
    faces = np.concatenate([part.faces + start for part, start in zip(parts, first, strict=False)])
    return Solid(kind, np.round(np.concatenate(corners) / LENGTH_M).astype(np.int32), faces.astype(np.int32))


def ground_of(parts: Iterable[StaticPart]) -> Relief:
    """Return the ground of a place's meshes, to ask for its heights."""
    return Relief(np.concatenate([np.zeros((0, 3, 3)), *_ground_faces(parts)]))


def _ground_faces(parts: Iterable[StaticPart]) -> Iterator[Floats]:
    for part in parts:
        if _KIND_OF.get(part.name) in FLAT:
            corners = part.vertices[part.faces]
            normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
            yield corners[normal[:, 2] > _STEEP * np.linalg.norm(normal, axis=1)]


def on_ground(points: Floats, ground: Relief) -> NDArray[np.uint8]:
    """Return a mask (N,) of the points (N, 3) that lie on the ground, up to 0.2 m over it."""
    return (points[:, 2] - ground.heights(points[:, :2]) < _NEAR_GROUND_M).astype(np.uint8)
