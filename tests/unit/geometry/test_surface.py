"""Ground that outlines cover."""

from __future__ import annotations

import numpy as np

from coopsim.geometry.surface import Surface


def test_a_surface_covers_what_lies_in_any_of_its_outlines() -> None:
    corner = np.array([[0.0, 0.0], [4.0, 0.0], [4.0, 1.0], [1.0, 1.0], [1.0, 4.0], [0.0, 4.0]])
    surface = Surface([corner, corner + 10.0])
    points = np.array([[0.5, 3.0], [3.0, 0.5], [3.0, 3.0], [10.5, 13.0], [-1.0, 0.5]])
    assert surface.covers(points).tolist() == [True, True, False, True, False]
    assert not Surface([]).covers(points).any()
