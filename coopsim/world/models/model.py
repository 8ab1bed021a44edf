"""The shape that actors of one kind share."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from coopsim.errors import InvalidValueError
from coopsim.geometry.se3 import Floats
from coopsim.support.arrays import frozen, require_finite
from coopsim.support.checks import require_positive
from coopsim.types import Ints
from coopsim.types.taxonomy import CLASS_NAMES

BOX_TOLERANCE_M = 1e-3
"""Largest accepted distance between a model's extent and its box."""

LONGEST_M = 100.0
"""Longest accepted side: no road has room for more, and a mesh in millimetres exceeds it."""

BRIGHTEST = 1000.0
"""Largest accepted reflectivity. A white matt surface has 1; more is a retro-reflector, which sends light back to where
it came from at any usual angle of incidence (see `coopsim.sensors.lidar.returns.reflect`)."""

DARK = (24, 28, 34)
"""Default colour of unpainted faces, such as glass."""


@dataclass(frozen=True, slots=True, eq=False)
class Model:
    """A shape shared by actors, rigid or with a cycle of poses.

    A face's colour is `tint * paint + (1 - tint) * color`, where the paint is the actor's `accent` on `accented` faces,
    and its `color` on the others.

    Attributes:
        name: such as "sedan".
        label: its `ObjectClass`.
        size_m: (3,) length, width, height of its tight box, each at most 100 m.
        vertices: (V, 3) m, float64, of the first pose; origin at the box's center, x forward.
        faces: (F, 3) int, counter-clockwise from outside.
        tint: (F,) float in [0, 1]: share of the actor's paint in the face's colour (1 paint, 0 glass, tyres).
        reflectivity: (F,) float in [0, 1] at the LiDAR's wavelength; retro-reflectors up to `BRIGHTEST`.
        color: (F, 3) uint8, the face's own; empty: `DARK`.
        accented: (F,) bool, True where the face takes the actor's second colour; empty: nowhere.
        poses: (K, V, 3) m, one cycle of motion in equal steps, which fill the box together; empty: rigid.
        cycle_m: distance travelled in one cycle.
        share: weight when one of its class is drawn.
        stands: it is for parked vehicles only, as one with an open door.

    Raises:
        InvalidValueError: a shape or value is not as above; says which.
    """

    name: str
    label: int
    size_m: Floats
    vertices: Floats
    faces: Ints
    tint: Floats
    reflectivity: Floats
    color: NDArray[np.uint8] = field(default_factory=lambda: np.zeros((0, 3), dtype=np.uint8))
    accented: NDArray[np.bool_] = field(default_factory=lambda: np.zeros(0, dtype=np.bool_))
    poses: Floats = field(default_factory=lambda: np.zeros((0, 0, 3)))
    cycle_m: float = 1.0
    share: float = 1.0
    stands: bool = False

    def __post_init__(self) -> None:
        corners, faces = len(self.vertices), len(self.faces)
        poses = self.poses if len(self.poses) else np.asarray(self.vertices)[None]
        color = self.color if len(self.color) else np.tile(np.array(DARK, dtype=np.uint8), (faces, 1))
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
        mirrors = f", of retro-reflectors up to {BRIGHTEST:g}"
        for name, most, more in (("tint", 1.0, ""), ("reflectivity", BRIGHTEST, mirrors)):
            value = getattr(self, name)
            if not ((value >= 0) & (value <= most)).all():
                raise InvalidValueError(f"{name} {of} must be in [0, 1]{more}, got {value.min()} to {value.max()}")
        require_positive(**{f"cycle_m {of}": self.cycle_m, f"share {of}": self.share})
        used = self.poses[:, np.unique(self.faces)].reshape(-1, 3)
        ends = np.stack([used.min(axis=0), used.max(axis=0)])
        if not np.allclose(ends, np.stack([-self.size_m / 2, self.size_m / 2]), rtol=0, atol=BOX_TOLERANCE_M):
            raise InvalidValueError(
                f"vertices {of} must fill the box size_m = {self.size_m.tolist()} around the origin to a millimetre, "
                f"but reach from {ends[0].round(4).tolist()} to {ends[1].round(4).tolist()}"
            )
