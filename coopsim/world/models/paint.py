"""Paint of vehicles and clothes of people, drawn for each actor by its id.

An actor's colours depend on the seed, its id and its class alone, and on no other actor.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from coopsim.geometry.se3 import Floats
from coopsim.support.rng import uniform_numbers
from coopsim.types import Ints
from coopsim.types.taxonomy import ObjectClass

RGB = tuple[int, int, int]

Colors = NDArray[np.uint8]

PAINTS: dict[RGB, float] = {
    (230, 231, 228): 35,
    (22, 23, 26): 19,
    (92, 95, 100): 19,
    (174, 177, 182): 9,
    (30, 62, 132): 8,
    (158, 24, 30): 5,
    (112, 90, 68): 3,
    (214, 172, 44): 1,
    (34, 84, 58): 1,
}
"""Paints of new cars in per cent: white, black, grey, silver, blue, red, brown or beige, yellow or gold, green; from
Axalta's Global Automotive Color Popularity Report 2021. The shades are ours."""

LIVERIES: dict[RGB, float] = {
    (240, 240, 238): 40,
    (206, 34, 36): 12,
    (28, 84, 164): 12,
    (240, 190, 30): 10,
    (30, 120, 76): 9,
    (236, 124, 32): 7,
    (96, 100, 106): 10,
}
"""Liveries of vans, trucks and buses in per cent. Ours: white, and usual colours of firms."""

CLOTHES: dict[RGB, float] = {
    (34, 36, 42): 22,
    (44, 58, 92): 18,
    (120, 122, 124): 12,
    (222, 220, 212): 12,
    (150, 40, 46): 8,
    (66, 92, 62): 7,
    (186, 152, 104): 7,
    (96, 132, 180): 7,
    (216, 170, 46): 4,
    (188, 96, 132): 3,
}
"""Clothes in per cent. Ours: mostly dark and plain."""


@dataclass(frozen=True, slots=True)
class _Wardrobe:
    """The colours of a class: first and second ones with their weights, and how often the second equals the first."""

    color: dict[RGB, float]
    accent: dict[RGB, float]
    plain: float


_CARS = _Wardrobe(PAINTS, {(22, 23, 26): 70, (230, 231, 228): 30}, 0.85)
_GOODS = _Wardrobe(LIVERIES, LIVERIES, 0.4)
_MACHINES = _Wardrobe(dict.fromkeys(PAINTS, 1.0), CLOTHES, 0.0)
_PEOPLE = _Wardrobe(CLOTHES, CLOTHES, 0.0)

_WARDROBES = {
    ObjectClass.CAR: _CARS,
    ObjectClass.VAN: _GOODS,
    ObjectClass.TRUCK: _GOODS,
    ObjectClass.BUS: _GOODS,
    ObjectClass.MOTORCYCLE: _MACHINES,
    ObjectClass.BICYCLE: _PEOPLE,
    ObjectClass.SCOOTER: _PEOPLE,
    ObjectClass.PEDESTRIAN: _PEOPLE,
    ObjectClass.CHILD: _PEOPLE,
}

_DARKER, _LIGHTER, _FADED = 0.10, 0.05, 12.0
"""Shades of one paint differ: each is darker or lighter by up to these shares, a quarter as much in each channel, and
has up to so much white in it (of 255), because black has little to darken."""


DUST: RGB = (112, 98, 78)
_DIRTIEST, _CLEAN = 0.45, 0.5
"""A share of the vehicles is clean; on the others lies a film of dust, which hides up to so much of the paint, evenly
spread. Assumed by us."""


def draw_colors(seed: int, ids: Ints, label: Ints, *, dirty: bool = False) -> tuple[Colors, Colors]:
    """Return the first and second colours, each (N, 3), of actors with ids (N,) and classes (N,).

    `dirty`: there is dust on vehicles. It also sets what the LiDAR sees of them, by the colour: black paint, which
    returns least (see `coopsim.sensors.scene.paint_reflectivity`), returns more under dust, and colours and white
    hardly change. Models have their own dust below the belt, with a lower reflectivity.
    """
    draw = uniform_numbers(seed, "appearance", ids, 13)
    color, accent = (np.zeros((len(ids), 3)) for _ in range(2))
    for cls, wardrobe in _WARDROBES.items():
        of = np.flatnonzero(label == cls)
        if len(of):
            color[of] = _pick(wardrobe.color, draw[of, 0])
            accent[of] = _pick(wardrobe.accent, draw[of, 1])
    plain = np.array([_WARDROBES[cls].plain for cls in ObjectClass])[label]
    color, accent = _shaded(color, draw[:, 2:7]), _shaded(accent, draw[:, 7:12])
    if dirty:
        film = _film(seed, ids, label)
        color, accent = (film * DUST + (1 - film) * each for each in (color, accent))
    same = draw[:, 12:] < plain[:, None]
    return color.astype(np.uint8), np.where(same, color, accent).astype(np.uint8)


def _pick(colors: dict[RGB, float], draw: Floats) -> Floats:
    """Return weighted choices (N, 3) of the colours for uniform draws (N,)."""
    limits = np.cumsum(list(colors.values()))
    chosen: Floats = np.array(list(colors), dtype=np.float64)[np.searchsorted(limits, draw * limits[-1], side="right")]
    return chosen


def _film(seed: int, ids: Ints, label: Ints) -> Floats:
    """Return the share (N, 1) of the paint that dust hides: none of people and two-wheelers."""
    draw = uniform_numbers(seed, "dust", ids, 1)
    vehicle = np.isin(label, (ObjectClass.CAR, ObjectClass.VAN, ObjectClass.TRUCK, ObjectClass.BUS))[:, None]
    film: Floats = _DIRTIEST * np.where(vehicle, np.maximum(draw - _CLEAN, 0.0) / (1.0 - _CLEAN), 0.0)
    return film


def _shaded(color: Floats, draw: Floats) -> Floats:
    """Return colours (N, 3), each lighter or darker and a little off its hue, by uniform draws (N, 5)."""
    off = draw[:, :4] * (_DARKER + _LIGHTER) - _DARKER
    shaded: Floats = color * (1 + off[:, :1] + off[:, 1:] / 4) + _FADED * draw[:, 4:]
    return np.minimum(shaded, 255.0)
