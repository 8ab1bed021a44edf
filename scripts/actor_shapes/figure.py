"""The human figure: its joints in a pose, and the parts along them.

Lengths of the limbs are shares of the body's height after Drillis and Contini (1966), as in Winter, "Biomechanics and
Motor Control of Human Movement" (2009), figure 4.1.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from actor_shapes.parts import Part, block, loft, tube
from actor_shapes.surfaces import RGB, Surface
from coopsim.geometry import exact
from coopsim.geometry.se3 import Floats

THIGH, SHANK, ANKLE_HEIGHT = 0.245, 0.246, 0.039
UPPER_ARM, FOREARM_AND_HALF_HAND = 0.186, 0.20
HIP_HEIGHT, HALF_HIPS = 0.530, 0.065
SHOULDER_HEIGHT, HALF_SHOULDERS = 0.818, 0.118
TRUNK = SHOULDER_HEIGHT - HIP_HEIGHT

TOP = Surface(1.0, 0.5)
BOTTOM = Surface(1.0, 0.5, accented=True)
JEANS = Surface(0.0, 0.4, (46, 56, 84))
LEATHER = Surface(0.0, 0.25, (36, 34, 34))

SIDES = np.array([1.0, -1.0])
"""Sign of y: left, right."""


@dataclass(frozen=True, slots=True)
class Appearance:
    """Appearance of a person.

    Attributes:
        skin: colour.
        hair: colour of the hair or helmet.
        top: surface of the trunk and the upper arms.
        bottom: surface of the legs.
        bare_forearms: short sleeves.
        helmet: wears one, which covers the face, too.
        coat: wears one down to the knees.
        backpack: its surface, if any.
        girth: relative width of trunk and limbs, 1 is usual.
        head: relative size, 1 is an adult's.
        band: surface of the chest where it differs from the rest of the trunk, as on a warning vest.
    """

    skin: RGB = (196, 152, 124)
    hair: RGB = (52, 40, 34)
    top: Surface = TOP
    bottom: Surface = BOTTOM
    bare_forearms: bool = False
    helmet: bool = False
    coat: bool = False
    backpack: Surface | None = None
    girth: float = 1.0
    head: float = 1.0
    band: Surface | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Joints:
    """Joint positions of a pose; the first axis of limbs is left, right.

    Attributes:
        trunk: (2, 3) m, between the hips, between the shoulders.
        arms: (2, 3, 3) m, shoulder, elbow, hand.
        legs: (2, 4, 3) m, hip, knee, ankle, ball of the foot.
    """

    trunk: Floats
    arms: Floats
    legs: Floats


def bend_limbs(start: Floats, end: Floats, lengths: tuple[float, float], toward: ArrayLike) -> Floats:
    """Return the middle joints and ends (2, 2, 3) of two limbs of two links each from `start` to `end`, (2, 3) m.

    The middle joint bends towards `toward` (3,). A limb that is too short is stretched out and ends before its target.
    """
    first, second = lengths
    gap = end - start
    distance = exact.norm(gap, axis=1, keepdims=True)
    along = gap / distance
    span = np.minimum(distance, 0.999 * (first + second))
    before = (np.square(first) - np.square(second) + np.square(span)) / (2 * span)  # by the law of cosines
    sideways = np.asarray(toward, dtype=np.float64)
    bend = sideways - along * exact.dot(along, sideways)[:, None]
    bend /= exact.norm(bend, axis=1, keepdims=True)
    middle = start + along * before + bend * np.sqrt(np.maximum(np.square(first) - np.square(before), 0.0))
    return np.stack([middle, start + along * span], axis=1)


def seated(height: float, hips: ArrayLike, lean_rad: float, hands: ArrayLike, feet: ArrayLike) -> Joints:
    """Return the pose with given hips (3,), hands and ankles (2, 3), and forward lean of the trunk."""
    middle = np.asarray(hips, dtype=np.float64)
    up = np.array([exact.sin(lean_rad), 0.0, exact.cos(lean_rad)])
    neck = middle + TRUNK * height * up
    aside = np.array([0.0, 1.0, 0.0]) * SIDES[:, None]
    shoulder, hip = neck + HALF_SHOULDERS * height * aside, middle + HALF_HIPS * height * aside
    arms = bend_limbs(
        shoulder, np.asarray(hands), (UPPER_ARM * height, FOREARM_AND_HALF_HAND * height), (-0.6, 0.0, -1.0)
    )
    legs = bend_limbs(hip, np.asarray(feet), (THIGH * height, SHANK * height), (1.0, 0.0, 0.3))
    ball = legs[:, 1] + np.array([0.10, 0.0, -0.02]) * height
    return Joints(
        np.stack([middle, neck]),
        np.concatenate([shoulder[:, None], arms], axis=1),
        np.concatenate([hip[:, None], legs, ball[:, None]], axis=1),
    )


def holding(joints: Joints, height: float, hands: Mapping[int, ArrayLike]) -> Joints:
    """Return the pose with hands (0 left, 1 right) at other places (3,), as far as the arms reach."""
    shoulder, hand = joints.arms[:, 0], joints.arms[:, 2].copy()
    for side, place in hands.items():
        hand[side] = place
    bent = bend_limbs(shoulder, hand, (UPPER_ARM * height, FOREARM_AND_HALF_HAND * height), (-0.6, 0.0, -1.0))
    arms = joints.arms.copy()
    for side in hands:
        arms[side, 1:] = bent[side]
    return replace(joints, arms=arms)


def on_the_ground(joints: Joints, height: float) -> Joints:
    """Return the pose, lifted or lowered until the lower foot of `dressed` stands at z = 0, to a few millimetres."""
    ankle, ball = joints.legs[:, 2], joints.legs[:, 3]
    heel = ankle[:, 2] - 0.35 * (ball - ankle)[:, 2] - 0.031 * height
    low = np.array([0.0, 0.0, min(heel.min(), ball[:, 2].min() - 0.016 * height)])
    return Joints(joints.trunk - low, joints.arms - low, joints.legs - low)


def dressed(joints: Joints, height: float, appearance: Appearance) -> list[Part]:
    """Return the parts of a person in a pose; their number and faces depend on the appearance alone."""
    skin = Surface(0.0, 0.45, appearance.skin)
    parts = [_trunk(joints.trunk, height, appearance), _head(joints.trunk, height, appearance, skin)]
    for shoulder_to_hand in joints.arms:
        forearm = {(1, side): skin for side in range(4)} if appearance.bare_forearms else None
        girth = appearance.girth * height
        parts.append(
            tube(shoulder_to_hand, [0.032 * girth, 0.026 * girth, 0.020 * girth], appearance.top, dress=forearm)
        )
    for hip, knee, ankle, ball in joints.legs:
        parts.append(tube([hip, knee, ankle], [0.052 * girth, 0.036 * girth, 0.027 * girth], appearance.bottom))
        heel = ankle - 0.35 * (ball - ankle) - np.array([0.0, 0.0, 0.012 * height])
        parts.append(tube([heel, ball], [0.027 * height, 0.022 * height], LEATHER))
    if appearance.backpack is not None:
        neck = joints.trunk[1]
        behind = (neck[0] - 0.15 * height, neck[0] - 0.04 * height)
        parts.append(block(behind, 0.075 * height, (neck[2] - 0.23 * height, neck[2]), appearance.backpack))
    return parts


def _trunk(ends: Floats, height: float, appearance: Appearance) -> Part:
    """Build a six-sided trunk from the hips, or from the knees under a coat, to the neck."""
    hips, neck = ends
    up = (neck - hips) / exact.norm(neck - hips)
    levels = [(-0.03, 0.062, 0.092), (0.22, 0.072, 0.120), (0.30, 0.055, 0.108), (0.335, 0.03, 0.035)]
    if appearance.coat:
        levels[0] = (-0.22, 0.095, 0.125)
    turn = np.arange(6) * np.pi / 3
    fore = np.array([up[2], 0.0, -up[0]])
    rings = [
        hips
        + along * height * up
        + appearance.girth
        * height
        * (deep * exact.cos(turn)[:, None] * fore + wide * exact.sin(turn)[:, None] * [0.0, 1.0, 0.0])
        for along, deep, wide in levels
    ]
    return loft(
        rings, appearance.top, None if appearance.band is None else {(1, side): appearance.band for side in range(6)}
    )


def _head(ends: Floats, height: float, appearance: Appearance, skin: Surface) -> Part:
    """Build a five-sided, upright head; the face looks forward."""
    hips, neck = ends
    middle = neck + np.array([0.02 * height + 0.06 * (neck[0] - hips[0]), 0.0, 0.0])
    size = appearance.head * height
    above = (1.0 - SHOULDER_HEIGHT) * height
    cover = Surface(0.0, 0.3, appearance.hair)
    rings = []
    for down, radius in ((0.145, 0.032), (0.10, 0.050), (0.035, 0.052), (0.0, 0.028)):
        turn = np.arange(5) * 2 * np.pi / 5
        radius *= 1.18 if appearance.helmet else 1.0
        round_it = np.stack([1.15 * exact.cos(turn), exact.sin(turn), np.zeros(5)], axis=1)
        rings.append(middle + np.array([0.0, 0.0, above - down * size]) + radius * size * round_it)
    behind = {(1, side): cover for side in (1, 2, 3)}  # the sides between points that appearance forward are 4 and 0
    face = {(i, side): skin for i in (0, 1) for side in range(5)}
    return loft(
        rings, cover, {} if appearance.helmet else {**face, **behind}, (cover if appearance.helmet else skin, cover)
    )
