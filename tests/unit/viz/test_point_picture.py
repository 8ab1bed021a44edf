import numpy as np

from coopsim.viz import palette
from coopsim.viz.point_picture import draw_points


def test_point_ahead_is_above_the_middle_and_actors_have_their_colour():
    points = np.array([[10.0, 0.0, 0.0], [0.0, 10.0, 0.0], [500.0, 0.0, 0.0]])
    picture = draw_points(points, np.array([7, 0, 0]), 20.0, (80, 80))
    rows, columns = np.nonzero((picture == palette.track_color(7)).all(axis=2))
    assert columns.tolist() == [40, 41, 40, 41]
    assert rows.max() < 40
    scenery = (picture != palette.BACKGROUND).any(axis=2)
    scenery[rows, columns] = False
    assert np.argwhere(scenery).tolist() == [[40, 20]]


def test_nearer_points_are_painted_over_farther_ones():
    points = np.array([[2.0, 0.0, 0.0], [0.0, 0.0, 2.0 * np.tan(np.radians(40.0))]])  # in one line of sight
    picture = draw_points(points, np.array([1, 2]), 20.0, (80, 80))
    assert (picture == palette.track_color(2)).all(axis=2).any()
    assert not (picture == palette.track_color(1)).all(axis=2).any()
