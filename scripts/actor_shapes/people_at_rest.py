"""People who stay where they are, standing with or without things, or sitting.

A walker's box holds a whole step, so it is long. A box of a person at rest is as tight as those that data sets draw.
These models are for bystanders alone (`coopsim.world.surroundings`): nobody walks with them. How many have what is
assumed by us. Frame: x forward, z = 0 on the ground.
"""

from __future__ import annotations

import numpy as np

from actor_shapes.figure import (
    ANKLE_HEIGHT,
    HALF_HIPS,
    HALF_SHOULDERS,
    HIP_HEIGHT,
    SHOULDER_HEIGHT,
    SIDES,
    Appearance,
    Joints,
    dressed,
    holding,
    on_the_ground,
    seated,
)
from actor_shapes.parts import Part, assemble
from actor_shapes.pedestrians import (
    VEST,
    Belonging,
    dog,
    nothing,
    phone,
    pushchair,
    shopping_bags,
    umbrella,
)
from actor_shapes.surfaces import Surface
from coopsim.types.taxonomy import ObjectClass
from coopsim.world.models.model import Model

SEAT_M = 0.46
"""Height of benches and of chairs."""

_OLIVE, _BROWN, _DARK = (190, 146, 112), (140, 98, 70), (84, 58, 44)
_BLOND, _CHESTNUT, _BLACK, _GREY = (176, 140, 84), (92, 62, 40), (28, 24, 24), (178, 176, 172)
_SATCHEL = Surface(0.0, 0.5, (64, 70, 96))


def folded_arms(joints: Joints, height: float) -> tuple[Joints, list[Part]]:
    """Fold the arms."""
    hands = {side: [0.10 * height, -0.06 * sign * height, 0.63 * height] for side, sign in enumerate(SIDES)}
    return holding(joints, height, hands), []


def hands_on_hips(joints: Joints, height: float) -> tuple[Joints, list[Part]]:
    """Rest both hands on the hips."""
    hands = {side: [0.02 * height, 0.11 * sign * height, 0.56 * height] for side, sign in enumerate(SIDES)}
    return holding(joints, height, hands), []


_ADULT, _CHILD = ObjectClass.PEDESTRIAN, ObjectClass.CHILD

# fmt: off
_STANDING: tuple[tuple[str, ObjectClass, float, Belonging, float, Appearance], ...] = (
    # name, class, height (m), belonging, share, appearance
    ("man_standing", _ADULT, 1.78, nothing, 3.0, Appearance(girth=1.05, hair=_CHESTNUT)),
    ("woman_standing", _ADULT, 1.63, nothing, 3.0, Appearance(girth=0.95, hair=_BLOND, coat=True)),
    ("young_man_standing", _ADULT, 1.84, nothing, 2.0,
     Appearance(bare_forearms=True, skin=_DARK, hair=_BLACK, backpack=_SATCHEL)),
    ("young_woman_standing", _ADULT, 1.68, hands_on_hips, 2.0, Appearance(girth=0.95, skin=_OLIVE, hair=_BLACK)),
    ("elderly_man_standing", _ADULT, 1.70, folded_arms, 2.0, Appearance(girth=1.15, hair=_GREY)),
    ("man_arms_folded", _ADULT, 1.87, folded_arms, 2.0, Appearance(girth=1.08, skin=_BROWN, hair=_BLACK)),
    ("elderly_woman_standing", _ADULT, 1.56, shopping_bags, 1.5, Appearance(girth=1.1, hair=_GREY)),
    ("woman_phone_standing", _ADULT, 1.70, phone, 2.0, Appearance(skin=_OLIVE, hair=_CHESTNUT, coat=True)),
    ("man_phone_standing", _ADULT, 1.80, phone, 2.0, Appearance(girth=1.05, hair=_BLOND)),
    ("woman_umbrella_standing", _ADULT, 1.66, umbrella, 1.0, Appearance(girth=0.95, hair=_BLACK, coat=True)),
    ("man_umbrella_standing", _ADULT, 1.79, umbrella, 1.0, Appearance(girth=1.05, skin=_OLIVE, hair=_GREY)),
    ("woman_pushchair_standing", _ADULT, 1.67, pushchair, 0.8, Appearance(girth=0.98, hair=_CHESTNUT)),
    ("man_dog_standing", _ADULT, 1.76, dog, 0.8, Appearance(skin=_BROWN, hair=_BLACK)),
    ("worker_standing", _ADULT, 1.80, hands_on_hips, 0.7, Appearance(girth=1.1, top=VEST, hair=(236, 190, 40))),
    ("child_of_4_standing", _CHILD, 1.03, nothing, 1.0, Appearance(girth=1.2, head=1.45, hair=_BLOND)),
    ("child_of_8_standing", _CHILD, 1.28, nothing, 1.0, Appearance(girth=1.1, head=1.3, skin=_OLIVE, hair=_BLACK)),
    ("child_of_11_standing", _CHILD, 1.44, nothing, 1.0, Appearance(head=1.2, backpack=_SATCHEL, hair=_CHESTNUT)),
)

