"""What the world shows the sensors, the metrics and the pictures; all in the world frame."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from coopsim.arrays import frozen
from coopsim.geometry.boxes import Boxes3D
from coopsim.geometry.se3 import SE3, Floats
from coopsim.types import Ints


@dataclass(frozen=True, slots=True, eq=False)
class Actors:
    """N actors (vehicles and people) at one moment, in the world frame.

    Attributes:
        id: (N,) int >= 1, unique within an episode, never reused.
        boxes: tight boxes; the bottom face stands on the ground.
        velocity: (N, 2) m/s, of the middle; that of the last step, up to what a vehicle turns and brakes within it.
        label: (N,) int, an `ObjectClass`.
        model: (N,) int, index into the world's `models`.
        color: (N, 3) uint8.
    """

    id: Ints
    boxes: Boxes3D
    velocity: Floats
    label: Ints
    model: Ints
    color: NDArray[np.uint8]

    def __post_init__(self) -> None:
        count = len(self.boxes)
        object.__setattr__(self, "id", frozen(self.id, (count,), np.int64, "id"))
        object.__setattr__(self, "velocity", frozen(self.velocity, (count, 2), np.float64, "velocity"))
        object.__setattr__(self, "label", frozen(self.label, (count,), np.int64, "label"))
        object.__setattr__(self, "model", frozen(self.model, (count,), np.int64, "model"))
        object.__setattr__(self, "color", frozen(self.color, (count, 3), np.uint8, "color"))

    def __len__(self) -> int:
        return len(self.boxes)

    def __getitem__(self, index: slice | NDArray[Any]) -> Actors:
        return Actors(
            self.id[index],
            self.boxes[index],
            self.velocity[index],
            self.label[index],
            self.model[index],
            self.color[index],
        )

    def transform(self, dst_SE3_src: SE3) -> Actors:
        """The actors moved to another frame (gravity-aligned)."""
        return Actors(
            self.id,
            self.boxes.transform(dst_SE3_src),
            dst_SE3_src.rotate_planar(self.velocity),
            self.label,
            self.model,
            self.color,
        )


@dataclass(frozen=True, slots=True, eq=False)
class AgentBody:
    """A connected agent's true place in the world.

    Attributes:
        name: as `cav_0`, `rsu_0`.
        kind: "cav" or "rsu".
        actor_id: the actor it rides on; None for a roadside unit.
        world_SE3_base: true pose of the base frame (origin on the ground under the agent).
        height_m: of the agent's body; sensors are mounted on top.
    """

    name: str
    kind: Literal["cav", "rsu"]
    actor_id: int | None
    world_SE3_base: SE3
    height_m: float


@dataclass(frozen=True, slots=True, eq=False)
class Model:
    """A rigid shape that actors share.

    Attributes:
        name: as "sedan".
        label: the `ObjectClass` it is of.
        size_m: (3,) length, width, height of its tight box.
        vertices: (V, 3) m, float64, origin at the middle of the box, x forward.
        faces: (F, 3) int, counter-clockwise from outside.
        tint: (F,) float in [0, 1]: how much of the actor's colour a face takes (1 paint, 0 glass, tyres).
        reflectivity: (F,) float in [0, 1] at the LiDAR's wavelength.
    """

    name: str
    label: int
    size_m: Floats
    vertices: Floats
    faces: Ints
    tint: Floats
    reflectivity: Floats


@dataclass(frozen=True, slots=True, eq=False)
class StaticPart:
    """A part of the scene that never moves, in the world frame.

    Attributes:
        name: as "ground", "building".
        vertices: (V, 3) m.
        faces: (F, 3) int, counter-clockwise from outside.
        color: (3,) uint8.
        reflectivity: in [0, 1].
    """

    name: str
    vertices: Floats
    faces: Ints
    color: tuple[int, int, int]
    reflectivity: float


@dataclass(frozen=True, slots=True, eq=False)
class RoadMap:
    """Outlines for drawing, all polygons or polylines of (K, 2) m in the world frame.

    Attributes:
        lanes: polygons of the lanes' surface.
        crosswalks: polygons.
        pavements: polygons.
        buildings: footprints.
    """

    lanes: tuple[Floats, ...]
    crosswalks: tuple[Floats, ...]
    pavements: tuple[Floats, ...]
    buildings: tuple[Floats, ...]
