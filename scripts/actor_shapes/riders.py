"""Two-wheelers with their riders: motorcycles, bicycles, scooters.

Sizes follow from the machines (a motorcycle has a wheelbase of about 1.4 m and wheels of 0.62 m, a bicycle 1.06 m and
0.68 m, an electric kick scooter 0.95 m and 0.25 m) and from their riders. For comparison, nuScenes' anchors (means of
labelled boxes, many without a rider) are 2.11 x 0.77 x 1.47 m for motorcycles and 1.68 x 0.60 x 1.27 m for bicycles.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from itertools import chain

import numpy as np

from actor_shapes.attachments import WOOD, hoop, plate
from actor_shapes.figure import JEANS, LEATHER, Appearance, dressed, seated
from actor_shapes.parts import Part, across, assemble, block, loft, tube, wheel
from actor_shapes.pedestrians import BABY, BAND, VEST
from actor_shapes.surfaces import ACCENT, GLASS, HEADLIGHT, METAL, PAINT, PLASTIC, RGB, TAILLIGHT, Surface
from coopsim.geometry import exact
from coopsim.geometry.se3 import Floats
from coopsim.types.taxonomy import ObjectClass
from coopsim.world.models.model import Model

PEDAL_POSES = 8
DEVELOPMENT_M = 5.0
"""Distance that a bicycle travels in one turn of the pedals, in a middle gear."""

_CRANK_M = 0.17
_DECK_M, _KICK_GRIPS = 0.16, np.array([0.80, 0.0, 1.10])
_MOTOR_GRIPS = np.array([0.94, 0.0, 1.02])

PAIR = np.array([[0.0, 1.0, 0.0], [0.0, -1.0, 0.0]])
"""Unit vectors to the left and the right."""

REFLECTOR = Surface(0.0, 100.0, (190, 20, 24))
DELIVERY = Surface(0.0, 0.55, (0, 150, 136))
_LUGGAGE = Surface(0.0, 0.3, (60, 62, 40))
_SLIM = [0.022, 0.022]

# fmt: off
_MOTORCYCLISTS: tuple[tuple[str, float, float, float, RGB, bool, bool], ...] = (
    # name, share, height (m), lean (rad), helmet, screen, cases
    ("roadster", 1.0, 1.78, 0.25, (250, 250, 246), False, False),
    ("sports_bike", 1.0, 1.75, 0.75, (30, 30, 34), True, False),
    ("tourer", 1.0, 1.80, 0.12, (190, 30, 32), True, True),
    ("roadster_tall_rider", 1.0, 1.90, 0.30, (40, 60, 130), False, False),
    ("sports_bike_short_rider", 0.7, 1.66, 0.70, (220, 60, 30), True, False),
    ("tourer_upright", 0.7, 1.84, 0.05, (230, 228, 220), True, True),
)
_CYCLISTS: tuple[tuple[str, float, float, float, RGB, float, Appearance], ...] = (
    # name, share, height (m), lean (rad), paint, scale, appearance
    ("city_bicycle", 1.0, 1.68, 0.42, (36, 66, 52), 1.0, Appearance(hair=(92, 62, 40))),
    ("racing_bicycle", 1.0, 1.78, 0.85, (200, 34, 30), 1.0,
     Appearance(bare_forearms=True, hair=(235, 235, 230), girth=0.95)),
    ("youth_bicycle", 1.0, 1.50, 0.38, (38, 96, 170), 0.86, Appearance(head=1.12, hair=(240, 196, 40))),
    ("city_bicycle_tall_rider", 1.0, 1.86, 0.40, (40, 42, 48), 1.06, Appearance(hair=(60, 44, 36), girth=1.05)),
    ("city_bicycle_upright", 1.0, 1.62, 0.18, (150, 36, 60), 0.98,
     Appearance(hair=(168, 136, 84), skin=(220, 178, 152))),
    ("bicycle_warning_vest", 0.6, 1.76, 0.45, (90, 94, 98), 1.0, Appearance(top=VEST, band=BAND, hair=(230, 230, 226))),
    ("small_bicycle", 0.5, 1.40, 0.35, (230, 120, 30), 0.78, Appearance(head=1.15, hair=(200, 40, 60))),
)
_PLAIN = 3  # first rows of both tables: without plates and reflectors
_KICK_SCOOTER_RIDERS: tuple[tuple[str, float, float, Appearance], ...] = (  # name, share, height (m), appearance
    ("kick_scooter", 1.0, 1.75, Appearance(hair=(40, 34, 30), backpack=Surface(0.0, 0.3, (52, 54, 58)))),
    ("kick_scooter_short_rider", 1.0, 1.62, Appearance(bare_forearms=True, hair=(120, 84, 50), skin=(224, 184, 156))),
    ("kick_scooter_tall_rider", 0.8, 1.88, Appearance(skin=(84, 58, 44))),
    ("kick_scooter_youth", 0.5, 1.48, Appearance(head=1.12, hair=(200, 60, 50))),
)
# fmt: on


def make_motorcycles() -> list[Model]:
    """Build a roadster, a sports machine with a leaning rider, and a tourer with a screen and cases."""
    return [_motorcycle(*row) for row in _MOTORCYCLISTS[:_PLAIN]]


def make_bicycles() -> list[Model]:
    """Build a city bicycle, a racing bicycle, and one for a child of about twelve."""
    return [_bicycle(*row) for row in _CYCLISTS[:_PLAIN]]


def make_scooters() -> list[Model]:
    """Build two electric kick scooters, like those on V2X-Real's campus, and a motor scooter."""
    motor_scooter = _rigid("motor_scooter", ObjectClass.SCOOTER, 1.0, motor_scooter_parts(), motor_scooter_rider())
    return [*(_kick_scooter(*row) for row in _KICK_SCOOTER_RIDERS[:2]), motor_scooter]


