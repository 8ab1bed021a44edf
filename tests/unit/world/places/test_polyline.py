"""A lane of many points: coordinates, headings, widths, outlines."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from curved_roads import arc

from coopsim.world.places.layout import lane_outline
from coopsim.world.places.polyline import PolylineLane
from coopsim.world.places.road_network import CircularLane, RoadNetwork, StraightLane
from coopsim.world.places.scenery import lane_lines
from coopsim.world.traffic.lane_geometry import heading_at, local_coordinates, position_at, radius_at
from coopsim.world.traffic.lanes import NumberedNetwork

BEND = PolylineLane([[0, 0], [20, 0], [32, 5], [40, 20], [40, 40]], 3.2)
RAMP = PolylineLane(np.vstack([[[-60.0, 0.0]], arc((0.0, 30.0), 30.0, -np.pi / 2, np.pi, 30), [[-30.0, 10.0]]]))


def test_coordinates_are_those_of_the_nearest_place_on_the_line() -> None:
    line, rng = shapely.LineString(BEND.points), np.random.default_rng(1)
    for place in rng.uniform((2.0, -3.0), (38.0, 38.0), (300, 2)):
        along, aside = BEND.local_coordinates(place)
        assert along == pytest.approx(line.project(shapely.Point(place)), abs=1e-9)
        assert abs(aside) == pytest.approx(line.distance(shapely.Point(place)), abs=1e-9)
        offset, heading = place - BEND.position(along, 0.0), BEND.heading_at(along)
        assert (offset[1] * np.cos(heading) - offset[0] * np.sin(heading)) * aside >= 0 or abs(aside) < 0.05
    assert BEND.local_coordinates(np.array([10.0, 1.0])) == (10.0, 1.0)


def test_ends_go_on_straight() -> None:
    assert BEND.local_coordinates(np.array([-4.0, -2.0])) == (-4.0, -2.0)
    along, aside = BEND.local_coordinates(np.array([39.0, 46.0]))
    assert along == pytest.approx(BEND.length + 6.0) and aside == pytest.approx(1.0)


def test_a_lane_that_crosses_its_own_beginning_keeps_the_two_apart() -> None:
    # Straight on, its end leads over its beginning.
    assert RAMP.local_coordinates(np.array([-29.99, 0.5])) == pytest.approx((30.01, 0.5))
    assert RAMP.local_coordinates(RAMP.position(RAMP.length - 5.0, 0.5))[0] == pytest.approx(RAMP.length - 5.0)


def test_a_sampled_arc_is_nearly_the_arc() -> None:
    exact = CircularLane((0.0, 30.0), 30.0, -np.pi / 2, np.pi / 2)
    sampled = PolylineLane(arc((0.0, 30.0), 30.0, -np.pi / 2, np.pi / 2, 24))
    for along in np.linspace(7.0, sampled.length - 7.0, 40):
        share = along / sampled.length * exact.length
        assert abs(sampled.heading_at(along) - exact.heading_at(share)) < 0.02
        assert sampled.radius_at(along) == pytest.approx(30.0, rel=0.02)
        np.testing.assert_allclose(sampled.position(along, 1.0), exact.position(share, 1.0), atol=0.1)


def test_the_heading_turns_evenly_around_a_corner_and_nowhere_else() -> None:
    lane = PolylineLane([[0, 0], [20, 0], [20 + 20 * np.cos(0.4), 20 * np.sin(0.4)]])
    headings = [lane.heading_at(along) for along in (10.0, 17.0, 18.5, 20.0, 21.5, 23.0, 30.0)]
    np.testing.assert_allclose(headings, [0.0, 0.0, 0.1, 0.2, 0.3, 0.4, 0.4], atol=1e-12)
    assert lane.radius_at(20.0) == pytest.approx(20.0 / 0.4) and lane.radius_at(1.0) == np.inf


def test_kernels_and_lanes_agree() -> None:
    network = RoadNetwork()
    for k, lane in enumerate((StraightLane((0, 0), (9, 3)), BEND, CircularLane((0, 9), 9, 0.0, 2.0), RAMP)):
        network.add_lane(f"a{k}", f"b{k}", lane)
    arrays, rng = NumberedNetwork(network).arrays, np.random.default_rng(2)
    for row, lane in zip(arrays.lanes, network.lanes.values(), strict=True):
        for along, x, y in rng.uniform(-5.0, 40.0, (30, 3)):
            assert local_coordinates(row, arrays.corners, x, y) == pytest.approx(
                lane.local_coordinates(np.array([x, y]))
            )
            assert position_at(row, arrays.corners, along) == pytest.approx(tuple(lane.position(along, 0.0)))
            assert heading_at(row, arrays.corners, along) == pytest.approx(lane.heading_at(along))
            assert radius_at(row, arrays.corners, along) == pytest.approx(lane.radius_at(along))


@pytest.mark.parametrize("widths", [3.2, (3.2, 3.2, 4.0, 5.0, 2.6)])
def test_the_surface_is_that_of_the_lane_without_slits(widths: float | tuple[float, ...]) -> None:
    lane = PolylineLane(BEND.points, widths)
    pieces = [shapely.Polygon(outline) for outline in lane_outline(lane)]
    assert all(piece.exterior.is_ccw and piece.convex_hull.area - piece.area < 1e-9 for piece in pieces)
    surface = shapely.union_all(pieces)
    along = np.linspace(0.3, lane.length - 0.3, 300)
    for at, width in zip(along, lane.widths_at(along), strict=True):
        for side in (-0.47, 0.0, 0.47):
            assert surface.contains(shapely.Point(lane.position(at, side * width)))
    for at, width in zip((3.0, 15.0), lane.widths_at(np.array([3.0, 15.0])), strict=True):
        assert not surface.contains(shapely.Point(lane.position(at, 0.53 * width)))
    assert shapely.LineString(lane.points).buffer(lane.width / 2 + 0.1, cap_style="square").contains(surface)


def test_bits_do_not_depend_on_the_number_of_points_asked_for() -> None:
    along = np.linspace(0.0, BEND.length, 9)
    one_by_one = np.array([BEND.position(at, 0.7) for at in along])
    assert BEND.positions(along, 0.7).tobytes() == one_by_one.tobytes()


def test_dashes_are_painted_between_two_curved_lanes() -> None:
    network = RoadNetwork()
    for name, radius_m in (("a", 40.0), ("b", 43.2), ("c", 60.0)):
        network.add_lane(name, f"{name}.", PolylineLane(arc((0.0, 0.0), radius_m, 0.0, 1.5, 12), 3.2))
    dashes = np.array(lane_lines(network))
    assert len(dashes) == 8 and np.allclose(np.linalg.norm(dashes.mean(axis=1), axis=1), 41.6, atol=0.3)
    assert all(shapely.Polygon(dash).exterior.is_ccw for dash in dashes)
    assert not lane_lines(network, [("a", "a."), ("b", "b.")])
