"""The shapes of vehicles and people, made by code: a few hundred triangles each, in the middle of their box."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import trimesh
from numpy.typing import ArrayLike

from coopsim.geometry.se3 import Floats
from coopsim.taxonomy import ObjectClass
from coopsim.world.snapshot import Model


@dataclass(frozen=True, slots=True)
class _Surface:
    """What a part is made of: share of the actor's colour, and reflectivity at 905 nm."""

    tint: float
    reflectivity: float


_PAINT = _Surface(1.0, 0.55)
_GLASS = _Surface(0.0, 0.08)
_TYRE = _Surface(0.0, 0.12)
_METAL = _Surface(0.3, 0.45)
_CLOTH = _Surface(1.0, 0.5)
_SKIN = _Surface(0.25, 0.45)

_AXLE = np.array([[1.0, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 0], [0, 0, 0, 1]])
"""A quarter turn about x: trimesh's cylinders stand, wheels lie."""

_Part = tuple[trimesh.Trimesh, _Surface]


def make_models() -> tuple[Model, ...]:
    """All models, in a fixed order."""
    return (
        _car("sedan", (4.7, 1.85, 1.45), cabin=(0.22, 0.78), roof=(0.36, 0.64), bonnet=0.58),
        _car("hatchback", (4.1, 1.75, 1.5), cabin=(0.02, 0.70), roof=(0.10, 0.52), bonnet=0.58),
        _car("suv", (4.8, 1.95, 1.75), cabin=(0.02, 0.74), roof=(0.06, 0.58), bonnet=0.62),
        _truck("box_truck", (7.5, 2.4, 3.1), cab_share=0.24, gap_share=0.02),
        _truck("heavy_truck", (9.6, 2.5, 3.6), cab_share=0.22, gap_share=0.05),
        _person("adult_tall", (0.55, 0.6, 1.82)),
        _person("adult", (0.5, 0.55, 1.66)),
    )


def _car(
    name: str,
    size: tuple[float, float, float],
    cabin: tuple[float, float],
    roof: tuple[float, float],
    bonnet: float,
) -> Model:
    """A car: body, tapered cabin with glass all round, four wheels.

    `cabin` and `roof` are where they begin and end, from the rear, as shares of the length; `bonnet` is the body's
    height as a share of the whole.
    """
    length, width, height = size
    clearance, belt = 0.16 * height, bonnet * height
    nose = 0.82 * (belt - clearance) + clearance
    body = _hull(
        [
            (0.0, clearance, 1.0),
            (0.0, belt, 0.94),
            (cabin[1], belt, 0.94),
            (1.0, nose, 0.86),
            (1.0, clearance, 0.92),
        ],
        length,
        width,
    )
    glass = _hull(
        [
            (cabin[0], belt, 0.92),
            (cabin[1], belt, 0.92),
            (roof[0], height - 0.02, 0.78),
            (roof[1], height - 0.02, 0.78),
        ],
        length,
        width,
    )
    roof_panel = _block((roof[0] * length, roof[1] * length), 0.76 * width, (height - 0.03, height))
    wheels = _wheels((0.18 * length, 0.81 * length), width, 0.22 * height + 0.02)
    return _model(name, ObjectClass.CAR, size, [(body, _PAINT), (glass, _GLASS), (roof_panel, _PAINT), *wheels])


def _truck(name: str, size: tuple[float, float, float], cab_share: float, gap_share: float) -> Model:
    """A truck: chassis, cargo box, cab with a windscreen, six wheels."""
    length, width, height = size
    cab_start = (1 - cab_share) * length
    chassis = _block((0.0, length), 0.8 * width, (0.5, 0.95))
    cargo = _block((0.0, cab_start - gap_share * length), width, (0.95, height))
    cab_height = min(2.7, 0.82 * height)
    cab = _hull(
        [
            (1 - cab_share, 0.45, 0.98),
            (1 - cab_share, cab_height, 0.94),
            (0.985, cab_height, 0.9),
            (1.0, 0.45, 0.98),
        ],
        length,
        width,
    )
    screen = _block((0.985 * length, length), 0.8 * width, (0.55 * cab_height, 0.9 * cab_height))
    axles = (0.1 * length, 0.22 * length, (1 - cab_share / 2) * length)
    return _model(
        name,
        ObjectClass.TRUCK,
        size,
        [(chassis, _METAL), (cargo, _PAINT), (cab, _PAINT), (screen, _GLASS), *_wheels(axles, width, 0.5)],
    )


