"""State of a world at one moment for sensors, metrics and pictures, in the world frame."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from typing import Any, Literal, NamedTuple, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from coopsim.errors import InvalidValueError
from coopsim.geometry.boxes import Boxes3D
from coopsim.geometry.se3 import SE3, Floats
from coopsim.support.arrays import frozen, sealed
from coopsim.types import Ints
from coopsim.types.driving import CarState, Command
from coopsim.world.models.model import Model


@dataclass(frozen=True, slots=True, eq=False)
class Actors:
    """N actors (vehicles and people) at one moment, in the world frame.

    Attributes:
        id: (N,) int >= 1, unique within an episode, never reused.
        boxes: tight boxes; the bottom face stands on the ground.
        velocity: (N, 2) m/s, of the box's center over the last step, except for how a vehicle turns and brakes in it.
        label: (N,) int, an `ObjectClass`.
        model: (N,) int, index into the world's `models`.
        color: (N, 3) uint8: paint of a vehicle, or upper clothes of a person.
        accent: (N, 3) uint8: roof or stripe of a vehicle, or lower clothes of a person; empty: equal to `color`.
        phase: (N,) in [0, 1): progress through the model's cycle of poses; empty: 0 for all.
    """

    id: Ints
    boxes: Boxes3D
    velocity: Floats
    label: Ints
    model: Ints
    color: NDArray[np.uint8]
    accent: NDArray[np.uint8] = field(default_factory=lambda: np.zeros((0, 3), dtype=np.uint8))
    phase: Floats = field(default_factory=lambda: np.zeros(0))

    def __post_init__(self) -> None:
        count = len(self.boxes)
        arrays: dict[str, tuple[Any, tuple[int, ...], type[Any]]] = {
            "id": (self.id, (count,), np.int64),
            "velocity": (self.velocity, (count, 2), np.float64),
            "label": (self.label, (count,), np.int64),
            "model": (self.model, (count,), np.int64),
            "color": (self.color, (count, 3), np.uint8),
            "accent": (self.accent if len(self.accent) else self.color, (count, 3), np.uint8),
            "phase": (self.phase if len(self.phase) else np.zeros(count), (count,), np.float64),
        }
        for name, (value, shape, dtype) in arrays.items():
            object.__setattr__(self, name, frozen(value, shape, dtype, name))
        if not ((self.phase >= 0) & (self.phase < 1)).all():
            raise InvalidValueError("phase must be in [0, 1)")

    @classmethod
    def trusted(cls, boxes: Boxes3D, **columns: NDArray[Any]) -> Actors:
        """Make actors without a check, of boxes and all other columns as new arrays that are known to fit."""
        actors = object.__new__(cls)
        object.__setattr__(actors, "boxes", boxes)
        for name, column in columns.items():
            object.__setattr__(actors, name, sealed(column))
        return actors

    def __len__(self) -> int:
        return len(self.boxes)

    def __getitem__(self, index: slice | NDArray[Any]) -> Actors:
        return Actors.trusted(**{name: getattr(self, name)[index] for name in self.__slots__})

    def moved(self, rows: Ints, boxes: Boxes3D, velocity: Floats) -> Actors:
        """Return the actors of these rows (N,), which may repeat, with other boxes (N) and velocities (N, 2)."""
        rest = [name for name in self.__slots__ if name not in ("boxes", "velocity")]
        return Actors.trusted(boxes, velocity=velocity, **{name: getattr(self, name)[rows] for name in rest})

    @classmethod
    def concatenate(cls, parts: Sequence[Actors]) -> Actors:
        """Join the actors of all parts, at least one, in order; ids need not stay unique."""
        boxes = Boxes3D.concatenate(part.boxes for part in parts)
        rest = [column.name for column in fields(cls) if column.name != "boxes"]
        return cls(boxes=boxes, **{name: np.concatenate([getattr(part, name) for part in parts]) for name in rest})

    def pose(self, poses: Ints) -> Ints:
        """Return the index (N,) of each actor's pose, where model k has `poses[k]` of them."""
        return np.floor(self.phase * poses[self.model]).astype(np.int64)

    def transform(self, dst_SE3_src: SE3) -> Actors:
        """Return the actors in another gravity-aligned frame."""
        boxes, velocity = self.boxes.transform(dst_SE3_src), dst_SE3_src.rotate_planar(self.velocity)
        return replace(self, boxes=boxes, velocity=velocity)