def make_varied_riders() -> list[Model]:
    """Build motorcycles, bicycles and scooters of more sizes, each with riders and then parked.

    They have plates and reflectors, boxes and bags, a passenger, a child. A long cargo bicycle is about 2.5 m. Two on
    one scooter, and how often, are assumed by us: about one in seven.
    """
    return [*_varied_motorcycles(), *_varied_bicycles(), *_varied_scooters()]


def _motorcycle(
    name: str, share: float, height: float, lean_rad: float, helmet: RGB, screen: bool, cases: bool, *more: Part
) -> Model:
    machine = motorcycle_parts(lean_rad, screen=screen, cases=cases)
    return _rigid(name, ObjectClass.MOTORCYCLE, share, machine, more, motorcycle_rider(height, lean_rad, helmet))


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
    appearance = Appearance(top=jacket, bottom=JEANS, hair=helmet, helmet=True, girth=1.1)
    return dressed(seated(height, hips, lean_rad, grips + 0.33 * PAIR, feet), height, appearance)


def cyclists(height: float, lean_rad: float, scale: float, appearance: Appearance) -> list[list[Part]]:
    """Build the rider of a bicycle in each pose of a turn of the pedals."""
    poses = []
    saddle, grips = scale * np.array([[0.22, 0.0, 0.97], [0.86, 0.0, 1.04 - 0.16 * lean_rad]])
    for k in range(PEDAL_POSES):
        turn = 2 * np.pi * k / PEDAL_POSES + np.array([0.0, np.pi])
        pedal = np.stack([0.42 + _CRANK_M * exact.cos(turn), [0.11, -0.11], 0.28 - _CRANK_M * exact.sin(turn)], axis=1)
        ankle = scale * (pedal + np.array([-0.06, 0.0, 0.08]))
        hips = saddle + np.array([0.0, 0.0, 0.05])
        poses.append(dressed(seated(height, hips, lean_rad, grips + 0.24 * scale * PAIR, ankle), height, appearance))
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


def _kick_scooter(name: str, share: float, height: float, appearance: Appearance) -> Model:
    return _rigid(name, ObjectClass.SCOOTER, share, kick_scooter_parts(), kick_scooter_rider(height, appearance))


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


def kick_scooter_rider(height: float, appearance: Appearance) -> list[Part]:
    """Build the rider, who stands."""
    deck, grips = _DECK_M, _KICK_GRIPS
    feet = np.array([[0.44, 0.05, deck + 0.05 * height], [0.18, -0.05, deck + 0.05 * height]])
    hips = np.array([0.28, 0.0, deck + 0.53 * height])
    return dressed(seated(height, hips, 0.06, grips + 0.21 * PAIR, feet), height, appearance)


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
    appearance = Appearance(top=Surface(1.0, 0.4, accented=True), bottom=JEANS, hair=(236, 232, 220), helmet=True)
    feet = np.array([0.78, 0.0, 0.38]) + 0.12 * PAIR
    return dressed(seated(height, [0.34, 0.0, 0.82], 0.18, grips + 0.29 * PAIR, feet), height, appearance)


