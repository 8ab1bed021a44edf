"""Tests of centre lines: they begin and end where they shall, and have no kinks."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from coopsim.world.towns.streets.plan import Station, Street, StreetEnd
from coopsim.world.towns.streets.street_lines import rounded


def test_a_rounded_line_meets_its_ends_without_kinks() -> None:
    points = np.array([[0.0, 0.0], [80.0, 10.0], [120.0, 90.0]])
    line = rounded(points, (20.0, 30.0), 1)
    assert line is not None and len(line) == 3
    for before, after in pairwise(line):
        end = np.array([before.length_m])
        np.testing.assert_allclose(before.position(end, np.zeros(1))[0], after.start, atol=1e-9)
        np.testing.assert_allclose(np.sin(before.heading(end)[0] - after.heading_rad), 0.0, atol=1e-9)
    last = line[-1]
    np.testing.assert_allclose(last.position(np.array([last.length_m]), np.zeros(1))[0], points[-1], atol=1e-9)
    assert line[0].length_m >= 20.0 and last.length_m >= 30.0


def test_a_line_without_room_for_its_bend_is_refused() -> None:
    points = np.array([[0.0, 0.0], [30.0, 0.0], [30.0, 30.0]])
    assert rounded(points, (10.0, 10.0), 1) is None


def test_places_beside_a_street_are_on_its_left_where_aside_is_positive() -> None:
    line = rounded(np.array([[0.0, 0.0], [60.0, 0.0], [60.0, 70.0]]), (5.0, 5.0), 1)
    assert line is not None
    ends, stations = (StreetEnd(None), StreetEnd(None)), (Station(0.0, 1), Station(100.0, 2))
    street = Street(0, line, *ends, stations, 10.0)
    np.testing.assert_allclose(street.position([1.0, 2.0], 3.0), [[1.0, 3.0], [2.0, 3.0]])
    np.testing.assert_allclose(street.position(street.length_m - 1.0, 3.0), [[57.0, 69.0]])
    np.testing.assert_allclose(street.half_m([0.0, 50.0, 100.0]), [4.175, 6.3, 8.425])