class RoadUsers(NamedTuple):
    """Places of all N actors now, in the world frame, for who needs no heights, colours and poses.

    Attributes:
        position: (N, 2) m, of their middles.
        yaw: (N,) rad.
        velocity: (N, 2) m/s.
        size: (N, 3) m.
        label: (N,) classes.
        model: (N,) indices into the world's models.
    """

    position: Floats
    yaw: Floats
    velocity: Floats
    size: Floats
    label: Ints
    model: Ints


@dataclass(frozen=True, slots=True, eq=False)
class AgentBody:
    """True pose and size of an agent.

    Attributes:
        name: such as `cav_0`, `rsu_0`, `drone_0`.
        kind: "cav", "rsu" or "drone".
        actor_id: actor that carries the agent; None for a roadside unit or a drone.
        world_SE3_base: true pose of the base frame (origin on the ground under the agent).
        height_m: the agent's body's, or a drone's over the ground; sensors are mounted on top.
    """

    name: str
    kind: Literal["cav", "rsu", "drone"]
    actor_id: int | None
    world_SE3_base: SE3
    height_m: float


@dataclass(frozen=True, slots=True, eq=False)
class StaticPart:
    """A mesh that never moves, in the world frame.

    Attributes:
        name: such as "ground", "building".
        vertices: (V, 3) m.
        faces: (F, 3) int, counter-clockwise from outside.
        color: (3,) uint8.
        reflectivity: in [0, 1], of retro-reflectors above (see `coopsim.world.models.model.BRIGHTEST`).
        closed: the faces enclose a volume, their outer sides outward; None: to be found from them.
        boxes: (K, 7) upright boxes that stand for the part where no rays are cast; None: those around its closed
            components.
        opacity: share of the light through such a box that is stopped: less than 1 for foliage.
        lamp: number of its light among `RoadMap.lights`, letter at which it shines, and its colour then; None: no lamp.
    """

    name: str
    vertices: Floats
    faces: Ints
    color: tuple[int, int, int]
    reflectivity: float
    closed: bool | None = None
    boxes: Floats | None = None
    opacity: float = 1.0
    lamp: tuple[int, str, tuple[int, int, int]] | None = None


@dataclass(frozen=True, slots=True, eq=False)
class RoadMap:
    """Outlines for drawing: polygons or polylines, each (K, 2) m in the world frame.

    Attributes:
        lanes: polygons of the roads' surface.
        crosswalks: polygons.
        pavements: polygons.
        buildings: footprints.
        markings: painted lines.
        parking: polygons of strips and spaces to park on.
        yards: polygons of other paved ground.
        grass: polygons of lawns and verges.
        walls: footprints.
        trees: outlines of crowns.
        stop_lines: lines before traffic lights.
        lights: states of the lights now, a letter of `coopsim.world.places.signals.LETTERS` for each stop line.
        traffic_side: side of the road that vehicles keep to, "right" or "left".
    """

    lanes: tuple[Floats, ...]
    crosswalks: tuple[Floats, ...]
    pavements: tuple[Floats, ...]
    buildings: tuple[Floats, ...]
    markings: tuple[Floats, ...] = ()
    parking: tuple[Floats, ...] = ()
    yards: tuple[Floats, ...] = ()
    grass: tuple[Floats, ...] = ()
    walls: tuple[Floats, ...] = ()
    trees: tuple[Floats, ...] = ()
    stop_lines: tuple[Floats, ...] = ()
    lights: str = ""
    traffic_side: str = "right"


class WorldSource(Protocol):
    """A world, frame by frame, such as `World`.

    Attributes:
        models: shapes that actors' `model` indexes.
        static: meshes that never move.
        map: outlines for drawing.
    """

    models: tuple[Model, ...]
    static: tuple[StaticPart, ...]
    map: RoadMap

    def step(self, dt_s: float, commands: Mapping[str, Command] | None = None) -> None:
        """Advance by `dt_s`."""

    def actors(self) -> Actors:
        """Return all actors, in the world frame."""

    def agents(self) -> dict[str, AgentBody]:
        """Return the bodies of the agents, in order."""


@runtime_checkable
class DrivenWorld(WorldSource, Protocol):
    """A world whose connected cars agents can drive.

    Attributes:
        conflict_ids: ids of the actors that a situation's script names as conflicting with the ego.
    """

    conflict_ids: tuple[int, ...]

    def car_ahead(self, name: str) -> CarState:
        """Return the motion of a driven car and the way ahead of it, as its driver knows them."""

    def crashed(self) -> tuple[int, ...]:
        """Return the ids of crashed vehicles, which stay where they are, as obstacles."""

    def is_over_in(self, time_s: float) -> bool:
        """Return whether a connected car's way, or what is played, will have ended after a time."""