def _bicycle(
    name: str,
    share: float,
    height: float,
    lean_rad: float,
    paint: RGB,
    scale: float,
    appearance: Appearance,
    *more: Part,
) -> Model:
    machine = [*bicycle_frame(Surface(0.0, 0.5, paint), scale), *more]
    return _cycling(name, share, machine, cyclists(height, lean_rad, scale, appearance), scale)


def _cycling(name: str, share: float, machine: list[Part], riders: list[list[Part]], scale: float = 1.0) -> Model:
    poses = [[*machine, *rider] for rider in riders]
    return assemble(name, ObjectClass.BICYCLE, poses, cycle_m=DEVELOPMENT_M * scale, share=share)


def _rigid(name: str, label: ObjectClass, share: float, *parts: Iterable[Part], stands: bool = False) -> Model:
    return assemble(name, label, [[*chain(*parts)]], share=share, stands=stands)


def _varied_motorcycles() -> list[Model]:
    label, mark = ObjectClass.MOTORCYCLE, _mark(-0.235, 0.72)
    models = [_motorcycle(*row, _moved(mark, -0.09 * row[-1])) for row in _MOTORCYCLISTS[_PLAIN:]]
    plain = [*motorcycle_parts(0.25, screen=False, cases=False), mark]
    rider = motorcycle_rider(1.76, 0.25, (20, 20, 24))
    box = block((-0.36, 0.08), 0.23, (0.88, 1.32), DELIVERY)
    pillion = _passenger(1.68, [0.12, 0.0, 0.98], [0.46, 0.0, 1.06], [0.32, 0.0, 0.44], 0.2)
    return [
        *models,
        _rigid("motorcycle_delivery", label, 0.6, plain, [box], rider),
        _rigid("motorcycle_two_riders", label, 0.5, plain, rider, pillion),
        _scaled(models[2], "cruiser", (2.45, 0.92, 1.60), 0.7),
        _scaled(models[0], "small_motorcycle", (1.82, 0.68, 1.66), 0.8),
        _rigid("motorcycle_parked", label, 1.5, plain, [_stem(1.12, 0.98, 0.98)], stands=True),
    ]


def _varied_bicycles() -> list[Model]:
    mark = _reflector(-0.08, 0.62)
    models = [_bicycle(*row, _reflector(-0.05, 0.62 * row[5])) for row in _CYCLISTS[_PLAIN:]]
    frame = [
        *bicycle_frame(Surface(0.0, 0.5, (52, 88, 120)), 1.0),
        block((-0.28, 0.2), 0.06, (0.70, 0.73), METAL),
        mark,
    ]
    riders = cyclists(1.70, 0.35, 1.0, Appearance(hair=(92, 62, 40), girth=1.02))
    bags = [block((-0.28, 0.06), 0.07, (0.36, 0.70), _LUGGAGE, side * 0.13) for side in (1, -1)]
    cube = block((-0.32, 0.10), 0.22, (1.12, 1.54), DELIVERY)
    post = tube([[0.26, 0.0, 0.80], [0.23, 0.0, 0.94]], _SLIM, METAL, 3)
    parked = bicycle_frame(Surface(1.0, 0.5), 1.0)
    return [
        *models,
        _cycling("bicycle_panniers", 0.7, [*frame, *bags], riders),
        _cycling("bicycle_child_seat", 0.4, [*frame, *_child_seat()], riders),
        _cycling("bicycle_delivery", 0.5, [*frame, cube], cyclists(1.77, 0.32, 1.0, Appearance(girth=1.05))),
        _cycling("cargo_bicycle", 0.4, [*_cargo_frame(), mark], riders),
        _rigid("bicycle_parked", ObjectClass.BICYCLE, 3.0, parked, [post], stands=True),
    ]


