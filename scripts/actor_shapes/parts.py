"""Building blocks of models: closed solids, each a loft through a few outlines.

Frames: x forward, y left, z up, metres. Parts lie anywhere along x and z; `assemble` puts them into the model's box.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from actor_shapes.surfaces import (
    RIM,
    TYRE,
    Surface,
)
from coopsim.geometry import exact
from coopsim.geometry.se3 import Floats
from coopsim.types import Ints
from coopsim.types.taxonomy import ObjectClass
from coopsim.world.models.model import Model


@dataclass(frozen=True, slots=True)
class Window:
    """A pane in the middle of a face.

    Attributes:
        surface: material of the pane.
        along: margin at either end along the loft, as a share of the face, in (0, 0.5).
        across: margin across it.
    """

    surface: Surface
    along: float
    across: float


Dress = Mapping[tuple[int, int], Surface | Window]
"""Surfaces by segment and side of a loft."""


@dataclass(frozen=True, slots=True, eq=False)
class Part:
    """A closed solid.

    Attributes:
        vertices: (V, 3) m.
        faces: (F, 3) int, counter-clockwise from outside.
        surfaces: one for each face.
    """

    vertices: Floats
    faces: Ints
    surfaces: tuple[Surface, ...]


@dataclass(slots=True)
class _Faces:
    """A solid in the making: quads and fans, added one by one."""

    vertices: list[Floats]
    faces: list[tuple[int, int, int]] = field(default_factory=list)
    surfaces: list[Surface] = field(default_factory=list)

    def fan(self, ring: Sequence[int], surface: Surface) -> None:
        """Add a convex polygon."""
        for k in range(1, len(ring) - 1):
            self.faces.append((ring[0], ring[k], ring[k + 1]))
            self.surfaces.append(surface)

    def pane(self, ring: Sequence[int], frame: Surface, window: Window) -> None:
        """Add the quad `ring`, whose first side runs along the loft, with a window in it."""
        a, b, c, d = (self.vertices[k] for k in ring)
        inner = []
        for u, v in ((0, 0), (1, 0), (1, 1), (0, 1)):
            s, t = abs(u - window.along), abs(v - window.across)
            inner.append(len(self.vertices))
            self.vertices.append((1 - t) * ((1 - s) * a + s * b) + t * ((1 - s) * d + s * c))
        for k in range(4):
            after = (k + 1) % 4
            self.fan([ring[k], ring[after], inner[after], inner[k]], frame)
        self.fan(inner, window.surface)


def loft(
    outlines: ArrayLike,
    surface: Surface,
    dress: Dress | None = None,
    ends: tuple[Surface, Surface] | None = None,
    *,
    ring: bool = False,
) -> Part:
    """Build a solid through S outlines of P points each, (S, P, 3) m, convex and all in the same sense.

    `dress` has surfaces by segment (from outline i to i + 1) and side (from point j to j + 1), `ends` those of the
    first and last outline; the others are `surface`. With `ring` the last outline leads back to the first.
    """
    points = np.asarray(outlines, dtype=np.float64)
    count, sides = points.shape[:2]
    number = np.arange(count * sides).reshape(count, sides).tolist()
    built = _Faces(list(points.reshape(-1, 3)))
    for i in range(count if ring else count - 1):
        for j in range(sides):
            after, beside = (i + 1) % count, (j + 1) % sides
            corners = [number[i][j], number[after][j], number[after][beside], number[i][beside]]
            dressed = (dress or {}).get((i, j), surface)
            if isinstance(dressed, Window):
                built.pane(corners, surface, dressed)
            else:
                built.fan(corners, dressed)
    if not ring:
        first, last = ends or (surface, surface)
        built.fan(number[0], first)
        built.fan(number[-1][::-1], last)
    return _outwards(built)


def _outwards(built: _Faces) -> Part:
    """Return the solid, turned inside out if its faces look inwards."""
    vertices, faces = np.array(built.vertices), np.array(built.faces, dtype=np.int64)
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    if (a * _cross(b, c)).sum() < 0:
        faces = faces[:, ::-1]
    return Part(vertices, faces, tuple(built.surfaces))


def _cross(a: Floats, b: Floats) -> Floats:
    """Return cross products (N, 3), as `np.cross` does, which takes ten times as long for few."""
    (ax, ay, az), (bx, by, bz) = a.T, b.T
    return np.column_stack([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx])


def across(x: float, levels: Sequence[tuple[float, float]]) -> Floats:
    """Return an outline (2 L, 3) across the car at `x`, from L (height, half width) from below; see `mirrored`."""
    left = [(x, half, z) for z, half in levels]
    return np.array([*left, *((x, -half, z) for z, half in reversed(levels))])


def mirrored(levels: int, side: int) -> tuple[int, int]:
    """Return the sides of an `across` outline from level `side` to the next, left and right.

    The top is side `levels` - 1, the floor the last.
    """
    return side, 2 * levels - 2 - side


def level(z: float, x: tuple[float, float], half_width: float, front_half_width: float | None = None) -> Floats:
    """Return a level outline (4, 3) at height `z`; its sides are left, rear, right, front."""
    front = half_width if front_half_width is None else front_half_width
    return np.array([(x[1], front, z), (x[0], half_width, z), (x[0], -half_width, z), (x[1], -front, z)])


LEFT, REAR, RIGHT, FRONT = range(4)


def block(x: tuple[float, float], half_width: float, z: tuple[float, float], surface: Surface, y: float = 0.0) -> Part:
    """Build a box, `y` to the left."""
    aside = np.array([0.0, y, 0.0])
    return loft([level(z[0], x, half_width) + aside, level(z[1], x, half_width) + aside], surface)


def wheel(x: float, y: float, radius: float, width: float, sides: int = 8) -> Part:
    """Build a wheel on the ground at `x`; its outer face is at `y`, the inner one nearer to the middle or past it."""
    turn = (np.arange(sides) + 0.5) * 2 * np.pi / sides  # stands on a flat side
    ring = np.stack([x + radius * exact.cos(turn), np.zeros(sides), radius * exact.sin(turn)], axis=1)
    ring[:, 2] -= ring[:, 2].min()
    inner = y - width * np.sign(y)
    past = np.sign(inner) != np.sign(y)  # as on two-wheelers, where both faces are visible
    return loft([ring + np.array([0.0, side, 0.0]) for side in (inner, y)], TYRE, ends=(RIM if past else TYRE, RIM))


def tube(
    path: ArrayLike, radius: Sequence[float], surface: Surface, sides: int = 4, dress: Dress | None = None
) -> Part:
    """Build a limb or bar through points (S, 3) with S radii; `dress` as for `loft`."""
    points = np.asarray(path, dtype=np.float64)
    along = np.gradient(points, axis=0)
    along /= exact.norm(along, axis=1, keepdims=True)
    # Limbs bend fore and aft, so their outlines are laid out from y; those of a bar that lies along y, from x.
    start = np.array([0.0, 1.0, 0.0]) if np.abs(along[:, 1]).max() < 0.9 else np.array([1.0, 0.0, 0.0])
    aside = start - along * exact.dot(along, start)[:, None]
    aside /= exact.norm(aside, axis=1, keepdims=True)
    fore = _cross(along, aside)
    turn = np.arange(sides) * 2 * np.pi / sides + np.pi / sides
    spokes = aside[:, None] * exact.cos(turn)[:, None] + fore[:, None] * exact.sin(turn)[:, None]
    return loft(points[:, None] + np.asarray(radius)[:, None, None] * spokes, surface)


def assemble(
    name: str,
    label: ObjectClass,
    poses: Sequence[Sequence[Part]],
    size_m: ArrayLike | None = None,
    cycle_m: float = 1.0,
    share: float = 1.0,
    stands: bool = False,
) -> Model:
    """Join the parts of each pose, with equal faces in all, into a model that stands on the ground and fills its box.

    Without `size_m` (3,) the box has the parts' own size, rounded to a centimetre. Other arguments: see `Model`.
    """
    parts = poses[0]
    points = np.stack([np.concatenate([part.vertices for part in pose]) for pose in poses])
    points[..., 2] -= points[..., 2].min(axis=1, keepdims=True)
    low, high = points.min(axis=(0, 1)), points.max(axis=(0, 1))
    size = np.round(high - low, 2) if size_m is None else np.asarray(size_m, dtype=np.float64)
    fitted = (points - (low + high) / 2) * (size / (high - low))
    offsets = np.cumsum([0, *(len(part.vertices) for part in parts)])
    faces = np.concatenate([part.faces + offset for part, offset in zip(parts, offsets, strict=False)])
    surfaces = [surface for part in parts for surface in part.surfaces]
    return Model(
        name,
        int(label),
        size,
        fitted[0],
        faces,
        np.array([surface.tint for surface in surfaces]),
        np.array([surface.reflectivity for surface in surfaces]),
        np.array([surface.color for surface in surfaces], dtype=np.uint8),
        np.array([surface.accented for surface in surfaces]),
        fitted,
        cycle_m,
        share,
        stands,
    )
