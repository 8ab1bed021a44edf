"""What kernels find between roads is what a plain look at every pair finds, in a turned lattice of streets."""

from itertools import combinations

import numpy as np
import pytest
import shapely
from lattice_town import lattice_town

from coopsim.world.custom.conflicts import conflicting_roads, middle_line
from coopsim.world.custom.place import place_from
from coopsim.world.places.layout import CLEARANCE_M, Layout
from coopsim.world.places.road_network import StraightLane
from coopsim.world.traffic.movements import clearances


@pytest.fixture(scope="module")
def town() -> Layout:
    return place_from(lattice_town(2, 1), "lattice").make_layout()


def test_roads_conflict_where_their_middle_lines_meet(town: Layout) -> None:
    lines = {index[:2]: shapely.LineString(middle_line(lane)) for index, lane in town.network.lanes.items()}
    found = set()
    for a, b in combinations(lines, 2):
        if a[0] != b[0] and a[1] != b[0] and b[1] != a[0] and (a[1] == b[1] or lines[a].intersects(lines[b])):
            found |= {a, b}
    assert set(conflicting_roads(town.network)) == found and len(found) == 24


def test_clearances_are_the_last_places_near_another_line(town: Layout) -> None:
    lanes = [town.network.get_lane((*road, 0)) for road in town.movements]
    lines = [
        np.array([lane.position(s, 0.0) for s in np.linspace(0.0, lane.length, int(2 * lane.length) + 2)])
        for lane in lanes
    ]
    got = clearances(town.network, town.movements, 3.4)
    assert len(town.movements) > 1
    for a, start_a in enumerate(town.movements):
        for b, start_b in enumerate(town.movements):
            gap_m = np.linalg.norm(lines[a][:, None] - lines[b], axis=2).min(axis=0)
            straight = isinstance(lanes[a], StraightLane) and isinstance(lanes[b], StraightLane)
            near = np.flatnonzero(gap_m < (3.4 if straight else CLEARANCE_M))
            want = near[-1] / (len(lines[b]) - 1) * lanes[b].length if len(near) else -np.inf
            assert got[a, b] == (want if start_a[0] != start_b[0] else -np.inf)


def test_stripes_are_painted_where_a_crosswalk_is_on_a_lane(town: Layout) -> None:
    parts = {part.name: part for part in town.static}
    middles = parts["marking"].vertices.reshape(-1, 4, 3)[..., :2].mean(axis=1)
    want = []
    for outline in town.road_map.crosswalks:
        a, b = (outline[0] + outline[3]) / 2, (outline[1] + outline[2]) / 2
        along = (b - a) / np.linalg.norm(b - a)
        spots = [a + start * along for start in np.arange(0.25, np.linalg.norm(b - a) - 0.25, 1.0)]
        want += [spot for spot in spots if any(lane.contains(spot) for lane in town.network.lanes.values())]
    np.testing.assert_allclose(middles, want, atol=1e-9)


def test_positions_along_a_lane_are_those_one_by_one(town: Layout) -> None:
    assert town.network.lanes
    for lane in town.network.lanes.values():
        along = np.linspace(0.0, lane.length, 7)
        for aside in (0.0, 1.7):
            one_by_one = np.array([lane.position(s, aside) for s in along])
            assert lane.positions(along, aside).tobytes() == one_by_one.tobytes()
