"""Compositions in the making: what would stand in something else is left out."""

from __future__ import annotations

import numpy as np
import pytest

from coopsim.support.rng import stream
from coopsim.world.furniture.kinds import KINDS
from coopsim.world.surroundings.cast import make_cast
from coopsim.world.surroundings.compositions import AT_KERBS, AT_WALLS, BEHIND_WAYS, Composition
from coopsim.world.surroundings.draft import IN, OUT, Draft


def make_draft(seed: int = 0) -> Draft:
    return Draft(stream(seed, "test"), make_cast())


def test_who_would_stand_in_another_is_left_out() -> None:
    draft = make_draft()
    draft.person(0.0, 1.0, OUT)
    draft.person(0.1, 1.1, IN)
    draft.vehicle(0.3, 1.0, OUT)
    assert len(draft.items) == 1
    draft.person(3.0, 1.0, IN)
    assert len(draft.items) == 2


def test_people_sit_on_benches_but_not_in_each_other() -> None:
    draft = make_draft()
    draft.piece("bench", 0.0, 0.7)
    draft.person(0.0, 0.7, IN)
    assert len(draft.items) == 1
    draft.sitter(0.0, 0.75, IN)
    draft.sitter(0.1, 0.75, IN)
    assert [item.on_seat for item in draft.items] == [False, True]


def test_people_may_stand_under_a_crown_but_not_in_the_stem() -> None:
    draft = make_draft()
    draft.tree(0.0, 1.0, (2.0, 2.0), (5.0, 5.0))
    draft.person(0.0, 1.1, IN)
    assert len(draft.items) == 1
    draft.person(1.0, 1.2, IN)
    assert len(draft.items) == 2


@pytest.mark.parametrize("turn", [0.0, 0.7, np.pi / 2])
def test_discs_cover_what_stands_there(turn: float) -> None:
    draft = make_draft()
    draft.vehicle(2.0, 3.0, turn)
    length, width = draft.items[0].size_m
    u, v = np.meshgrid(np.linspace(-0.5, 0.5, 9) * length, np.linspace(-0.5, 0.5, 9) * width)
    x, y = u * np.cos(turn) - v * np.sin(turn) + 2.0, u * np.sin(turn) + v * np.cos(turn) + 3.0
    away = np.hypot(x[..., None] - draft.discs[:, 0], y[..., None] - draft.discs[:, 1])
    assert (away <= draft.discs[:, 2] + 1e-9).any(axis=-1).all()


@pytest.mark.parametrize(
    "compose", [compose for zone in (AT_KERBS, AT_WALLS, BEHIND_WAYS) for compose, _ in zone], ids=lambda c: c.__name__
)
def test_every_composition_shows_somebody_or_something_labelled_now_and_then(compose: Composition) -> None:
    labelled, kinds = 0, set()
    for seed in range(12):
        draft = make_draft(seed)
        compose(draft)
        labelled += sum(item.model is not None for item in draft.items)
        kinds |= {item.kind for item in draft.items if item.model is None}
        for item in draft.items:
            assert set(item.sizes) <= set(KINDS[item.kind].sizes if item.model is None else ())
            for name, value in item.sizes.items():
                size = KINDS[item.kind].sizes[name]
                assert size.least <= value <= size.most, (item.kind, name, value)
    assert labelled >= 5 and kinds <= set(KINDS)
