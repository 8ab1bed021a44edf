"""What the world shows the sensors, the metrics and the pictures; all in the world frame."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from coopsim.errors import InvalidValueError
from coopsim.geometry.boxes import Boxes3D
from coopsim.geometry.se3 import SE3, Floats
from coopsim.support.arrays import frozen, require_finite
from coopsim.support.checks import require_positive
from coopsim.types import Ints
from coopsim.types.taxonomy import CLASS_NAMES

BOX_TOLERANCE_M = 1e-3
"""How far a model may be from filling its box."""

LONGEST_M = 100.0
"""No road has room for what is longer; a mesh in millimetres is."""

_NO_COLORS = np.zeros((0, 3), dtype=np.uint8)
_DARK = (24, 28, 34)


@dataclass(frozen=True, slots=True, eq=False)
class Actors:
    """N actors (vehicles and people) at one moment, in the world frame.

    Attributes:
        id: (N,) int >= 1, unique within an episode, never reused.
        boxes: tight boxes; the bottom face stands on the ground.
        velocity: (N, 2) m/s, of the middle; that of the last step, up to what a vehicle turns and brakes within it.
        label: (N,) int, an `ObjectClass`.
        model: (N,) int, index into the world's `models`.
        color: (N, 3) uint8: paint of a vehicle, or what a person wears above.
        accent: (N, 3) uint8: roof or stripe of a vehicle, or what a person wears below; empty: the same as `color`.
        phase: (N,) in [0, 1): how far through its model's cycle of poses each is; empty: all at its start.
    """

    id: Ints
    boxes: Boxes3D
    velocity: Floats
    label: Ints
    model: Ints
    color: NDArray[np.uint8]
    accent: NDArray[np.uint8] = field(default_factory=_NO_COLORS.copy)
    phase: Floats = field(default_factory=lambda: np.zeros(0))

    def __post_init__(self) -> None:
        count = len(self.boxes)
        accent = self.accent if len(self.accent) else self.color
        phase = self.phase if len(self.phase) else np.zeros(count)
        object.__setattr__(self, "id", frozen(self.id, (count,), np.int64, "id"))
        object.__setattr__(self, "velocity", frozen(self.velocity, (count, 2), np.float64, "velocity"))
        object.__setattr__(self, "label", frozen(self.label, (count,), np.int64, "label"))
        object.__setattr__(self, "model", frozen(self.model, (count,), np.int64, "model"))
        object.__setattr__(self, "color", frozen(self.color, (count, 3), np.uint8, "color"))
        object.__setattr__(self, "accent", frozen(accent, (count, 3), np.uint8, "accent"))
        object.__setattr__(self, "phase", frozen(phase, (count,), np.float64, "phase"))
        if not ((self.phase >= 0) & (self.phase < 1)).all():
            raise InvalidValueError("phase must be in [0, 1)")

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
            self.accent[index],
            self.phase[index],
        )

    def pose(self, poses: Ints) -> Ints:
        """Which of its model's poses each actor is in, (N,), where model k has `poses[k]` of them."""
        return np.floor(self.phase * poses[self.model]).astype(np.int64)

    def transform(self, dst_SE3_src: SE3) -> Actors:
        """The actors moved to another frame (gravity-aligned)."""
        return Actors(
            self.id,
            self.boxes.transform(dst_SE3_src),
            dst_SE3_src.rotate_planar(self.velocity),
            self.label,
            self.model,
            self.color,
            self.accent,
            self.phase,
        )


@dataclass(frozen=True, slots=True, eq=False)
class AgentBody:
    """A connected agent's true place in the world.

    Attributes:
        name: as `cav_0`, `rsu_0`, `drone_0`.
        kind: "cav", "rsu" or "drone".
        actor_id: the actor it rides on; None for a roadside unit or a drone.
        world_SE3_base: true pose of the base frame (origin on the ground under the agent).
        height_m: of the agent's body, or of a drone over the ground; sensors are mounted on top.
    """

    name: str
    kind: Literal["cav", "rsu", "drone"]
    actor_id: int | None
    world_SE3_base: SE3
    height_m: float


