"""Walking people: adults and children, plain ones and ones with things: bags, umbrellas, pushchairs, dogs, wheelchairs.

Heights are about the means of the United States: 1.75 m for men and 1.61 m for women (NCHS, Vital and Health
Statistics 3(46), 2021), 1.02 m at four years, 1.22 m at seven and 1.38 m at ten (CDC growth charts, 2000). Children's
heads are larger in proportion. Variants among adults are 1.50 to 1.95 m tall, among children 0.92 to 1.50 m.

A person and what the person pushes or leads are one object, as in data sets, which label a pushchair with its pusher or
apart from it. How many carry what is assumed by us: about one adult in five carries or pushes something, one in a
hundred uses a wheelchair. Frame: x forward, z = 0 on the ground, the person above the origin.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from actor_shapes.attachments import WOOD
from actor_shapes.figure import (
    ANKLE_HEIGHT,
    BOTTOM,
    FOREARM_AND_HALF_HAND,
    HALF_HIPS,
    HALF_SHOULDERS,
    HIP_HEIGHT,
    SHANK,
    SHOULDER_HEIGHT,
    SIDES,
    THIGH,
    UPPER_ARM,
    Appearance,
    Joints,
    dressed,
    holding,
    on_the_ground,
    seated,
)
from actor_shapes.parts import Part, assemble, block, level, loft, tube, wheel
from actor_shapes.surfaces import METAL, PLASTIC, RGB, TYRE, Surface
from coopsim.geometry import exact
from coopsim.geometry.se3 import Floats
from coopsim.types.taxonomy import ObjectClass
from coopsim.world.models.model import Model

POSES = 8
"""Number of poses in a cycle of two steps."""

_LEG_SWING_RAD = np.radians(18.0)
_ARM_SWING_RAD = np.radians(16.0)
_KNEE_RAD = np.radians(55.0)
_ELBOW_RAD = np.radians(20.0)


_SATCHEL = Surface(0.0, 0.6, (214, 96, 34))

ADULTS: dict[str, tuple[float, Appearance]] = {
    "man": (1.78, Appearance(girth=1.05, hair=(58, 44, 36))),
    "woman": (1.63, Appearance(girth=0.95, hair=(96, 66, 40), coat=True, skin=(214, 172, 146))),
    "young_man": (1.73, Appearance(bare_forearms=True, skin=(120, 84, 62), hair=(26, 24, 24), backpack=BOTTOM)),
    "elderly_woman": (1.57, Appearance(girth=1.1, hair=(196, 194, 190), skin=(210, 170, 148))),
}
CHILDREN: dict[str, tuple[float, Appearance]] = {
    "child_of_4": (1.02, Appearance(girth=1.2, head=1.45, hair=(150, 112, 70))),
    "child_of_7": (1.22, Appearance(girth=1.1, head=1.3, bare_forearms=True, hair=(40, 32, 28))),
    "child_of_10": (1.38, Appearance(head=1.2, backpack=_SATCHEL, hair=(80, 54, 36))),
}
"""Heights (m) and looks by name."""


def make_adults() -> list[Model]:
    """Build four adults."""
    return [_walker(name, *each, ObjectClass.PEDESTRIAN) for name, each in ADULTS.items()]


def make_children() -> list[Model]:
    """Build three children."""
    return [_walker(name, *each, ObjectClass.CHILD) for name, each in CHILDREN.items()]


def _walker(name: str, height: float, appearance: Appearance, label: ObjectClass) -> Model:
    poses = [dressed(walking(height, k / POSES), height, appearance) for k in range(POSES)]
    return assemble(name, label, poses, cycle_m=cycle_of(height))


def cycle_of(height: float) -> float:
    """Return the distance (m) walked in a cycle of poses."""
    # In half a cycle the body moves forward by as much as the foot on the ground moves back relative to it.
    step_m = 2 * (THIGH + SHANK) * height * exact.sin(_LEG_SWING_RAD)
    return round(2 * float(step_m), 2)


def walking(height: float, share: float) -> Joints:
    """Return the pose after a share of the cycle, which begins with the left leg in front.

    Thighs and arms swing as pendulums; a knee bends while its foot is in the air.
    """
    turn = 2 * np.pi * (share + np.array([0.0, 0.5]))  # left, right
    thigh = _LEG_SWING_RAD * exact.cos(turn)
    bent = np.maximum(-exact.sin(turn), 0.0)
    shank = thigh - _KNEE_RAD * bent * np.sqrt(bent)
    arm = -_ARM_SWING_RAD * exact.cos(turn)
    middle, neck = np.array([[0.0, 0.0, HIP_HEIGHT], [0.01, 0.0, SHOULDER_HEIGHT]])
    hip, shoulder = (
        end + np.stack([np.zeros(2), SIDES * half, np.zeros(2)], axis=1)
        for end, half in ((middle, HALF_HIPS), (neck, HALF_SHOULDERS))
    )
    knee = hip + THIGH * _hanging(thigh)
    ankle = knee + SHANK * _hanging(shank)
    ball = ankle + 0.105 * _ahead(0.6 * shank) - [0.0, 0.0, ANKLE_HEIGHT / 2]
    elbow = shoulder + UPPER_ARM * _hanging(arm)
    hand = elbow + FOREARM_AND_HALF_HAND * _hanging(arm + _ELBOW_RAD)
    return Joints(
        height * np.stack([middle, neck]),
        height * np.stack([shoulder, elbow, hand], axis=1),
        height * np.stack([hip, knee, ankle, ball], axis=1),
    )


def _hanging(angle_rad: Floats) -> Floats:
    """Return unit vectors (2, 3) that point down, swung forward by an angle."""
    return np.stack([exact.sin(angle_rad), np.zeros(2), -exact.cos(angle_rad)], axis=1)


def _ahead(angle_rad: Floats) -> Floats:
    """Return unit vectors (2, 3) that point forward, raised by an angle."""
    return np.stack([exact.cos(angle_rad), np.zeros(2), exact.sin(angle_rad)], axis=1)


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
    joints, parts = _arms_down(joints, height, (_LEFT, _RIGHT)), []
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


def _arms_down(joints: Joints, height: float, sides: tuple[int, ...]) -> Joints:
    """Let arms hang straight down, a little aside."""
    down: Floats = np.array([0.02, 0.0, -0.375]) * height
    places = {side: joints.arms[side, 0] + down + [0.0, 0.04 * (1 - 2 * side) * height, 0.0] for side in sides}
    return holding(joints, height, places)


_FAIR, _OLIVE, _BROWN, _DARK = (220, 178, 152), (190, 146, 112), (140, 98, 70), (84, 58, 44)
_BLOND, _CHESTNUT, _BLACK, _GREY = (176, 140, 84), (92, 62, 40), (28, 24, 24), (178, 176, 172)

VEST = Surface(0.0, 0.7, (206, 226, 44))
BAND = Surface(0.0, 1000.0, (224, 226, 216))
"""Tape on warning vests: at least 330 cd/(lx m2) (EN ISO 20471), a thousand times as much as white."""

# fmt: off
_SIZES: tuple[tuple[str, str, float, float, float, RGB, RGB], ...] = (
    # name, plain model, height (m), girth, share, skin, hair
    ("man_short", "man", 1.66, 1.08, 1.0, _OLIVE, _BLACK),
    ("man_stout", "man", 1.74, 1.25, 1.0, _FAIR, _GREY),
    ("man_tall", "man", 1.86, 1.08, 2.0, _BROWN, _BLACK),
    ("man_very_tall", "man", 1.95, 1.10, 1.2, _FAIR, _BLOND),
    ("young_man_slim", "young_man", 1.80, 0.98, 1.5, _FAIR, _CHESTNUT),
    ("young_man_tall", "young_man", 1.90, 1.04, 1.0, _DARK, _BLACK),
    ("woman_short", "woman", 1.56, 1.0, 0.6, _OLIVE, _BLACK),
    ("woman_tall", "woman", 1.76, 1.02, 1.0, _DARK, _BLACK),
    ("woman_stout", "woman", 1.65, 1.22, 0.8, _FAIR, _BLOND),
    ("young_woman", "young_man", 1.64, 0.95, 1.0, _OLIVE, _CHESTNUT),
    ("elderly_man", "elderly_woman", 1.72, 1.08, 0.8, _OLIVE, _GREY),
    ("elderly_woman_short", "elderly_woman", 1.50, 1.05, 0.4, _BROWN, _GREY),
    ("child_of_3", "child_of_4", 0.92, 1.0, 0.8, _FAIR, _BLOND),
    ("child_of_6", "child_of_7", 1.15, 1.0, 0.5, _OLIVE, _BLACK),
    ("child_of_8", "child_of_7", 1.28, 1.0, 0.8, _DARK, _BLACK),
    ("child_of_9", "child_of_10", 1.33, 1.1, 0.8, _BROWN, _BLACK),
    ("child_of_11", "child_of_10", 1.44, 1.0, 2.0, _FAIR, _CHESTNUT),
    ("child_of_12", "child_of_10", 1.50, 1.1, 4.0, _OLIVE, _BLACK),
)

_CARRIERS: tuple[tuple[str, float, Belonging, float, Appearance], ...] = (
    # name, height (m), belonging, share, appearance
    ("man_phone", 1.79, phone, 0.8, Appearance(girth=1.05, skin=_FAIR, hair=_BLOND)),
    ("woman_shopping", 1.65, shopping_bags, 0.8, Appearance(girth=0.98, skin=_OLIVE, hair=_CHESTNUT)),
    ("man_shopping", 1.80, shopping_bags, 0.5, Appearance(girth=1.1, skin=_BROWN, hair=_BLACK)),
    ("man_suitcase", 1.82, suitcase, 0.5, Appearance(skin=_FAIR, hair=_CHESTNUT)),
    ("woman_suitcase", 1.67, suitcase, 0.4, Appearance(girth=0.95, skin=_DARK, hair=_BLACK, coat=True)),
    ("woman_umbrella", 1.66, umbrella, 0.4, Appearance(girth=0.95, skin=_FAIR, hair=_BLOND, coat=True)),
    ("man_umbrella", 1.78, umbrella, 0.4, Appearance(girth=1.05, skin=_OLIVE, hair=_BLACK)),
    ("woman_pushchair", 1.66, pushchair, 0.4, Appearance(girth=0.98, skin=_FAIR, hair=_CHESTNUT)),
    ("man_pushchair", 1.81, pushchair, 0.3, Appearance(girth=1.05, skin=_BROWN, hair=_BLACK)),
    ("woman_walking_frame", 1.55, walking_frame, 0.3, Appearance(girth=1.08, skin=_FAIR, hair=_GREY)),
    ("man_dog", 1.77, dog, 0.4, Appearance(skin=_OLIVE, hair=_GREY)),
    ("man_carton", 1.78, carton, 0.3, Appearance(bare_forearms=True, skin=_BROWN, hair=_BLACK)),
    ("worker", 1.80, nothing, 0.5, Appearance(girth=1.1, skin=_OLIVE, top=VEST, band=BAND, hair=(236, 190, 40))),
)
# fmt: on


def make_varied_people() -> list[Model]:
    """Build adults and children of other sizes, then adults with things."""
    plain = {model.name: model for model in (*make_adults(), *make_children())}
    people = [_resized(plain[row[1]], *row) for row in _SIZES]
    return [*people, *(_carrier(*row) for row in _CARRIERS), _in_wheelchair()]


def _resized(
    model: Model, name: str, base: str, height: float, girth: float, share: float, skin: RGB, hair: RGB
) -> Model:
    """Scale a plain person, who is `girth` times wider besides, and exchange the colours of skin and hair."""
    scale = height / model.size_m[2]
    size = np.round(model.size_m * [scale, scale * girth, scale], 2)
    factor, appearance = size / model.size_m, (ADULTS | CHILDREN)[base][1]
    color = np.array(model.color)
    for old, new in ((appearance.skin, skin), (appearance.hair, hair)):
        color[(model.color == old).all(axis=1) & (model.tint == 0.0)] = new
    return replace(
        model,
        name=name,
        size_m=size,
        vertices=model.vertices * factor,
        poses=model.poses * factor,
        color=color,
        cycle_m=model.cycle_m * float(factor[0]),
        share=share,
    )


def _carrier(name: str, height: float, belonging: Belonging, share: float, appearance: Appearance) -> Model:
    poses = []
    for k in range(POSES):
        joints, things = belonging(on_the_ground(walking(height, k / POSES), height), height)
        poses.append([*dressed(joints, height, appearance), *things])
    return assemble(name, ObjectClass.PEDESTRIAN, poses, cycle_m=cycle_of(height), share=share)


def _in_wheelchair() -> Model:
    """Build a man who turns the wheels of his wheelchair; nuScenes' are 1.09 x 0.77 x 1.37 m."""
    height, aside = 1.76, np.array([1.0, -1.0])[:, None] * [0.0, 1.0, 0.0]
    hands = np.array([0.12, 0.0, 0.60]) + 0.28 * aside
    feet = np.array([0.52, 0.0, 0.22]) + 0.10 * aside
    rider = dressed(
        seated(height, [0.0, 0.0, 0.56], -0.08, hands, feet), height, Appearance(skin=_FAIR, hair=_CHESTNUT)
    )
    chair: list[Part] = [
        *(wheel(0.0, side * 0.33, 0.30, 0.03, sides=10) for side in (1, -1)),
        *(wheel(0.46, side * 0.25, 0.08, 0.03, sides=6) for side in (1, -1)),
        block((-0.14, 0.36), 0.22, (0.44, 0.50), PLASTIC),
        block((-0.20, -0.15), 0.22, (0.44, 0.92), PLASTIC),
        block((0.44, 0.72), 0.18, (0.10, 0.13), METAL),
        *(beam([0.34, side * 0.20, 0.45], [0.52, side * 0.20, 0.12], 0.015, 0.015, METAL) for side in (1, -1)),
    ]
    return assemble("wheelchair_user", ObjectClass.PEDESTRIAN, [[*chair, *rider]], share=0.25)
