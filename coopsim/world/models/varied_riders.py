"""Two-wheelers of more sizes: with plates and reflectors, boxes and bags, a passenger, a child; parked ones alone.

A long cargo bicycle is about 2.5 m. Two on one scooter, and how often, are assumed by us: about one in seven.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from coopsim.geometry.se3 import Floats
from coopsim.types.taxonomy import ObjectClass
from coopsim.world.models.attachments import WOOD, plate
from coopsim.world.models.belongings import BABY
from coopsim.world.models.figure import JEANS, Look, dressed, seated
from coopsim.world.models.model import Model
from coopsim.world.models.parts import ACCENT, METAL, PLASTIC, RGB, Part, Surface, assemble, block, loft, tube
from coopsim.world.models.riders import (
    DEVELOPMENT_M,
    PAIR,
    bicycle_frame,
    cyclists,
    hoop,
    kick_scooter_parts,
    kick_scooter_rider,
    motor_scooter_parts,
    motor_scooter_rider,
    motorcycle_parts,
    motorcycle_rider,
)
from coopsim.world.models.varied_people import BAND, VEST

REFLECTOR = Surface(0.0, 100.0, (190, 20, 24))
DELIVERY = Surface(0.0, 0.55, (0, 150, 136))
_LUGGAGE = Surface(0.0, 0.3, (60, 62, 40))
_SLIM = [0.022, 0.022]

_MOTORCYCLISTS: tuple[tuple[str, float, float, float, RGB, bool, bool], ...] = (
    # name, share, height (m), lean (rad), helmet, screen, cases
    ("roadster_tall_rider", 1.0, 1.90, 0.30, (40, 60, 130), False, False),
    ("sports_bike_short_rider", 0.7, 1.66, 0.70, (220, 60, 30), True, False),
    ("tourer_upright", 0.7, 1.84, 0.05, (230, 228, 220), True, True),
)
_CYCLISTS: tuple[tuple[str, float, float, float, RGB, float, Look], ...] = (
    # name, share, height (m), lean (rad), paint, scale, look
    ("city_bicycle_tall_rider", 1.0, 1.86, 0.40, (40, 42, 48), 1.06, Look(hair=(60, 44, 36), girth=1.05)),
    ("city_bicycle_upright", 1.0, 1.62, 0.18, (150, 36, 60), 0.98, Look(hair=(168, 136, 84), skin=(220, 178, 152))),
    ("bicycle_warning_vest", 0.6, 1.76, 0.45, (90, 94, 98), 1.0, Look(top=VEST, band=BAND, hair=(230, 230, 226))),
    ("small_bicycle", 0.5, 1.40, 0.35, (230, 120, 30), 0.78, Look(head=1.15, hair=(200, 40, 60))),
)


def make_varied_riders() -> list[Model]:
    """Build motorcycles, bicycles and scooters, each with riders and then parked."""
    return [*_motorcycles(), *_bicycles(), *_scooters()]


def _motorcycles() -> list[Model]:
    label, mark = ObjectClass.MOTORCYCLE, _mark(-0.235, 0.72)
    models = []
    for name, share, height, lean_rad, helmet, screen, cases in _MOTORCYCLISTS:
        rider = motorcycle_rider(height, lean_rad, helmet)
        machine = [*motorcycle_parts(lean_rad, screen=screen, cases=cases), _moved(mark, -0.09 * cases)]
        models.append(_model(name, label, share, [*machine, *rider]))
    plain, rider = (
        [*motorcycle_parts(0.25, screen=False, cases=False), mark],
        motorcycle_rider(1.76, 0.25, (20, 20, 24)),
    )
    box = block((-0.36, 0.08), 0.23, (0.88, 1.32), DELIVERY)
    pillion = _passenger(1.68, [0.12, 0.0, 0.98], [0.46, 0.0, 1.06], [0.32, 0.0, 0.44], 0.2)
    return [
        *models,
        _model("motorcycle_delivery", label, 0.6, [*plain, box, *rider]),
        _model("motorcycle_two_riders", label, 0.5, [*plain, *rider, *pillion]),
        _scaled(models[2], "cruiser", (2.45, 0.92, 1.60), 0.7),
        _scaled(models[0], "small_motorcycle", (1.82, 0.68, 1.66), 0.8),
        _model("motorcycle_parked", label, 1.5, [*plain, _stem(1.12, 0.98, 0.98)], stands=True),
    ]


def _bicycles() -> list[Model]:
    mark, models = _reflector(-0.08, 0.62), []
    for name, share, height, lean_rad, paint, scale, look in _CYCLISTS:
        machine = [*bicycle_frame(Surface(0.0, 0.5, paint), scale), _reflector(-0.05, 0.62 * scale)]
        models.append(_cycling(name, share, machine, cyclists(height, lean_rad, scale, look), scale))
    frame = [
        *bicycle_frame(Surface(0.0, 0.5, (52, 88, 120)), 1.0),
        block((-0.28, 0.2), 0.06, (0.70, 0.73), METAL),
        mark,
    ]
    parked = bicycle_frame(Surface(1.0, 0.5), 1.0)
    post = tube([[0.26, 0.0, 0.80], [0.23, 0.0, 0.94]], _SLIM, METAL, 3)
    riders = cyclists(1.70, 0.35, 1.0, Look(hair=(92, 62, 40), girth=1.02))
    bags = [block((-0.28, 0.06), 0.07, (0.36, 0.70), _LUGGAGE, side * 0.13) for side in (1, -1)]
    cube = [block((-0.32, 0.10), 0.22, (1.12, 1.54), DELIVERY)]
    return [
        *models,
        _cycling("bicycle_panniers", 0.7, [*frame, *bags], riders),
        _cycling("bicycle_child_seat", 0.4, [*frame, *_child_seat()], riders),
        _cycling("bicycle_delivery", 0.5, [*frame, *cube], cyclists(1.77, 0.32, 1.0, Look(girth=1.05))),
        _cycling("cargo_bicycle", 0.4, [*_cargo_frame(), mark], riders),
        _model("bicycle_parked", ObjectClass.BICYCLE, 3.0, [*parked, post], stands=True),
    ]


def _scooters() -> list[Model]:
    label, kick, motor = ObjectClass.SCOOTER, kick_scooter_parts(), [*motor_scooter_parts(), _mark(-0.295, 0.52)]
    look = Look(hair=(30, 26, 26), skin=(140, 98, 70))
    behind = dressed(
        seated(1.64, [0.03, 0.0, 1.03], 0.05, [0.22, 0.0, 1.20] + 0.19 * PAIR, [0.10, 0.0, 0.24] + 0.05 * PAIR),
        1.64,
        look,
    )
    pillion = _passenger(1.66, [0.02, 0.0, 0.87], [0.30, 0.0, 0.98], [0.42, 0.0, 0.38], 0.12)
    return [
        _model("kick_scooter_tall_rider", label, 0.8, [*kick, *kick_scooter_rider(1.88, Look(skin=(84, 58, 44)))]),
        _model(
            "kick_scooter_youth", label, 0.5, [*kick, *kick_scooter_rider(1.48, Look(head=1.12, hair=(200, 60, 50)))]
        ),
        _model("kick_scooter_two_riders", label, 0.5, [*kick, *kick_scooter_rider(1.74, Look()), *behind]),
        _model("motor_scooter_plate", label, 0.8, [*motor, *motor_scooter_rider()]),
        _model("motor_scooter_two_riders", label, 0.4, [*motor, *motor_scooter_rider(), *pillion]),
        _model(
            "motor_scooter_delivery",
            label,
            0.5,
            [*motor, *motor_scooter_rider(), block((-0.36, 0.05), 0.22, (0.80, 1.24), DELIVERY)],
        ),
        _model("kick_scooter_parked", label, 2.0, kick, stands=True),
        _model("motor_scooter_parked", label, 1.0, [*motor, _stem(1.06, 0.94, 1.01)], stands=True),
    ]


def _model(name: str, label: ObjectClass, share: float, parts: list[Part], *, stands: bool = False) -> Model:
    return replace(assemble(name, label, [parts]), share=share, stands=stands)


def _cycling(name: str, share: float, machine: list[Part], riders: list[list[Part]], scale: float = 1.0) -> Model:
    poses = [[*machine, *rider] for rider in riders]
    return replace(assemble(name, ObjectClass.BICYCLE, poses, cycle_m=DEVELOPMENT_M * scale), share=share)


def _scaled(model: Model, name: str, size_m: tuple[float, float, float], share: float) -> Model:
    factor = np.array(size_m) / model.size_m
    vertices, poses = model.vertices * factor, model.poses * factor
    return replace(model, name=name, size_m=np.array(size_m), vertices=vertices, poses=poses, share=share)


def _passenger(height: float, hips: list[float], hands: list[float], feet: list[float], lean_rad: float) -> list[Part]:
    """Build a passenger with a helmet, whose hands hold the rider's waist."""
    look = Look(top=ACCENT, bottom=JEANS, hair=(150, 152, 158), helmet=True)
    return dressed(seated(height, hips, lean_rad, hands + 0.17 * PAIR, feet + 0.2 * PAIR), height, look)


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