_SITTING: tuple[tuple[str, ObjectClass, float, float, float, Appearance], ...] = (
    # name, class, height (m) when standing, forward lean (rad), share, appearance
    ("man_sitting", _ADULT, 1.78, -0.12, 1.0, Appearance(girth=1.05, hair=_CHESTNUT)),
    ("man_sitting_bent", _ADULT, 1.83, 0.35, 1.0, Appearance(bare_forearms=True, skin=_BROWN, hair=_BLACK)),
    ("woman_sitting", _ADULT, 1.65, -0.05, 1.0, Appearance(girth=0.95, hair=_BLOND)),
    ("elderly_woman_sitting", _ADULT, 1.57, 0.12, 1.0, Appearance(girth=1.1, skin=_OLIVE, hair=_GREY)),
    ("child_of_8_sitting", _CHILD, 1.28, 0.0, 0.4, Appearance(girth=1.1, head=1.3, hair=_CHESTNUT)),
)
# fmt: on


def make_standing_people() -> list[Model]:
    """Build people who stand."""
    return [_stander(*row) for row in _STANDING]


def make_sitting_people() -> list[Model]:
    """Build people who sit."""
    return [_sitter(*row) for row in _SITTING]


def _stander(
    name: str, label: ObjectClass, height: float, belonging: Belonging, share: float, appearance: Appearance
) -> Model:
    joints, things = belonging(on_the_ground(_upright(height), height), height)
    return assemble(name, label, [[*dressed(joints, height, appearance), *things]], share=share, stands=True)


def _upright(height: float) -> Joints:
    """Return the pose of a person who stands with straight legs and hanging arms."""
    middle, neck = np.array([[0.0, 0.0, HIP_HEIGHT], [0.01, 0.0, SHOULDER_HEIGHT]])
    aside = SIDES[:, None] * [0.0, 1.0, 0.0]
    ahead, down = np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.0, -1.0])
    hip, shoulder = middle + HALF_HIPS * aside, neck + HALF_SHOULDERS * aside
    ankle = hip + (HIP_HEIGHT - ANKLE_HEIGHT) * down + 0.02 * aside
    knee, ball = (hip + ankle) / 2 + 0.01 * ahead, ankle + 0.105 * ahead + ANKLE_HEIGHT / 2 * down
    elbow = shoulder + 0.183 * down + 0.03 * aside
    hand = elbow + 0.19 * down + 0.05 * ahead
    return Joints(
        height * np.stack([middle, neck]),
        height * np.stack([shoulder, elbow, hand], axis=1),
        height * np.stack([hip, knee, ankle, ball], axis=1),
    )


def _sitter(
    name: str, label: ObjectClass, height: float, lean_rad: float, share: float, appearance: Appearance
) -> Model:
    """Build a person on a seat, with the hands on the knees and the feet below these."""
    aside, thigh_m = SIDES[:, None] * [0.0, 1.0, 0.0], 0.245 * height
    hands = np.array([0.9 * thigh_m, 0.0, SEAT_M + 0.17]) + 0.1 * aside
    feet = np.array([thigh_m + 0.03, 0.0, max(ANKLE_HEIGHT * height, SEAT_M + 0.06 - 0.246 * height)]) + 0.09 * aside
    joints = seated(height, [0.0, 0.0, SEAT_M + 0.09], lean_rad, hands, feet)
    return assemble(name, label, [dressed(joints, height, appearance)], share=share, stands=True)
