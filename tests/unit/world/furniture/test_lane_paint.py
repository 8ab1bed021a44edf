"""Painted lines between lanes."""

from __future__ import annotations

from coopsim.geometry.se3 import Floats
from coopsim.world.furniture.lane_paint import lane_paint
from coopsim.world.places.junctions import make_crossing
from coopsim.world.places.layout import Layout
from coopsim.world.towns.drawn_place import draw_place


def _middles(layout: Layout) -> Floats:
    (part,) = lane_paint(layout)
    middles: Floats = part.vertices[part.faces].mean(axis=1)
    return middles


def test_lines_lie_just_above_a_flat_road() -> None:
    layout = make_crossing()
    middles = _middles(layout)
    assert len(middles) == 2 * len(layout.road_map.markings)
    assert ((middles[:, 2] > 0.0) & (middles[:, 2] < 0.03)).all()


def test_lines_lie_on_a_crowned_road_so_that_they_are_seen() -> None:
    layout = draw_place(1).make_layout()
    assert layout.relief is not None
    middles = _middles(layout)
    over_m = middles[:, 2] - layout.relief.heights(middles[:, :2])
    assert over_m.max() < 0.013
    seen = over_m > 0.0
    # The flat copies below the crown are hidden by it; every dash has a piece above it.
    assert seen.sum() >= len(layout.road_map.markings)
    assert (middles[seen, 2] > 0.02).any()
