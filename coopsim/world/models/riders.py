"""Two-wheelers with their riders: motorcycles, bicycles, scooters.

Sizes follow from the machines (a motorcycle has a wheelbase of about 1.4 m and wheels of 0.62 m, a bicycle 1.06 m and
0.68 m, an electric kick scooter 0.95 m and 0.25 m) and from their riders. For comparison, nuScenes' anchors (means of
labelled boxes, many without a rider) are 2.11 x 0.77 x 1.47 m for motorcycles and 1.68 x 0.60 x 1.27 m for bicycles.
"""

from __future__ import annotations

import numpy as np

from coopsim.geometry import exact
from coopsim.geometry.se3 import Floats
from coopsim.types.taxonomy import ObjectClass
from coopsim.world.models.figure import JEANS, LEATHER, Look, dressed, seated
from coopsim.world.models.model import Model
from coopsim.world.models.parts import (
    GLASS,
    HEADLIGHT,
    METAL,
    PAINT,
    PLASTIC,
    RGB,
    TAILLIGHT,
    TYRE,
    Part,
    Surface,
    across,
    assemble,
    block,
    loft,
    tube,
    wheel,
)

PEDAL_POSES = 8
DEVELOPMENT_M = 5.0
"""Distance that a bicycle travels in one turn of the pedals, in a middle gear."""

_CRANK_M = 0.17
_DECK_M, _KICK_GRIPS = 0.16, np.array([0.80, 0.0, 1.10])
_MOTOR_GRIPS = np.array([0.94, 0.0, 1.02])

PAIR = np.array([[0.0, 1.0, 0.0], [0.0, -1.0, 0.0]])
"""Unit vectors to the left and the right."""


def make_motorcycles() -> list[Model]:
    """Build a roadster, a sports machine with a leaning rider, and a tourer with a screen and cases."""
    return [
        _motorcycle("roadster", 1.78, 0.25, (250, 250, 246), screen=False, cases=False),
        _motorcycle("sports_bike", 1.75, 0.75, (30, 30, 34), screen=True, cases=False),
        _motorcycle("tourer", 1.80, 0.12, (190, 30, 32), screen=True, cases=True),
    ]


def make_bicycles() -> list[Model]:
    """Build a city bicycle, a racing bicycle, and one for a child of about twelve."""
    return [
        _bicycle("city_bicycle", 1.68, 0.42, (36, 66, 52), 1.0, Look(hair=(92, 62, 40))),
        _bicycle(
            "racing_bicycle", 1.78, 0.85, (200, 34, 30), 1.0, Look(bare_forearms=True, hair=(235, 235, 230), girth=0.95)
        ),
        _bicycle("youth_bicycle", 1.50, 0.38, (38, 96, 170), 0.86, Look(head=1.12, hair=(240, 196, 40))),
    ]


def make_scooters() -> list[Model]:
    """Build two electric kick scooters, like those on V2X-Real's campus, and a motor scooter."""
    return [
        _kick_scooter("kick_scooter", 1.75, Look(hair=(40, 34, 30), backpack=Surface(0.0, 0.3, (52, 54, 58)))),
        _kick_scooter(
            "kick_scooter_short_rider", 1.62, Look(bare_forearms=True, hair=(120, 84, 50), skin=(224, 184, 156))
        ),
        _motor_scooter(),
    ]


def _motorcycle(name: str, height: float, lean_rad: float, helmet: RGB, *, screen: bool, cases: bool) -> Model:
    machine = motorcycle_parts(lean_rad, screen=screen, cases=cases)
    return assemble(name, ObjectClass.MOTORCYCLE, [[*machine, *motorcycle_rider(height, lean_rad, helmet)]])


