import numpy as np
import pytest
from shapely import Polygon

from coopsim.geometry.taken_ground import TakenGround
from coopsim.world.places.layout import rectangle
from coopsim.world.places.streetside import LOTS, Streetside
from coopsim.world.towns.lots import clip


def test_clip_keeps_what_is_beyond_the_line():
    half = clip(rectangle((0, 4), (0, 2)), np.array([1.0, 0.0]), np.array([1.0, 0.0]))
    assert Polygon(half).bounds == pytest.approx((1, 0, 4, 2))


def test_clip_cuts_a_corner():
    cut = clip(rectangle((0, 2), (0, 2)), np.array([1.0, 0.0]), np.array([1.0, 1.0]) / np.sqrt(2))
    assert Polygon(cut).area == pytest.approx(3.5)
    assert len(cut) == 5


def test_clip_of_what_is_before_the_line_is_nothing():
    assert len(clip(rectangle((0, 1), (0, 1)), np.array([3.0, 0.0]), np.array([1.0, 0.0]))) == 0


def test_lots_and_trees_stand_along_lines_with_points_far_apart():
    line = np.array([[0.0, 0.0], [400.0, 0.0], [400.0, -10.0]])
    ground = Streetside(1, (line + np.array([0.0, 4.0]),), (line,), (), TakenGround(), TakenGround())
    drawn = LOTS.get("town")(ground)
    corners = np.concatenate([building.outline for building in drawn["buildings"]])
    assert corners[:, 0].min() < 60 and corners[:, 0].max() > 340
