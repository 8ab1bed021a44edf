"""Walking people: adults and children.

Heights are about the means of the United States: 1.75 m for men and 1.61 m for women (NCHS, Vital and Health
Statistics 3(46), 2021), 1.02 m at four years, 1.22 m at seven and 1.38 m at ten (CDC growth charts, 2000). Children's
heads are larger in proportion.
"""

from __future__ import annotations

import numpy as np

from coopsim.geometry import exact
from coopsim.geometry.se3 import Floats
from coopsim.types.taxonomy import ObjectClass
from coopsim.world.models.figure import (
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
    Joints,
    Look,
    dressed,
)
from coopsim.world.models.model import Model
from coopsim.world.models.parts import Surface, assemble

POSES = 8
"""Number of poses in a cycle of two steps."""

_LEG_SWING_RAD = np.radians(18.0)
_ARM_SWING_RAD = np.radians(16.0)
_KNEE_RAD = np.radians(55.0)
_ELBOW_RAD = np.radians(20.0)


_SATCHEL = Surface(0.0, 0.6, (214, 96, 34))

ADULTS: dict[str, tuple[float, Look]] = {
    "man": (1.78, Look(girth=1.05, hair=(58, 44, 36))),
    "woman": (1.63, Look(girth=0.95, hair=(96, 66, 40), coat=True, skin=(214, 172, 146))),
    "young_man": (1.73, Look(bare_forearms=True, skin=(120, 84, 62), hair=(26, 24, 24), backpack=BOTTOM)),
    "elderly_woman": (1.57, Look(girth=1.1, hair=(196, 194, 190), skin=(210, 170, 148))),
}
CHILDREN: dict[str, tuple[float, Look]] = {
    "child_of_4": (1.02, Look(girth=1.2, head=1.45, hair=(150, 112, 70))),
    "child_of_7": (1.22, Look(girth=1.1, head=1.3, bare_forearms=True, hair=(40, 32, 28))),
    "child_of_10": (1.38, Look(head=1.2, backpack=_SATCHEL, hair=(80, 54, 36))),
}
"""Heights (m) and looks by name."""


def make_adults() -> list[Model]:
    """Build four adults."""
    return [_walker(name, *each, ObjectClass.PEDESTRIAN) for name, each in ADULTS.items()]


def make_children() -> list[Model]:
    """Build three children."""
    return [_walker(name, *each, ObjectClass.CHILD) for name, each in CHILDREN.items()]


def _walker(name: str, height: float, look: Look, label: ObjectClass) -> Model:
    poses = [dressed(walking(height, k / POSES), height, look) for k in range(POSES)]
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