def _varied_scooters() -> list[Model]:
    label, kick, motor = ObjectClass.SCOOTER, kick_scooter_parts(), [*motor_scooter_parts(), _mark(-0.295, 0.52)]
    hands, feet = [0.22, 0.0, 1.20] + 0.19 * PAIR, [0.10, 0.0, 0.24] + 0.05 * PAIR
    behind = dressed(
        seated(1.64, [0.03, 0.0, 1.03], 0.05, hands, feet), 1.64, Appearance(hair=(30, 26, 26), skin=(140, 98, 70))
    )
    pillion = _passenger(1.66, [0.02, 0.0, 0.87], [0.30, 0.0, 0.98], [0.42, 0.0, 0.38], 0.12)
    rider, box = motor_scooter_rider(), block((-0.36, 0.05), 0.22, (0.80, 1.24), DELIVERY)
    return [
        *(_kick_scooter(*row) for row in _KICK_SCOOTER_RIDERS[2:]),
        _rigid("kick_scooter_two_riders", label, 0.5, kick, kick_scooter_rider(1.74, Appearance()), behind),
        _rigid("motor_scooter_plate", label, 0.8, motor, rider),
        _rigid("motor_scooter_two_riders", label, 0.4, motor, rider, pillion),
        _rigid("motor_scooter_delivery", label, 0.5, motor, rider, [box]),
        _rigid("kick_scooter_parked", label, 2.0, kick, stands=True),
        _rigid("motor_scooter_parked", label, 1.0, motor, [_stem(1.06, 0.94, 1.01)], stands=True),
    ]


def _scaled(model: Model, name: str, size_m: tuple[float, float, float], share: float) -> Model:
    factor = np.array(size_m) / model.size_m
    vertices, poses = model.vertices * factor, model.poses * factor
    return replace(model, name=name, size_m=np.array(size_m), vertices=vertices, poses=poses, share=share)


def _passenger(height: float, hips: list[float], hands: list[float], feet: list[float], lean_rad: float) -> list[Part]:
    """Build a passenger with a helmet, whose hands hold the rider's waist."""
    appearance = Appearance(top=ACCENT, bottom=JEANS, hair=(150, 152, 158), helmet=True)
    return dressed(seated(height, hips, lean_rad, hands + 0.17 * PAIR, feet + 0.2 * PAIR), height, appearance)


def _child_seat() -> list[Part]:
    """Build a seat over the rear wheel with a small child in it."""
    return [
        block((-0.30, 0.12), 0.14, (0.73, 0.80), PLASTIC),
        block((-0.34, -0.28), 0.14, (0.73, 1.22), PLASTIC),
        block((-0.27, -0.05), 0.13, (0.80, 1.12), Surface(1.0, 0.5, accented=True)),
        block((-0.25, -0.08), 0.085, (1.12, 1.32), BABY),
    ]


def _cargo_frame() -> list[Part]:
    """Build a bicycle with a box between the handlebars and the front wheel, 1.8 m ahead of the rear one."""
    paint = Surface(0.0, 0.5, (36, 66, 52))
    rear, front, crank, seat, head = (
        np.array([x, 0.0, z]) for x, z in ((0.0, 0.34), (1.86, 0.25), (0.42, 0.28), (0.26, 0.80), (0.86, 0.72))
    )
    grips = np.array([0.84, 0.0, 1.02])
    floor = np.array([1.0, 0.0, 0.24])
    bars = [(rear, crank), (rear, seat), (crank, seat), (crank, floor), (seat, head), (floor, front), (head, grips)]
    bars += [(head, floor)]
    tray = [(z, x0, x1, half) for z, x0, x1, half in ((0.26, 1.0, 1.50, 0.22), (0.80, 0.93, 1.62, 0.31))]
    outlines = [[(x1, half, z), (x0, half, z), (x0, -half, z), (x1, -half, z)] for z, x0, x1, half in tray]
    return [
        hoop(rear, 0.34),
        hoop(front, 0.25),
        *(tube(bar, _SLIM, paint, 3) for bar in bars),
        tube(grips + 0.28 * PAIR, _SLIM, PLASTIC, 3),
        block((0.10, 0.36), 0.08, (0.92, 0.98), PLASTIC),
        loft(outlines, WOOD),
    ]


def _mark(x: float, z: float) -> Part:
    """Build a small number plate that looks back."""
    return plate(x, z, -1.0, half_m=0.1)


def _stem(x: float, grips_x: float, z: float) -> Part:
    """Build what holds the handlebars, where no rider hides it."""
    return tube([[x, 0.0, z - 0.04], [grips_x, 0.0, z]], [0.04, 0.03], METAL, 3)


def _reflector(x: float, z: float) -> Part:
    """Build a red reflector that looks back."""
    edge = [(x, z), (x, z + 0.05), (x + 0.03, z + 0.025)]
    return loft([[(along, y, up) for along, up in edge] for y in (0.04, -0.04)], REFLECTOR)


def _moved(part: Part, x: float) -> Part:
    shift: Floats = np.array([x, 0.0, 0.0])
    return replace(part, vertices=part.vertices + shift)
