"""The world as triangles, frame by frame, with no work per actor, and ray casting against them by Intel's Embree."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from coopsim.geometry.se3 import Floats
from coopsim.types import Ints, Mask
from coopsim.world.models.model import Model
from coopsim.world.snapshot import Actors, StaticPart

Singles = NDArray[np.float32]

STATIC_ID = 0
"""Instance of the scenery; actors' ids are positive."""

_CARBON_BLACK_BELOW, _BLACK_SHARE = 0.4, 0.1


class Parts(NamedTuple):
    """Runs of faces and vertices that belong together, P of both.

    Attributes:
        face_start: (P + 1,) first face of each part and, last, the number of faces.
        vertex_start: (P + 1,) first vertex of each part, likewise.
        closed: (P,) the part's surface encloses a volume, so its inner side cannot be seen from outside.
    """

    face_start: Ints
    vertex_start: Ints
    closed: Mask


@dataclass(frozen=True, slots=True, eq=False)
class Triangles:
    """Triangles of a scene in the world frame.

    Attributes:
        vertices: (V, 3) m.
        faces: (F, 3) int.
        instance: (F,) id of the actor, `STATIC_ID` for scenery.
        reflectivity: (F,) in [0, 1], of retro-reflectors above.
        color: (F, 3) uint8.
        parts: None: unknown.
        velocity: (P, 2) m/s of the parts over ground; None: unknown.
        shining: (S,) faces of lamps, whose colour is light of their own.
    """

    vertices: Floats
    faces: Ints
    instance: Ints
    reflectivity: Floats
    color: NDArray[np.uint8]
    parts: Parts | None = None
    velocity: Floats | None = None
    shining: Ints = field(default_factory=lambda: np.zeros(0, dtype=np.int64))

    @property
    def normals(self) -> Floats:
        """Outward unit normals, (F, 3)."""
        a, b, c = (self.vertices[self.faces[:, k]] for k in range(3))
        normal = np.cross(b - a, c - a)
        length = np.linalg.norm(normal, axis=1, keepdims=True)
        unit: Floats = normal / np.maximum(length, 1e-12)
        return unit

    @property
    def middle_m(self) -> Floats:
        """A point on the ground amid the actors, (3,): measured from here, float32 is fine enough."""
        moving = self.vertices[self.faces[self.instance > STATIC_ID].ravel()]
        around = moving if len(moving) else self.vertices
        return np.append(around[:, :2].mean(axis=0), 0.0) if len(around) else np.zeros(3)

    def faces_without(self, own_id: int | None) -> Ints:
        """Return the indices of all faces but those of an actor."""
        return np.flatnonzero(self.instance != own_id) if own_id is not None else np.arange(len(self.faces))