@dataclass(frozen=True, slots=True, eq=False)
class Model:
    """A shape that actors share, rigid or with a cycle of poses.

    A face's colour is `tint * paint + (1 - tint) * color`, where the paint is the actor's `accent` on faces that are
    `accented`, and its `color` on the others.

    Attributes:
        name: as "sedan".
        label: the `ObjectClass` it is of.
        size_m: (3,) length, width, height of its tight box, each at most 100 m.
        vertices: (V, 3) m, float64, origin at the middle of the box, x forward; the first of the poses.
        faces: (F, 3) int, counter-clockwise from outside.
        tint: (F,) float in [0, 1]: how much of the actor's paint a face takes (1 paint, 0 glass, tyres).
        reflectivity: (F,) float in [0, 1] at the LiDAR's wavelength.
        color: (F, 3) uint8, a face's own; empty: dark, as glass and tyres are.
        accented: (F,) bool, where the actor's second colour is; empty: nowhere.
        poses: (K, V, 3) m, one cycle of motion in equal steps, which fill the box together; empty: rigid.
        cycle_m: distance travelled in one cycle.

    Raises:
        InvalidValueError: a shape or number that is not as above; says which.
    """

    name: str
    label: int
    size_m: Floats
    vertices: Floats
    faces: Ints
    tint: Floats
    reflectivity: Floats
    color: NDArray[np.uint8] = field(default_factory=_NO_COLORS.copy)
    accented: NDArray[np.bool_] = field(default_factory=lambda: np.zeros(0, dtype=np.bool_))
    poses: Floats = field(default_factory=lambda: np.zeros((0, 0, 3)))
    cycle_m: float = 1.0

    def __post_init__(self) -> None:
        corners, faces = len(self.vertices), len(self.faces)
        poses = self.poses if len(self.poses) else np.asarray(self.vertices)[None]
        color = self.color if len(self.color) else np.tile(np.array(_DARK, dtype=np.uint8), (faces, 1))
        accented = self.accented if len(self.accented) else np.zeros(faces, dtype=np.bool_)
        arrays: dict[str, tuple[Any, tuple[int | None, ...], type[Any]]] = {
            "size_m": (self.size_m, (3,), np.float64),
            "vertices": (self.vertices, (corners, 3), np.float64),
            "faces": (self.faces, (faces, 3), np.int64),
            "tint": (self.tint, (faces,), np.float64),
            "reflectivity": (self.reflectivity, (faces,), np.float64),
            "color": (color, (faces, 3), np.uint8),
            "accented": (accented, (faces,), np.bool_),
            "poses": (poses, (None, corners, 3), np.float64),
        }
        for name, (value, shape, dtype) in arrays.items():
            object.__setattr__(self, name, frozen(value, shape, dtype, f"{name} of model {self.name!r}"))
        self._check()

    def _check(self) -> None:
        of = f"of model {self.name!r}"
        if self.label not in range(len(CLASS_NAMES)):
            raise InvalidValueError(
                f"label {of} must be an ObjectClass, 0 to {len(CLASS_NAMES) - 1}, got {self.label!r}"
            )
        if not (isinstance(self.name, str) and self.name):
            raise InvalidValueError(f"name of a model must be a text, got {self.name!r}")
        for side, value in zip(("length", "width", "height"), self.size_m.tolist(), strict=True):
            require_positive(**{f"{side} {of}": value})
            if value > LONGEST_M:
                raise InvalidValueError(
                    f"{side} {of} must be at most {LONGEST_M:g} m, got {value:g}: is it in other units than metres?"
                )
        if not len(self.faces):
            raise InvalidValueError(f"faces {of} must be at least one, got none")
        require_finite(self.poses, f"vertices {of}")
        low, high = int(self.faces.min()), int(self.faces.max())
        if low < 0 or high >= len(self.vertices):
            accepted = f"in 0..{len(self.vertices) - 1}, as there are {len(self.vertices)} vertices"
            raise InvalidValueError(f"faces {of} must be {accepted}, got {low if low < 0 else high}")
        for name in ("tint", "reflectivity"):
            share = getattr(self, name)
            if not ((share >= 0) & (share <= 1)).all():
                raise InvalidValueError(f"{name} {of} must be in [0, 1], got {share.min()} to {share.max()}")
        require_positive(**{f"cycle_m {of}": self.cycle_m})
        used = self.poses[:, np.unique(self.faces)].reshape(-1, 3)
        ends = np.stack([used.min(axis=0), used.max(axis=0)])
        if not np.allclose(ends, np.stack([-self.size_m / 2, self.size_m / 2]), rtol=0, atol=BOX_TOLERANCE_M):
            raise InvalidValueError(
                f"vertices {of} must fill the box size_m = {self.size_m.tolist()} around the origin to a millimetre, "
                f"but reach from {ends[0].round(4).tolist()} to {ends[1].round(4).tolist()}"
            )


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
        markings: painted lines.
    """

    lanes: tuple[Floats, ...]
    crosswalks: tuple[Floats, ...]
    pavements: tuple[Floats, ...]
    buildings: tuple[Floats, ...]
    markings: tuple[Floats, ...] = ()
