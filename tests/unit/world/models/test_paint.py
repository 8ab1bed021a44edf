"""Paint and clothes: as often as their sources say, an actor's own, and of its id alone."""

import numpy as np
import pytest

from coopsim.types.taxonomy import ObjectClass
from coopsim.world.models.paint import CLOTHES, DUST, LIVERIES, PAINTS, draw_colors

CARS = np.zeros(20_000, dtype=np.int64)
IDS = np.arange(1, len(CARS) + 1)


def test_paints_are_as_frequent_as_the_survey_says() -> None:
    color, _ = draw_colors(3, IDS, CARS)
    paints = np.array(list(PAINTS), dtype=float)
    nearest = np.linalg.norm(color[:, None] - paints, axis=2).argmin(axis=1)
    share = 100 * np.bincount(nearest, minlength=len(paints)) / len(IDS)
    np.testing.assert_allclose(share, list(PAINTS.values()), atol=1.0)


@pytest.mark.parametrize("weights", [PAINTS, LIVERIES, CLOTHES])
def test_shares_are_per_cent(weights: dict[tuple[int, int, int], float]) -> None:
    assert sum(weights.values()) == 100


def test_two_cars_can_be_told_apart() -> None:
    color, accent = draw_colors(0, IDS, CARS)
    crowds = np.column_stack([color, accent]).reshape(-1, 50, 6)
    alike = [50 - len(np.unique(crowd, axis=0)) for crowd in crowds]
    assert np.mean(alike) < 1  # 0.84 were measured, most of them black
    assert (color != accent).any(axis=1).mean() == pytest.approx(0.15, abs=0.01)


@pytest.mark.parametrize("cls", ObjectClass)
def test_every_class_has_colours_of_which_none_dominates(cls: ObjectClass) -> None:
    color, accent = draw_colors(1, IDS[:2000], np.full(2000, int(cls)))
    assert color.dtype == accent.dtype == np.uint8
    assert len(np.unique(color, axis=0)) > 500
    assert len(np.unique(accent, axis=0)) > 500


def test_colours_are_of_the_id_and_seed_alone() -> None:
    label = IDS[:40] % len(ObjectClass)
    everybody = np.column_stack(draw_colors(7, IDS[:40], label))
    some = np.array([31, 4, 17])
    np.testing.assert_array_equal(np.column_stack(draw_colors(7, IDS[some], label[some])), everybody[some])
    assert (np.column_stack(draw_colors(8, IDS[:40], label)) != everybody).any(axis=1).mean() > 0.9


def test_nobody_wears_nothing() -> None:
    color, accent = draw_colors(0, np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64))
    assert color.shape == accent.shape == (0, 3)


def test_half_of_the_vehicles_are_dusty_and_nobody_else_is() -> None:
    """Dust moves a colour towards its own by up to the stated share."""
    for cls in ObjectClass:
        label = np.full(len(IDS), int(cls))
        clean, dirty = (draw_colors(3, IDS, label, dirty=dirty)[0].astype(float) for dirty in (False, True))
        far = np.abs(clean - DUST).max(axis=1) > 60
        film = (1 - np.linalg.norm(dirty - DUST, axis=1) / np.linalg.norm(clean - DUST, axis=1))[far]
        if cls <= ObjectClass.BUS:
            assert 0.45 < (film > 0.02).mean() < 0.55
            assert 0.40 < film.max() < 0.48 and film.min() > -0.02
        else:
            np.testing.assert_array_equal(dirty, clean)