def _person(name: str, size: tuple[float, float, float]) -> Model:
    """A person in mid-stride: legs, torso, arms, head."""
    length, width, height = size
    stride = 0.36 * length
    parts: list[_Part] = []
    for side in (1, -1):
        hip = (0.0, side * 0.12 * width, 0.5 * height)
        parts.append((_limb((side * stride, hip[1], 0.0), hip, 0.075), _CLOTH))
        shoulder = (0.0, side * 0.36 * width, 0.8 * height)
        parts.append((_limb((-side * stride, side * 0.42 * width, 0.48 * height), shoulder, 0.05), _CLOTH))
    torso = trimesh.creation.icosphere(subdivisions=1)
    torso.apply_scale((0.13, 0.3 * width, 0.2 * height))
    torso.apply_translation((0.0, 0.0, 0.66 * height))
    head = trimesh.creation.icosphere(subdivisions=1, radius=0.068 * height)
    head.apply_translation((0.02, 0.0, 0.93 * height))
    return _model(name, ObjectClass.PEDESTRIAN, size, [*parts, (torso, _CLOTH), (head, _SKIN)])


def _hull(stations: Sequence[tuple[float, float, float]], length: float, width: float) -> trimesh.Trimesh:
    """Convex hull of bars across: (share of the length, height m, share of the width)."""
    points = [(along * length, side * across * width / 2, up) for along, up, across in stations for side in (1, -1)]
    hull: trimesh.Trimesh = trimesh.convex.convex_hull(np.array(points))
    return hull


def _block(x: tuple[float, float], width: float, z: tuple[float, float]) -> trimesh.Trimesh:
    block: trimesh.Trimesh = trimesh.creation.box((x[1] - x[0], width, z[1] - z[0]))
    block.apply_translation(((x[0] + x[1]) / 2, 0.0, (z[0] + z[1]) / 2))
    return block


def _wheels(axles_m: Sequence[float], width: float, radius: float) -> list[_Part]:
    wheels: list[_Part] = []
    for x in axles_m:
        for side in (1, -1):
            wheel = trimesh.creation.cylinder(radius=radius, height=0.22, sections=12)
            wheel.apply_transform(_AXLE)
            wheel.apply_translation((x, side * (width / 2 - 0.11), radius))
            wheels.append((wheel, _TYRE))
    return wheels


def _limb(start: ArrayLike, end: ArrayLike, radius: float) -> trimesh.Trimesh:
    segment = np.array([start, end], dtype=float)
    limb: trimesh.Trimesh = trimesh.creation.cylinder(radius=radius, segment=segment, sections=8)
    return limb


def _model(name: str, label: ObjectClass, size: tuple[float, float, float], parts: Sequence[_Part]) -> Model:
    """Join the parts, and fit them to `size` exactly, so that the box is tight."""
    vertices: list[Floats] = [np.asarray(mesh.vertices, dtype=np.float64) for mesh, _ in parts]
    offsets = np.cumsum([0, *(len(part) for part in vertices)])
    faces = [np.asarray(mesh.faces) + offset for (mesh, _), offset in zip(parts, offsets, strict=False)]
    joined = np.concatenate(vertices)
    low, high = joined.min(axis=0), joined.max(axis=0)
    fitted = (joined - (low + high) / 2) * (np.array(size) / (high - low))
    counts = [len(part) for part in faces]
    return Model(
        name,
        int(label),
        np.array(size),
        fitted,
        np.concatenate(faces),
        np.repeat([surface.tint for _, surface in parts], counts),
        np.repeat([surface.reflectivity for _, surface in parts], counts),
    )
