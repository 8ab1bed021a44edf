"""What people carry, push and pull: each function takes a pose and returns it with its hands there, and the things.

Frame: x forward, z = 0 on the ground, the person above the origin.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike

from coopsim.geometry import exact
from coopsim.geometry.se3 import Floats
from coopsim.world.models.attachments import WOOD
from coopsim.world.models.figure import Joints, holding
from coopsim.world.models.parts import METAL, PLASTIC, TYRE, Part, Surface, block, level, loft, tube

Belonging = Callable[[Joints, float], tuple[Joints, list[Part]]]

CLOTH = Surface(0.0, 0.45, (150, 44, 48))
CANOPY = Surface(0.0, 0.35, (38, 44, 62))
BAG = Surface(0.0, 0.5, (206, 186, 150))
FUR = Surface(0.0, 0.35, (122, 92, 62))
BABY = Surface(0.0, 0.5, (214, 204, 190))

_LEFT, _RIGHT = 0, 1


def nothing(joints: Joints, height: float) -> tuple[Joints, list[Part]]:
    """Carry nothing."""
    return joints, []


def phone(joints: Joints, height: float) -> tuple[Joints, list[Part]]:
    """Look at a telephone."""
    return holding(joints, height, {_RIGHT: [0.20 * height, -0.05, 0.77 * height]}), []


def shopping_bags(joints: Joints, height: float) -> tuple[Joints, list[Part]]:
    """Carry a bag in either hand; arms hang down."""
    joints, parts = _hanging(joints, height, (_LEFT, _RIGHT)), []
    for side, sign in ((_LEFT, 1.0), (_RIGHT, -1.0)):
        x, y, z = joints.arms[side, 2] + [0.0, 0.04 * sign, 0.0]
        aside = np.array([0.0, y, 0.0])
        levels = [(0.46, 0.17, 0.08), (0.12, 0.17, 0.08), (-0.01, 0.03, 0.012)]
        parts.append(loft([level(z - down, (x - half, x + half), wide) + aside for down, half, wide in levels], BAG))
    return joints, parts


def suitcase(joints: Joints, height: float) -> tuple[Joints, list[Part]]:
    """Pull a tilted suitcase on wheels."""
    joints = holding(joints, height, {_RIGHT: [-0.14 * height, -0.16 * height, 0.43 * height]})
    hand, foot = joints.arms[_RIGHT, 2], np.array([-0.72, -0.16 * height, 0.07])
    along = (hand - foot) / exact.norm(hand - foot)
    top, axle = foot + 0.58 * along, np.array([0.0, 0.19, 0.0])
    return joints, [
        beam(foot, top, 0.12, 0.2, Surface(0.0, 0.4, (52, 84, 120))),
        tube([top, hand], [0.03, 0.02], METAL),
        tube([foot + axle, foot - axle], [0.07, 0.07], TYRE, 5),
    ]


def umbrella(joints: Joints, height: float) -> tuple[Joints, list[Part]]:
    """Hold an open umbrella overhead."""
    joints = holding(joints, height, {_RIGHT: [0.13 * height, -0.07 * height, 0.66 * height]})
    hand = joints.arms[_RIGHT, 2]
    tip = np.array([0.02 * height, -0.01 * height, 1.19 * height])
    turn = np.arange(8) * np.pi / 4 + np.pi / 8
    around = np.stack([exact.cos(turn), exact.sin(turn), np.zeros(8)], axis=1)
    rings = [tip + radius * around - [0, 0, down] for radius, down in ((0.50, 0.24), (0.30, 0.07), (0.04, 0.0))]
    return joints, [tube([hand, tip - [0, 0, 0.03]], [0.015, 0.015], METAL, 3), loft(rings, CANOPY)]


def carton(joints: Joints, height: float) -> tuple[Joints, list[Part]]:
    """Carry a carton before the body."""
    z, x = 0.60 * height, 0.17 * height
    hands = {_LEFT: [x + 0.05, 0.2, z + 0.03], _RIGHT: [x + 0.05, -0.2, z + 0.03]}
    return holding(joints, height, hands), [block((x - 0.07, x + 0.25), 0.2, (z - 0.02, z + 0.28), WOOD)]


def pushchair(joints: Joints, height: float) -> tuple[Joints, list[Part]]:
    """Push a pushchair with a child in it."""
    grip, z = 0.25 * height, 0.60 * height
    joints = holding(joints, height, {_LEFT: [grip, 0.17, z], _RIGHT: [grip, -0.17, z]})
    wheels = [
        tube([[x, y - 0.02, r], [x, y + 0.02, r]], [r, r], TYRE, 6)
        for x, r in ((grip + 0.28, 0.13), (grip + 0.86, 0.10))
        for y in (0.24, -0.24)
    ]
    frame = [tube([[grip, y, z], [grip + 0.86, y, 0.12]], [0.02, 0.02], METAL, 3) for y in (0.22, -0.22)]
    frame += [tube([[grip + 0.28, y, 0.13], [grip + 0.52, y, 0.52]], [0.02, 0.02], METAL, 3) for y in (0.22, -0.22)]
    seat = [
        level(0.40, (grip + 0.30, grip + 0.82), 0.17),
        level(0.66, (grip + 0.20, grip + 0.80), 0.21),
    ]
    hood = [level(0.66, (grip + 0.20, grip + 0.50), 0.21), level(0.98, (grip + 0.26, grip + 0.46), 0.18)]
    child = block((grip + 0.44, grip + 0.60), 0.09, (0.66, 0.84), BABY)
    bar = tube([[grip, 0.24, z], [grip, -0.24, z]], [0.02, 0.02], PLASTIC, 3)
    return joints, [*wheels, *frame, bar, loft(seat, CANOPY), loft(hood, CLOTH), child]


def walking_frame(joints: Joints, height: float) -> tuple[Joints, list[Part]]:
    """Walk with a frame on wheels."""
    grip, z = 0.18 * height, 0.52 * height
    joints = holding(joints, height, {_LEFT: [grip, 0.24, z], _RIGHT: [grip, -0.24, z]})
    parts: list[Part] = [block((grip + 0.08, grip + 0.34), 0.22, (0.50, 0.56), PLASTIC)]
    for y in (0.25, -0.25):
        parts += [
            tube([[grip - 0.05, y, z], [grip + 0.10, y, z], [grip + 0.48, y, 0.10]], [0.02, 0.02, 0.02], METAL, 3),
            tube([[grip, y, 0.1], [grip + 0.2, y, 0.58]], [0.02, 0.02], METAL, 3),
            *(tube([[x, y - 0.02, 0.1], [x, y + 0.02, 0.1]], [0.1, 0.1], TYRE, 6) for x in (grip, grip + 0.48)),
        ]
    return joints, parts


def dog(joints: Joints, height: float) -> tuple[Joints, list[Part]]:
    """Lead a dog."""
    joints = holding(joints, height, {_LEFT: [0.12 * height, 0.17 * height, 0.47 * height]})
    hand, x, y = joints.arms[_LEFT, 2], 0.55, 0.42
    swing = 0.4 * (joints.legs[:, 2, 0] - joints.legs[:, 0, 0])  # it keeps step
    legs = [
        tube([[at, y + side, 0.30], [at + swing[k], y + side, 0.015]], [0.04, 0.02], FUR, 3)
        for at, pair in ((x - 0.22, (0, 1)), (x + 0.22, (1, 0)))
        for k, side in zip(pair, (0.07, -0.07), strict=True)
    ]
    body = tube([[x - 0.33, y, 0.38], [x, y, 0.38], [x + 0.3, y, 0.40]], [0.09, 0.13, 0.12], FUR)
    head = tube([[x + 0.26, y, 0.44], [x + 0.38, y, 0.60], [x + 0.58, y, 0.55]], [0.08, 0.10, 0.04], FUR)
    tail = tube([[x - 0.33, y, 0.42], [x - 0.50, y, 0.58]], [0.025, 0.01], FUR, 3)
    lead = tube([hand, [x + 0.27, y, 0.50]], [0.008, 0.008], PLASTIC, 3)
    return joints, [*legs, body, head, tail, lead]


def beam(start: ArrayLike, end: ArrayLike, half_deep: float, half_wide: float, surface: Surface) -> Part:
    """Build a box from `start` to `end`, points (3,) in a plane y = const, so wide along y."""
    first, last = np.asarray(start, dtype=np.float64), np.asarray(end, dtype=np.float64)
    along = (last - first) / exact.norm(last - first)
    deep = half_deep * np.array([-along[2], 0.0, along[0]])
    wide = np.array([0.0, half_wide, 0.0])
    return loft(
        [[at + deep + wide, at + deep - wide, at - deep - wide, at - deep + wide] for at in (first, last)], surface
    )


def _hanging(joints: Joints, height: float, sides: tuple[int, ...]) -> Joints:
    """Let arms hang straight down, a little aside."""
    down: Floats = np.array([0.02, 0.0, -0.375]) * height
    places = {side: joints.arms[side, 0] + down + [0.0, 0.04 * (1 - 2 * side) * height, 0.0] for side in sides}
    return holding(joints, height, places)
