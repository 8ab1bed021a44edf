"""The drawing from above that renders and clips share."""

from __future__ import annotations

import numpy as np
import pytest

from coopsim.viz import palette
from coopsim.viz.from_above import FromAbove, box_of, outlines
from coopsim.world.snapshot import RoadMap

SQUARE = np.array([[-4.0, -4.0], [4.0, -4.0], [4.0, 4.0], [-4.0, 4.0]])


def drawing(road_map: RoadMap, fine: int = 1) -> FromAbove:
    return FromAbove(road_map, (0.0, 0.0), 10.0, (100, 100), fine)


@pytest.mark.parametrize("fine", [1, 2])
def test_a_point_has_its_whole_colour_however_fine_the_drawing(fine: int) -> None:
    above = drawing(RoadMap((), (), (), ()), fine)
    above.begin()
    above.points(np.array([[1.05, 2.05], [90.0, 0.0]]))
    picture = np.asarray(above.done())
    (row, column) = np.argwhere((picture != palette.BACKGROUND).any(axis=-1))[0]
    assert (column, row) == (60, 29) and tuple(picture[row, column]) == palette.POINT


def test_each_frame_begins_on_the_bare_ground() -> None:
    above = drawing(RoadMap((SQUARE,), (), (), ()))
    above.begin()
    bare = np.asarray(above.done()).copy()
    above.box(outlines(box_of(np.array([0.0, 0.0, 4.0, 2.0, 0.3])))[0], palette.TRACK, 2)
    assert not np.array_equal(above.done(), bare)
    above.begin()
    np.testing.assert_array_equal(above.done(), bare)


def test_pavements_have_kerbs_which_roads_cover_and_none_where_two_meet() -> None:
    half = SQUARE * [0.5, 1.0]
    above = drawing(RoadMap((), (), (half - np.array([2.0, 0.0]), half + np.array([2.0, 0.0])), ()))
    above.begin()
    picture = np.asarray(above.done())
    assert tuple(picture[50, 9]) == palette.KERB and (picture[50, 11:89] == palette.MAP["pavements"]).all()
    above = drawing(RoadMap((1.1 * SQUARE,), (), (SQUARE,), ()))
    above.begin()
    assert not (np.asarray(above.done()) == palette.KERB).all(axis=-1).any()


def test_trees_are_muted_and_cover_roads() -> None:
    above = drawing(RoadMap((SQUARE,), (), (), (), trees=(0.5 * SQUARE,)))
    above.begin()
    picture = np.asarray(above.done())
    tree, road = tuple(picture[50, 50].tolist()), tuple(picture[50, 15].tolist())
    assert (tree, road) == (palette.MAP["trees"], palette.MAP["lanes"])
    assert 10 < sum(abs(a - b) for a, b in zip(tree, road, strict=True)) < 60, "they are told apart, and not loud"


def test_a_ring_is_as_wide_as_asked_for() -> None:
    above, drawn = drawing(RoadMap((), (), (), ())), []
    for width in (1, 3):
        above.begin()
        above.ring(np.zeros(2), palette.CONNECTED, 20, width)
        drawn.append(int((np.asarray(above.done()) == palette.CONNECTED).all(axis=-1).sum()))
    assert 2.5 * drawn[0] < drawn[1] < 3.5 * drawn[0]
