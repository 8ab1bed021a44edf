"""`cautious` slows before what neither it nor another agent sees, and never by the truth of others."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from steered_drive import Other, drive

from coopsim.planning.cautious import Cautious
from coopsim.planning.hidden import hidden, sides
from coopsim.planning.route_follower import RouteFollower

PARKED = [Other(float(x), -2.9) for x in range(20, 110, 6)]
HOUSE = [[20.0, -5.0, 38.0, -5.0], [38.0, -5.0, 38.0, -30.0]]
ENTRIES = [[42.0, -5.0 - back, 13.9, 8.0 + back, 38.0] for back in range(0, 40, 4)]


def slowest(planner: Any, others: list[Other] = (), until_m: float = 45.0, **occlusions: Any) -> float:  # type: ignore[assignment]
    driven = drive(planner, others, seconds=10.0, **occlusions)
    return min(speed for speed, x in zip(driven.speed, driven.x, strict=True) if x < until_m)


def test_it_slows_beside_parked_cars_unless_somebody_looks_behind_them() -> None:
    assert slowest(RouteFollower(), PARKED) > 9.5
    alone = slowest(Cautious(), PARKED, 80.0)
    assert 3.5 < alone < 7.5
    assert slowest(Cautious(), PARKED, 80.0, eyes=[[float(x), -8.0] for x in range(15, 120, 5)]) > alone + 1.5


def test_it_feels_its_way_into_a_junction_that_a_house_hides_unless_somebody_sees_it() -> None:
    given = {"walls": HOUSE, "entries": ENTRIES, "until_m": 38.0}
    assert slowest(RouteFollower(), **given) > 9.5
    assert slowest(Cautious(), **given) < 6.0
    assert slowest(Cautious(), **given, eyes=[[42.0, 5.0]]) > 9.0


def test_it_drives_as_the_route_follower_where_all_is_open() -> None:
    others = [Other(60.0, 0.0, 5.0)]
    one, other = (drive(planner, others) for planner in (Cautious(), RouteFollower()))
    assert one.speed == other.speed and one.y == other.y


@pytest.mark.parametrize(
    ("place", "eyes", "sees_m", "is_hidden"),
    [
        ((20.0, 0.0), [[0.0, 0.0]], 50.0, True),  # behind the body
        ((20.0, 9.0), [[0.0, 0.0]], 50.0, False),  # beside it
        ((20.0, 0.0), [[0.0, 0.0], [30.0, 0.0]], 50.0, False),  # seen by another
        ((20.0, 9.0), [[0.0, 0.0]], 10.0, True),  # too far
        ((10.0, 0.0), [[0.0, 0.0]], 50.0, False),  # within the body, where nobody can be
    ],
)
def test_places_are_hidden_behind_bodies(place: Any, eyes: Any, sees_m: float, is_hidden: bool) -> None:
    box = np.array([[10.0, 0.0, 0.8, 4.5, 1.9, 1.6, 0.3]])
    found = hidden(np.array([place]), np.array(eyes), sides(box), box, sees_m)
    assert found.tolist() == [is_hidden]
