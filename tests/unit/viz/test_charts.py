"""One style of charts: the same look for a policy everywhere, told apart by every eye; labels do not collide."""

from __future__ import annotations

from itertools import combinations
from typing import Any

import numpy as np
import pytest

from coopsim.geometry.se3 import Floats
from coopsim.viz.charts import COLORS, GREY, draw_series, label_ends, policy_styles, spread, to_svg

WHITE, DARK = "#ffffff", "#1d2126"
"""Backgrounds of charts: paper and bright pages, and the dark page."""

SIGHT: dict[str, list[list[float]]] = {
    "normal": [[1, 0, 0], [0, 1, 0], [0, 0, 1]],
    "deuteranopia": [[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413], [-0.01182, 0.04294, 0.968881]],
    "protanopia": [[0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216], [-0.003882, -0.048116, 1.051998]],
}
"""Linear RGB as an eye sees it (Machado, Oliveira and Fernandes 2009, severity 1)."""

TO_XYZ = np.array([[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]])


def linear(color: str) -> Floats:
    """Return linear RGB (3,) of a colour such as "#1e8bd6"."""
    values = np.array([int(color[k : k + 2], 16) for k in (1, 3, 5)]) / 255
    return np.where(values <= 0.04045, values / 12.92, ((values + 0.055) / 1.055) ** 2.4)


def lab(rgb: Floats) -> Floats:
    """Return CIELAB (3,) of linear RGB, D65."""
    x, y, z = TO_XYZ @ np.clip(rgb, 0, 1) / np.array([0.9505, 1.0, 1.089])
    f = [float(np.cbrt(each)) if each > 0.008856 else 7.787 * each + 16 / 116 for each in (x, y, z)]
    return np.array([116 * f[1] - 16, 500 * (f[0] - f[1]), 200 * (f[1] - f[2])])


def contrast(one: str, other: str) -> float:
    """Return the contrast of WCAG 2."""
    dark, bright = sorted(float(TO_XYZ[1] @ linear(each)) + 0.05 for each in (one, other))
    return bright / dark


@pytest.mark.parametrize("background", [WHITE, DARK])
def test_colors_stand_out_from_bright_and_dark_pages(background: str) -> None:
    assert min(contrast(each, background) for each in (GREY, *COLORS)) >= 3.0


@pytest.mark.parametrize("sight", SIGHT)
def test_colors_are_apart_for_the_color_blind(sight: str) -> None:
    seen = {each: lab(np.array(SIGHT[sight]) @ linear(each)) for each in (GREY, *COLORS)}
    assert min(np.linalg.norm(seen[a] - seen[b]) for a, b in combinations(seen, 2)) > 15, "2.3 is just noticeable"


def test_a_policy_has_the_same_look_in_every_company() -> None:
    alone, together = (
        policy_styles(["no_fusion", "late_fusion"]),
        policy_styles(["attfuse", "late_fusion", "mine", "no_fusion"]),
    )
    assert alone["late_fusion"] == together["late_fusion"] and alone["no_fusion"].color == GREY
    variant = "late_fusion(delayed=replay)"
    others = ["late_fusion(defense=oracle, delayed=replay)", "late_fusion(delayed=as_current)"]
    assert policy_styles([variant])[variant] == policy_styles([*others, variant])[variant]
    assert policy_styles(["late_fusion", variant])["late_fusion"] == alone["late_fusion"]


def test_looks_differ() -> None:
    names = ["no_fusion", "late_fusion", *(f"policy_{k}" for k in range(13))]
    assert len(set(policy_styles(names).values())) == len(names)
    assert GREY not in {each.color for name, each in policy_styles(names).items() if name != "no_fusion"}


@pytest.mark.parametrize("places", [[0.5, 0.5, 0.5], [0.0, 0.02, 1.0], [0.98, 1.0, 0.99], [0.1, 0.9]])
def test_labels_keep_apart_and_in_order(places: list[float]) -> None:
    found = spread(np.array(places), 0.1)
    order = np.argsort(places, kind="stable")
    assert np.diff(found[order]).min() >= 0.1 - 1e-12 and found.min() >= 0 and found.max() <= 1 + 1e-12


def test_places_with_room_stay() -> None:
    assert spread(np.array([0.9, 0.2, 0.5]), 0.1) == pytest.approx([0.9, 0.2, 0.5])


def chart(figure: Any) -> None:
    """Draw a series of three points with two intervals, and its name."""
    panel = figure.subplots()
    look = policy_styles(["late_fusion"])["late_fusion"]
    ends = np.array([[1.0, 3.0], [np.nan, np.nan], [2.0, 5.0]])
    draw_series(panel, np.arange(3.0), np.array([2.0, 3.0, 4.0]), ends, look)
    label_ends(panel, [("late_fusion", look, 2.0, 4.0)], 2.0)


def test_points_stand_in_front_of_their_intervals_and_names_beside_them() -> None:
    svg = to_svg(chart, 3.5, 2.6)
    bars, line = svg.index('id="LineCollection_1"'), svg.index(f"stroke: {COLORS[0]}; stroke-width: 1.3")
    assert bars < line and "late_fusion</text>" in svg
    assert svg == to_svg(chart, 3.5, 2.6), "the same numbers give the same bytes"


def test_names_stand_level_with_the_ends_of_lines_on_a_logarithmic_scale_too() -> None:
    places = []

    def draw(figure: Any) -> None:
        panel = figure.subplots()
        panel.set(yscale="log", ylim=(1, 10_000))
        look = policy_styles(["no_fusion"])["no_fusion"]
        label_ends(panel, [("low", look, 2.0, 10.0), ("high", look, 2.0, 1000.0)], 2.0)
        places.extend(each.xyann[1] for each in panel.texts)

    to_svg(draw, 3.5, 2.6)
    assert places == pytest.approx([0.25, 0.75])
