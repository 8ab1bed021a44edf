"""Adults and children of more sizes and looks, and with things: bags, umbrellas, pushchairs, dogs, wheelchairs.

Adults are 1.50 to 1.95 m tall, children 0.92 to 1.50 m (see `coopsim.world.models.pedestrians` for means). A person and
what the person pushes or leads are one object, as in data sets, which label a pushchair with its pusher or apart from
it. How many carry what is assumed by us: about one adult in five carries or pushes something, one in a hundred uses a
wheelchair.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from coopsim.types.taxonomy import ObjectClass
from coopsim.world.models.belongings import (
    Belonging,
    beam,
    carton,
    dog,
    nothing,
    phone,
    pushchair,
    shopping_bags,
    suitcase,
    umbrella,
    walking_frame,
)
from coopsim.world.models.figure import Look, dressed, on_the_ground, seated
from coopsim.world.models.model import Model
from coopsim.world.models.parts import METAL, PLASTIC, RGB, Part, Surface, assemble, block, wheel
from coopsim.world.models.pedestrians import ADULTS, CHILDREN, POSES, cycle_of, make_adults, make_children, walking

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

_CARRIERS: tuple[tuple[str, float, Belonging, float, Look], ...] = (  # name, height (m), belonging, share, look
    ("man_phone", 1.79, phone, 0.8, Look(girth=1.05, skin=_FAIR, hair=_BLOND)),
    ("woman_shopping", 1.65, shopping_bags, 0.8, Look(girth=0.98, skin=_OLIVE, hair=_CHESTNUT)),
    ("man_shopping", 1.80, shopping_bags, 0.5, Look(girth=1.1, skin=_BROWN, hair=_BLACK)),
    ("man_suitcase", 1.82, suitcase, 0.5, Look(skin=_FAIR, hair=_CHESTNUT)),
    ("woman_suitcase", 1.67, suitcase, 0.4, Look(girth=0.95, skin=_DARK, hair=_BLACK, coat=True)),
    ("woman_umbrella", 1.66, umbrella, 0.4, Look(girth=0.95, skin=_FAIR, hair=_BLOND, coat=True)),
    ("man_umbrella", 1.78, umbrella, 0.4, Look(girth=1.05, skin=_OLIVE, hair=_BLACK)),
    ("woman_pushchair", 1.66, pushchair, 0.4, Look(girth=0.98, skin=_FAIR, hair=_CHESTNUT)),
    ("man_pushchair", 1.81, pushchair, 0.3, Look(girth=1.05, skin=_BROWN, hair=_BLACK)),
    ("woman_walking_frame", 1.55, walking_frame, 0.3, Look(girth=1.08, skin=_FAIR, hair=_GREY)),
    ("man_dog", 1.77, dog, 0.4, Look(skin=_OLIVE, hair=_GREY)),
    ("man_carton", 1.78, carton, 0.3, Look(bare_forearms=True, skin=_BROWN, hair=_BLACK)),
    ("worker", 1.80, nothing, 0.5, Look(girth=1.1, skin=_OLIVE, top=VEST, band=BAND, hair=(236, 190, 40))),
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
    factor, look = size / model.size_m, (ADULTS | CHILDREN)[base][1]
    color = np.array(model.color)
    for old, new in ((look.skin, skin), (look.hair, hair)):
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


def _carrier(name: str, height: float, belonging: Belonging, share: float, look: Look) -> Model:
    poses = []
    for k in range(POSES):
        joints, things = belonging(on_the_ground(walking(height, k / POSES), height), height)
        poses.append([*dressed(joints, height, look), *things])
    return replace(assemble(name, ObjectClass.PEDESTRIAN, poses, cycle_m=cycle_of(height)), share=share)


def _in_wheelchair() -> Model:
    """Build a man who turns the wheels of his wheelchair; nuScenes' are 1.09 x 0.77 x 1.37 m."""
    height, aside = 1.76, np.array([1.0, -1.0])[:, None] * [0.0, 1.0, 0.0]
    hands = np.array([0.12, 0.0, 0.60]) + 0.28 * aside
    feet = np.array([0.52, 0.0, 0.22]) + 0.10 * aside
    rider = dressed(seated(height, [0.0, 0.0, 0.56], -0.08, hands, feet), height, Look(skin=_FAIR, hair=_CHESTNUT))
    chair: list[Part] = [
        *(wheel(0.0, side * 0.33, 0.30, 0.03, sides=10) for side in (1, -1)),
        *(wheel(0.46, side * 0.25, 0.08, 0.03, sides=6) for side in (1, -1)),
        block((-0.14, 0.36), 0.22, (0.44, 0.50), PLASTIC),
        block((-0.20, -0.15), 0.22, (0.44, 0.92), PLASTIC),
        block((0.44, 0.72), 0.18, (0.10, 0.13), METAL),
        *(beam([0.34, side * 0.20, 0.45], [0.52, side * 0.20, 0.12], 0.015, 0.015, METAL) for side in (1, -1)),
    ]
    return replace(assemble("wheelchair_user", ObjectClass.PEDESTRIAN, [[*chair, *rider]]), share=0.25)