def motorcycle_parts(lean_rad: float, *, screen: bool, cases: bool) -> list[Part]:
    """Build a motorcycle with handlebars for a rider who leans forward so much."""
    grips = np.array([0.98, 0.0, 0.98 - 0.1 * lean_rad])
    body = [
        across(-0.22, [(0.80, 0.05), (0.90, 0.04)]),
        across(0.10, [(0.66, 0.10), (0.86, 0.12)]),
        across(0.55, [(0.50, 0.13), (0.80, 0.13)]),
        across(0.75, [(0.42, 0.15), (0.99, 0.13)]),
        across(1.05, [(0.55, 0.11), (0.92, 0.07)]),
    ]
    seat = {(1, 1): LEATHER, (2, 1): LEATHER}
    machine = [
        wheel(0.0, 0.08, 0.31, 0.16, sides=10),
        wheel(1.42, 0.06, 0.31, 0.12, sides=10),
        loft(body, PAINT, seat, (TAILLIGHT, PAINT)),
        block((0.45, 0.95), 0.17, (0.20, 0.56), METAL),
        tube([[1.42, 0.0, 0.31], [1.12, 0.0, 1.0]], [0.07, 0.07], METAL),
        tube(grips + 0.36 * PAIR, [0.025, 0.025], PLASTIC),
        block((1.15, 1.27), 0.09, (0.80, 0.97), HEADLIGHT),
    ]
    if screen:
        shield = [across(1.10, [(0.86, 0.20), (1.0, 0.14)]), across(1.26, [(0.66, 0.10), (0.80, 0.10)])]
        machine.append(loft(shield, PAINT))
        machine.append(
            loft([across(1.0, [(1.2, 0.10), (1.24, 0.10)]), across(1.16, [(0.95, 0.15), (0.99, 0.15)])], GLASS)
        )
    if cases:
        machine += [block((-0.30, 0.22), 0.11, (0.50, 0.86), PAINT, side * 0.28) for side in (1, -1)]
        machine.append(block((-0.32, 0.08), 0.20, (0.90, 1.18), PAINT))
    return machine


def motorcycle_rider(height: float, lean_rad: float, helmet: RGB) -> list[Part]:
    """Build the rider."""
    hips, grips = np.array([0.50, 0.0, 0.90]), np.array([0.98, 0.0, 0.98 - 0.1 * lean_rad])
    jacket = Surface(1.0, 0.4, accented=True)
    feet = np.array([0.52, 0.0, 0.40]) + 0.22 * PAIR
    look = Look(top=jacket, bottom=JEANS, hair=helmet, helmet=True, girth=1.1)
    return dressed(seated(height, hips, lean_rad, grips + 0.33 * PAIR, feet), height, look)


def _bicycle(name: str, height: float, lean_rad: float, paint: RGB, scale: float, look: Look) -> Model:
    machine = bicycle_frame(Surface(0.0, 0.5, paint), scale)
    poses = [[*machine, *rider] for rider in cyclists(height, lean_rad, scale, look)]
    return assemble(name, ObjectClass.BICYCLE, poses, cycle_m=DEVELOPMENT_M * scale)


def cyclists(height: float, lean_rad: float, scale: float, look: Look) -> list[list[Part]]:
    """Build the rider of a bicycle in each pose of a turn of the pedals."""
    poses = []
    saddle, grips = scale * np.array([[0.22, 0.0, 0.97], [0.86, 0.0, 1.04 - 0.16 * lean_rad]])
    for k in range(PEDAL_POSES):
        turn = 2 * np.pi * k / PEDAL_POSES + np.array([0.0, np.pi])
        pedal = np.stack([0.42 + _CRANK_M * exact.cos(turn), [0.11, -0.11], 0.28 - _CRANK_M * exact.sin(turn)], axis=1)
        ankle = scale * (pedal + np.array([-0.06, 0.0, 0.08]))
        hips = saddle + np.array([0.0, 0.0, 0.05])
        poses.append(dressed(seated(height, hips, lean_rad, grips + 0.24 * scale * PAIR, ankle), height, look))
    return poses


def bicycle_frame(paint: Surface, scale: float) -> list[Part]:
    """Build two hoops and the tubes between them; light passes through the wheels as it does between spokes."""
    rear, front, crank, seat, head = (
        scale * np.array([x, 0.0, z]) for x, z in ((0.0, 0.34), (1.06, 0.34), (0.42, 0.28), (0.26, 0.80), (0.84, 0.86))
    )
    grips = scale * np.array([0.84, 0.0, 1.02])
    slim = [0.02 * scale] * 2
    bars = [(rear, crank), (rear, seat), (crank, seat), (crank, head), (seat, head), (front, head), (head, grips)]
    return [
        *(hoop(hub, 0.34 * scale) for hub in (rear, front)),
        *(tube(bar, slim, paint, 3) for bar in bars),
        tube(grips + 0.28 * scale * PAIR, slim, PLASTIC, 3),
        block((0.10 * scale, 0.36 * scale), 0.08 * scale, (0.92 * scale, 0.98 * scale), LEATHER),
    ]


