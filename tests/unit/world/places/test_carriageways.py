"""Lanes side by side make one carriageway, from junction to junction."""

import numpy as np
import pytest

from coopsim.world.custom.groundworks import carriageways
from coopsim.world.places.road_network import CircularLane, RoadNetwork, StraightLane


def both_ways(length_m: float = 100.0) -> RoadNetwork:
    """Make a street along x with a lane each way, the way back in two pieces."""
    network = RoadNetwork()
    network.add_lane("a", "b", StraightLane([0, -2], [length_m, -2]))
    network.add_lane("c", "d", StraightLane([length_m, 2], [40, 2]))
    network.add_lane("d", "e", StraightLane([40, 2], [0, 2]))
    return network


def test_two_lanes_are_one_carriageway() -> None:
    (road,) = carriageways(both_ways(), ())
    assert road.half_m == pytest.approx(4.0)
    np.testing.assert_allclose(road.line[:, 1], 0.0, atol=1e-9)
    assert np.ptp(road.line[:, 0]) == pytest.approx(100.0)


def test_a_median_parts_carriageways_and_flat_roads_are_left_out() -> None:
    network = both_ways()
    network.add_lane("f", "g", StraightLane([0, -7], [60, -7]))
    assert sorted(road.half_m for road in carriageways(network, ())) == [2.0, 4.0]
    assert [road.half_m for road in carriageways(network, [("a", "b"), ("c", "d"), ("d", "e")])] == [2.0]
    assert carriageways(RoadNetwork(), ()) == []


def test_however_many_streets_there_are_each_is_a_carriageway() -> None:
    network = RoadNetwork()
    for k in range(50):
        network.add_lane(f"a{k}", f"b{k}", StraightLane([0, 40 * k], [100, 40 * k]))
    assert len(carriageways(network, ())) == 50


def test_where_a_lane_joins_another_carriageway_begins() -> None:
    network = both_ways()
    network.add_lane("f", "g", StraightLane([50, -6], [100, -6]))
    narrow, wide = sorted(carriageways(network, ()), key=lambda road: road.half_m)
    assert (narrow.half_m, wide.half_m) == pytest.approx((4.0, 6.0))
    assert 45 < narrow.line[:, 0].max() <= 50 <= wide.line[:, 0].min() < 55
    np.testing.assert_allclose(wide.line[:, 1], -2.0, atol=1e-9)


def test_bends_are_followed_and_forks_go_straight_on() -> None:
    network = RoadNetwork()
    network.add_lane("a", "b", StraightLane([0, 0], [30, 0]))
    network.add_lane("c", "d", StraightLane([50, 20], [50, 60]))  # not in the order in which one drives
    network.add_lane("b", "c", CircularLane([30, 20], 20, -np.pi / 2, 0.0))
    (bent,) = carriageways(network, ())
    np.testing.assert_allclose(bent.line[[0, -1]], [[0, 0], [50, 60]], atol=1e-9)
    network.add_lane("g", "h", StraightLane([54, 40], [54, 30]))
    before, after = carriageways(network, [("g", "h")])
    assert before.line[-1] == pytest.approx([50, 28], abs=2.1)
    assert after.line[0] == pytest.approx([50, 42], abs=2.1)
    network.add_lane("b", "f", StraightLane([30, 0], [90, 0]))
    assert sorted(road.line[-1].tolist() for road in carriageways(network, [("g", "h")]))[-1] == pytest.approx([90, 0])


def test_a_bend_keeps_its_distance() -> None:
    network = RoadNetwork()
    network.add_lane("a", "b", CircularLane([0, 0], 32.0, 0.0, np.pi / 2))
    network.add_lane("c", "d", CircularLane([0, 0], 28.0, np.pi / 2, 0.0))
    (road,) = carriageways(network, ())
    np.testing.assert_allclose(np.linalg.norm(road.line, axis=1), 30.0, atol=0.03)
    assert road.half_m == pytest.approx(4.0, abs=0.02)


def test_there_is_none_beside_flat_roads_nor_in_forks() -> None:
    network = both_ways()
    network.add_lane("f", "g", StraightLane([60, -6], [80, -6]))
    for road in carriageways(network, [("f", "g")]):
        assert road.line[:, 0].max() <= 60 or road.line[:, 0].min() >= 80
    network = both_ways()
    network.add_lane("a", "h", StraightLane([0, -2], [100, -30]))
    forked = [road for road in carriageways(network, ()) if road.half_m > 2.5]
    assert 8 < min(road.line[:, 0].min() for road in forked) < 20
