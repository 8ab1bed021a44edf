"""Lanes beside a way are found by where they lie, be they of one road or roads of their own."""

from __future__ import annotations

import numpy as np
import pytest

from coopsim.world.places.road_network import RoadNetwork, StraightLane
from coopsim.world.traffic.beside import lanes_beside
from coopsim.world.traffic.lanes import NumberedNetwork


def network(asides: list[float], *, turned: bool = False) -> NumberedNetwork:
    roads = RoadNetwork()
    for k, y in enumerate(asides):
        ends = ([0.0, y], [100.0, y]) if not (turned and k) else ([100.0, y], [0.0, y])
        roads.add_lane(f"{k} from", f"{k} to", StraightLane(*map(np.array, ends), 3.5))  # type: ignore[arg-type]
    return NumberedNetwork(roads)


POINTS = np.column_stack([np.arange(5.0, 95.0), np.zeros(90)])


@pytest.mark.parametrize(
    ("asides", "wanted"),
    [
        ([0.0], (0, 0)),
        ([0.0, 3.5], (1, 0)),
        ([0.0, -3.4, -7.1, 3.6], (1, 2)),
        ([0.0, 7.0], (0, 0)),  # with a strip between
        ([0.0, 0.9], (0, 0)),  # over each other
    ],
)
def test_lanes_side_by_side_are_counted(asides: list[float], wanted: tuple[int, int]) -> None:
    arrays = network(asides).arrays
    none = np.zeros(len(asides), np.bool_)
    found = lanes_beside(arrays, POINTS, np.zeros(90, np.int64), none)
    assert (found == wanted).all()
    assert not lanes_beside(arrays, POINTS, np.zeros(90, np.int64), ~none).any()  # over a junction


def test_lanes_that_lead_the_other_way_do_not_count() -> None:
    arrays = network([0.0, 3.5], turned=True).arrays
    assert not lanes_beside(arrays, POINTS, np.zeros(90, np.int64), np.zeros(2, np.bool_)).any()
