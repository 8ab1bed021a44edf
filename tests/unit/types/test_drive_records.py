"""Places along a route: the same numbers as by its tangents, to the bit."""

from __future__ import annotations

import numpy as np
import pytest

from coopsim.types.driving import Route


def bent(count: int, seed: int) -> Route:
    """Return a route of points that wind at random."""
    heading = np.cumsum(np.random.default_rng(seed).normal(0.0, 0.1, count))
    points = np.cumsum(np.column_stack([np.cos(heading), np.sin(heading)]), axis=0)
    return Route(points - points[0], 1.0, np.full(count, 10.0), np.zeros(count, int))


@pytest.mark.parametrize("count", [2, 3, 101])
def test_places_are_those_by_the_tangent_at_the_nearest_point(count: int) -> None:
    route = bent(count, seed=count)
    points = np.random.default_rng(1).normal(0.0, count, (200, 2))
    along, aside, nearest = route.place(points)
    apart = np.square(points[:, None] - route.points).sum(axis=2)
    np.testing.assert_array_equal(nearest, apart.argmin(axis=1))
    tangent, offset = route.tangents[nearest], points - route.points[nearest]
    np.testing.assert_array_equal(along, nearest * 1.0 + (offset[:, 0] * tangent[:, 0] + offset[:, 1] * tangent[:, 1]))
    np.testing.assert_array_equal(aside, tangent[:, 0] * offset[:, 1] - tangent[:, 1] * offset[:, 0])
    assert {0, count - 1} <= set(nearest.tolist())  # before the first and beyond the last, too
