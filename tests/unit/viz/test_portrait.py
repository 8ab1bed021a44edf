"""Models are drawn whole, in their paint and pose."""

from __future__ import annotations

import numpy as np
import pytest

from coopsim.viz.portrait import contact_sheet, portrait
from coopsim.world.models import make_models

MODELS = {model.name: model for model in make_models()}
RED, BLUE = (220, 10, 10), (10, 10, 220)


@pytest.mark.parametrize("name", ["city_bus", "man", "hatchback"])
def test_a_model_is_drawn_whole_and_as_large_as_fits(name: str) -> None:
    image = portrait(MODELS[name], RED, BLUE, size_px=(96, 64)).astype(int)
    assert image.shape == (64, 96, 3)
    ground = np.median(image[:2].reshape(-1, 3), axis=0)
    drawn = np.abs(image - ground).max(axis=2) > 12
    assert not (drawn[[0, -1]].any() or drawn[:, [0, -1]].any())
    rows, columns = (np.flatnonzero(drawn.any(axis=axis)) for axis in (1, 0))
    assert max(np.ptp(rows) / 64, np.ptp(columns) / 96) > 0.75


def test_both_paints_show() -> None:
    image = portrait(MODELS["box_truck"], RED, BLUE, size_px=(96, 64)).astype(int)
    assert (image[..., 0] > 2 * image[..., 2] + 40).mean() > 0.03
    assert (image[..., 2] > 2 * image[..., 0] + 40).mean() > 0.03


def test_the_phase_shows_where_there_are_poses() -> None:
    for name, moves in (("man", True), ("hatchback", False)):
        still, later = (portrait(MODELS[name], RED, BLUE, phase=phase, size_px=(48, 48)) for phase in (0.0, 0.3))
        assert (still != later).any() == moves


def test_a_sheet_has_room_for_all() -> None:
    picture = np.zeros((20, 30, 3), dtype=np.uint8)
    sheet = contact_sheet([(f"model {k}", picture) for k in range(5)], columns=2)
    assert sheet.size == (60, 3 * (20 + 14))
    assert np.asarray(sheet)[-15, 40:].min() == 255  # the sixth place is empty