class SceneGeometry:
    """Triangles of each frame, from the models of actors and the static parts.

    The assignment of vertices to actors is kept until the actors change. A frame then is one look-up of each model's
    pose, one rotation and one translation of all vertices together. Actors' `model` is an index into `models`.
    """

    def __init__(self, models: Sequence[Model], static: Sequence[StaticPart]) -> None:
        self._models = tuple(models)
        self._static = static_triangles(static)
        ends = np.cumsum([0, *(len(part.faces) for part in static)]).tolist()
        self._lamps = [
            (part.lamp, np.arange(*run)) for part, run in zip(static, pairwise(ends), strict=True) if part.lamp
        ]
        self._pose_counts = np.array([len(model.poses) for model in self._models], dtype=np.int64)
        self._closed = np.array([_is_closed_model(model) for model in models], dtype=np.bool_)
        self._key: tuple[bytes, ...] | None = None

    def triangles(self, actors: Actors, scale: Floats | None = None, lights: str = "") -> Triangles:
        """Return the scene with these actors, scenery first.

        `scale` (N, 3) stretches their models along their axes; `lights` are states of traffic lights, see `RoadMap`.
        """
        key = tuple(column.tobytes() for column in (actors.id, actors.model, actors.color, actors.accent))
        if key != self._key:
            self._arrange(actors)
            self._key = key
        boxes = actors.boxes
        cos, sin = np.cos(boxes.yaw)[self._owner], np.sin(boxes.yaw)[self._owner]
        later = actors.pose(self._pose_counts) * self._counts  # rows from an actor's first pose to its present one
        local = self._poses[self._first_pose + later[self._owner]]
        if scale is not None:
            local = local * scale[self._owner]
        vertices = self._vertices
        moved = vertices[len(self._static.vertices) :]
        moved[:, 0] = local[:, 0] * cos - local[:, 1] * sin
        moved[:, 1] = local[:, 0] * sin + local[:, 1] * cos
        moved[:, 2] = local[:, 2]
        moved += boxes.center[self._owner]
        velocity = np.concatenate([np.zeros((len(self._parts.closed) - len(actors), 2)), actors.velocity])
        color, shining = self._lit(lights)
        return Triangles(
            vertices.copy(),
            self._faces,
            self._instance,
            self._reflectivity,
            color,
            self._parts,
            velocity,
            shining,
        )

    def _lit(self, lights: str) -> tuple[NDArray[np.uint8], Ints]:
        """Return the colours of all faces, and the faces of lamps that shine."""
        on = [(lamp[2], faces) for lamp, faces in self._lamps if lights and lights[lamp[0]].lower() == lamp[1].lower()]
        shining = np.concatenate([np.zeros(0, dtype=np.int64), *(faces for _, faces in on)])
        if not on:
            return self._color, shining
        color = self._color.copy()
        color[shining] = np.repeat([lamp for lamp, _ in on], [len(faces) for _, faces in on], axis=0)
        return color, shining

    def _arrange(self, actors: Actors) -> None:
        """Compute what stays the same until the actors change: all columns but vertices and velocities."""
        models = [self._models[k] for k in actors.model]
        counts = np.array([len(model.vertices) for model in models], dtype=np.int64)
        face_counts = [len(model.faces) for model in models]
        starts = len(self._static.vertices) + np.concatenate([[0], np.cumsum(counts)])
        none = np.zeros((0, 3))
        self._owner, self._counts = np.repeat(np.arange(len(actors)), counts), counts
        self._poses = np.concatenate([none, *(model.poses.reshape(-1, 3) for model in models)])
        rows = counts * self._pose_counts[actors.model]
        before = np.cumsum(rows) - rows - (np.cumsum(counts) - counts)
        self._first_pose = np.arange(counts.sum()) + before[self._owner]
        self._vertices = np.concatenate([self._static.vertices, np.zeros((counts.sum(), 3))])
        own_faces = [model.faces + start for model, start in zip(models, starts, strict=False)]
        self._faces = np.concatenate([self._static.faces, *own_faces])
        static_count = len(self._static.faces)
        assert self._static.parts is not None
        self._parts = Parts(
            np.append(self._static.parts.face_start, static_count + np.cumsum(face_counts, dtype=np.int64)),
            np.append(self._static.parts.vertex_start, starts[1:]),
            np.append(self._static.parts.closed, self._closed[actors.model]),
        )
        self._instance = np.concatenate([np.full(static_count, STATIC_ID), np.repeat(actors.id, face_counts)])
        tint = np.concatenate([np.zeros(0), *(model.tint for model in models)])[:, None]
        accented = np.concatenate([np.zeros(0, dtype=np.bool_), *(model.accented for model in models)])[:, None]
        own = np.concatenate([none, *(model.color for model in models)])
        worn = np.where(accented, *(np.repeat(paint, face_counts, axis=0) for paint in (actors.accent, actors.color)))
        painted = (tint * worn + (1 - tint) * own).astype(np.uint8)
        dull = 1 - tint[:, 0] * (1 - paint_reflectivity(worn))
        own_reflectivity = np.concatenate([np.zeros(0), *(model.reflectivity for model in models)]) * dull
        self._reflectivity = np.concatenate([self._static.reflectivity, own_reflectivity])
        self._color = np.concatenate([self._static.color, painted])


def paint_reflectivity(color: NDArray[np.uint8]) -> Floats:
    """Return the reflectivity at 905 nm of paints of some colors (F, 3), as a share of a light paint's, (F,).

    Colored pigments let infrared light through to the primer, which reflects it. Paint that is dark in all channels
    has carbon black, which absorbs it: below 40 % of full brightness, and down to a tenth (both assumed by us).
    """
    brightness = color.max(axis=1, initial=0) / 255.0
    share: Floats = np.clip(brightness / _CARBON_BLACK_BELOW, _BLACK_SHARE, 1.0)
    return share


