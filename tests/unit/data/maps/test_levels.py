"""Which lanes and ways of a map cross in height."""

from __future__ import annotations

import numpy as np

from coopsim.data.maps.levels import crossings_in_height
from coopsim.data.maps.street_map import LaneKind, StreetLane, StreetMap, StreetWay


def lane(name: str, *points: tuple[float, float, float], kind: LaneKind = "drive") -> StreetLane:
    return StreetLane(name, name, kind, np.array(points), np.full(len(points), 3.5))


def way(name: str, *points: tuple[float, float, float]) -> StreetWay:
    return StreetWay(name, "", "", "j", np.array(points), np.full(len(points), 3.5), None, "straight")


def street_map(*lanes: StreetLane, ways: tuple[StreetWay, ...] = ()) -> StreetMap:
    by_id = {each.id: each for each in ways}
    return StreetMap(
        source="", format="", lanes={each.id: each for each in lanes}, links={}, ways=by_id, junctions={}
    )


def test_a_bridge_crosses_what_is_far_below_it_and_nothing_else() -> None:
    below = lane("below", (-50, 0, 0), (50, 0, 1))
    bridge = way("bridge", (10, -40, 2), (10, -20, 5), (10, 20, 5), (10, 40, 2))
    low = lane("low", (-30, -40, 2.5), (-30, 40, 2.5))  # 2.3 m higher: a ramp, as it were
    beside = lane("beside", (60, -40, 9), (60, 40, 9))  # high, and past the end
    path = lane("path", (20, -40, 9), (20, 40, 9), kind="walk")
    ((a, b, (x, y)),) = crossings_in_height(street_map(below, low, beside, path, ways=(bridge,)))
    assert (a, b) == ("below", "bridge")
    assert np.allclose((x, y), (10, 0))


def test_many_crossings_and_none() -> None:
    assert crossings_in_height(street_map()) == []
    low = [lane(f"low{k}", (-50, k, 0), (50, k, 0)) for k in range(10)]
    high = [lane(f"high{k}", (k, -50, 6), (k, 50, 6)) for k in range(10)]
    assert len(crossings_in_height(street_map(*low, *high))) == 100