def hoop(hub: Floats, radius: float, sides: int = 12) -> Part:
    """Build a tyre of triangular section, without spokes."""
    turn = np.arange(sides) * 2 * np.pi / sides + np.pi / sides
    spoke = np.stack([exact.cos(turn), np.zeros(sides), exact.sin(turn)], axis=1)
    rings = [
        hub + radius * spoke,
        hub + 0.92 * radius * spoke + [0, 0.022, 0],
        hub + 0.92 * radius * spoke - [0, 0.022, 0],
    ]
    return loft(np.stack(rings, axis=1), TYRE, ring=True)


def _kick_scooter(name: str, height: float, look: Look) -> Model:
    return assemble(name, ObjectClass.SCOOTER, [[*kick_scooter_parts(), *kick_scooter_rider(height, look)]])


def kick_scooter_parts() -> list[Part]:
    """Build an electric kick scooter."""
    deck, grips = _DECK_M, _KICK_GRIPS
    return [
        wheel(0.0, 0.025, 0.125, 0.05),
        wheel(0.95, 0.025, 0.125, 0.05),
        block((-0.05, 0.80), 0.085, (0.10, deck), PLASTIC),
        tube(np.stack([[0.95, 0.0, 0.14], [0.86, 0.0, 0.5], grips]), [0.03, 0.03, 0.02], METAL),
        tube(grips + 0.24 * PAIR, [0.02, 0.02], PLASTIC),
        block((-0.09, -0.04), 0.05, (0.20, 0.26), TAILLIGHT),
    ]


def kick_scooter_rider(height: float, look: Look) -> list[Part]:
    """Build the rider, who stands."""
    deck, grips = _DECK_M, _KICK_GRIPS
    feet = np.array([[0.44, 0.05, deck + 0.05 * height], [0.18, -0.05, deck + 0.05 * height]])
    hips = np.array([0.28, 0.0, deck + 0.53 * height])
    return dressed(seated(height, hips, 0.06, grips + 0.21 * PAIR, feet), height, look)


def _motor_scooter() -> Model:
    return assemble("motor_scooter", ObjectClass.SCOOTER, [[*motor_scooter_parts(), *motor_scooter_rider()]])


def motor_scooter_parts() -> list[Part]:
    """Build a motor scooter."""
    grips = _MOTOR_GRIPS
    tail = [
        across(-0.28, [(0.55, 0.06), (0.72, 0.05)]),
        across(0.0, [(0.34, 0.16), (0.78, 0.13)]),
        across(0.50, [(0.26, 0.15), (0.76, 0.12)]),
    ]
    shield = [
        across(1.02, [(0.24, 0.18), (0.60, 0.20), (0.98, 0.14)]),
        across(1.16, [(0.34, 0.08), (0.60, 0.11), (0.98, 0.08)]),
    ]
    return [
        wheel(0.0, 0.06, 0.23, 0.12, sides=10),
        wheel(1.26, 0.055, 0.23, 0.11, sides=10),
        loft(tail, PAINT, {(0, 1): LEATHER, (1, 1): LEATHER}, (TAILLIGHT, PAINT)),
        block((0.45, 1.06), 0.17, (0.24, 0.31), PLASTIC),
        loft(shield, PAINT),
        block((1.12, 1.18), 0.08, (0.78, 0.92), HEADLIGHT),
        tube([[1.26, 0.0, 0.23], [1.14, 0.0, 0.5]], [0.05, 0.05], METAL),
        tube(grips + 0.34 * PAIR, [0.025, 0.025], PLASTIC),
    ]


def motor_scooter_rider() -> list[Part]:
    """Build the rider, with a helmet."""
    height, grips = 1.70, _MOTOR_GRIPS
    look = Look(top=Surface(1.0, 0.4, accented=True), bottom=JEANS, hair=(236, 232, 220), helmet=True)
    feet = np.array([0.78, 0.0, 0.38]) + 0.12 * PAIR
    return dressed(seated(height, [0.34, 0.0, 0.82], 0.18, grips + 0.29 * PAIR, feet), height, look)