def static_triangles(parts: Sequence[StaticPart]) -> Triangles:
    """Return the triangles of the scenery alone."""
    starts = np.cumsum([0, *(len(part.vertices) for part in parts)])
    faces = [part.faces + start for part, start in zip(parts, starts, strict=False)]
    counts = [len(part.faces) for part in parts]
    colors = np.array([part.color for part in parts], dtype=np.uint8).reshape(-1, 3)
    return Triangles(
        np.concatenate([np.zeros((0, 3)), *(part.vertices for part in parts)]),
        np.concatenate([np.zeros((0, 3), dtype=np.int64), *faces]),
        np.full(sum(counts), STATIC_ID),
        np.repeat([part.reflectivity for part in parts], counts),
        np.repeat(colors, counts, axis=0),
        Parts(
            np.cumsum([0, *counts]),
            starts,
            np.array([_is_closed_part(part) for part in parts], dtype=np.bool_),
        ),
    )


@lru_cache(maxsize=1024)
def _is_closed_model(model: Model) -> bool:
    """Return whether a model's surface is closed; models are shared by all episodes."""
    return is_closed(model.vertices, model.faces)


def _is_closed_part(part: StaticPart) -> bool:
    return is_closed(part.vertices, part.faces) if part.closed is None else part.closed


def is_closed(vertices: Floats, faces: Ints) -> bool:
    """Return whether triangles (F, 3) enclose a volume with their outer sides outward.

    Then each edge has one triangle on either side, both counter-clockwise, and the volume is positive.
    """
    start, end = faces[:, [0, 1, 2]].ravel(), faces[:, [1, 2, 0]].ravel()
    most = faces.max(initial=0) + 1
    there, back = np.sort(start * most + end), np.sort(end * most + start)
    if not len(faces) or not (np.diff(there) > 0).all() or not np.array_equal(there, back):
        return False
    a, b, c = (vertices[faces[:, k]] - vertices[0] for k in range(3))
    return bool(np.einsum("ij,ij->", a, np.cross(b, c)) > 0)


@dataclass(frozen=True, slots=True, eq=False)
class RayHits:
    """First hits of R rays: range (R,), inf for none, and index of the face (R,), -1 for none."""

    range_m: NDArray[np.float32]
    face: Ints


class RayScene:
    """Triangles of a frame in the world frame, shared by all sensors.

    Normals and Embree's scene are made when first asked for: the grid's sweeps (`coopsim.sensors.lidar.ray_grid`) do
    without.
    """

    def __init__(self, triangles: Triangles) -> None:
        self.triangles = triangles

    @cached_property
    def normals(self) -> Floats:
        """Outward unit normals, (F, 3)."""
        return self.triangles.normals

    @cached_property
    def _origin(self) -> Floats:
        """Origin of embree's coordinates, whose float32 would be off by centimetres at kilometres from it."""
        return self.triangles.middle_m

    @cached_property
    def _embree(self) -> tuple[Any, Any]:
        """The scene, and its mesh, which must live as long."""
        from embreex.mesh_construction import TriangleMesh
        from embreex.rtcore_scene import EmbreeScene

        scene = EmbreeScene(robust=True)  # otherwise rays slip through between faces that share an edge
        local = np.ascontiguousarray(self.triangles.vertices - self._origin, dtype=np.float32)
        return scene, TriangleMesh(scene, local, np.ascontiguousarray(self.triangles.faces, dtype=np.int32))

    def cast(self, origin_m: Floats, directions: NDArray[np.floating]) -> RayHits:
        """Cast rays along unit vectors (R, 3) from one origin (3,), or one each (R, 3), in the world frame."""
        rays = np.ascontiguousarray(directions, dtype=np.float32)
        start = np.asarray(origin_m - self._origin, dtype=np.float32)
        scene, _ = self._embree
        found = scene.run(np.ascontiguousarray(np.broadcast_to(start, rays.shape)), rays, output=True)
        face = np.asarray(found["primID"], dtype=np.int64)
        range_m = np.where(face >= 0, found["tfar"], np.inf).astype(np.float32)
        return RayHits(range_m, face)
