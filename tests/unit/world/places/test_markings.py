"""Lines are where two lanes meet side by side, once, and not on junctions."""

import numpy as np
import pytest

from coopsim.world.places.road_network import RoadNetwork, StraightLane
from coopsim.world.places.scenery import lane_lines
from coopsim.world.scenario import make_scenario


def network(*lanes: tuple[str, str, list[float], list[float]]) -> RoadNetwork:
    roads = RoadNetwork()
    for start, end, first, last in lanes:
        roads.add_lane(start, end, StraightLane(np.array(first), np.array(last), width=4.0))
    return roads


EAST = ("a", "b", [0.0, -2.0], [60.0, -2.0])
WEST = ("c", "d", [60.0, 2.0], [0.0, 2.0])


@pytest.mark.parametrize("lanes", [(EAST, WEST), (WEST, EAST), (EAST, ("c", "d", [0.0, 2.0], [60.0, 2.0]))])
def test_one_line_between_two_lanes_whichever_way_they_go(
    lanes: tuple[tuple[str, str, list[float], list[float]], ...],
) -> None:
    dashes = np.array(lane_lines(network(*lanes)))
    assert len(dashes) == 8
    np.testing.assert_allclose(dashes.mean(axis=1)[:, 1], 0.0, atol=1e-9)
    np.testing.assert_allclose(np.ptp(dashes, axis=1), np.tile([3.0, 0.2], (8, 1)))
    x, y = dashes[..., 0], dashes[..., 1]
    assert ((x * np.roll(y, -1, axis=1) - y * np.roll(x, -1, axis=1)).sum(axis=1) > 0).all()  # counter-clockwise


def test_a_lane_alone_or_far_from_another_has_none() -> None:
    assert lane_lines(network(EAST)) == ()
    assert lane_lines(network(EAST, ("c", "d", [60.0, 4.0], [0.0, 4.0]))) == ()
    assert lane_lines(network(EAST, WEST), movements=[("c", "d")]) == ()
    assert lane_lines(RoadNetwork()) == ()


@pytest.mark.parametrize(("name", "least"), [("crossing", 40), ("urban_grid", 60), ("highway", 400), ("merge", 0)])
def test_lines_of_the_built_in_places_lie_on_their_roads(name: str, least: int) -> None:
    layout = make_scenario(name).layout
    assert len(layout.road_map.markings) >= least
    lanes = layout.network.lanes.values()
    for line in layout.road_map.markings[::40]:
        assert any(lane.contains(line.mean(axis=0), margin_m=0.5) for lane in lanes)


def test_nothing_is_painted_between_the_stop_lines_of_a_crossing() -> None:
    middles = np.array(make_scenario("crossing").layout.road_map.markings).mean(axis=1)
    assert np.abs(middles).max(axis=1).min() > 10.0
