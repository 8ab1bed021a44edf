"""Who gives way to whom: the rule by classes, what a place says itself, and which movements are near each other."""

from __future__ import annotations

import numpy as np
import pytest
from lit_crossing import crossing, movements

from coopsim.errors import InvalidValueError
from coopsim.world.custom.place import place_from
from coopsim.world.places.layout import Layout
from coopsim.world.places.polyline import PolylineLane
from coopsim.world.places.road_network import RoadNetwork
from coopsim.world.scenario import SCENARIOS
from coopsim.world.traffic.lanes import NumberedNetwork
from coopsim.world.traffic.movements import FIRST, USUAL, YIELDS, Movements, clearances, movements_of

LEFT = {(a, (a + 3) % 4): [((a + 2) % 4, a), ((a + 2) % 4, (a + 3) % 4)] for a in range(4)}
"""Movements to which left turns give way: oncoming traffic straight on and to its right."""

SIDE = {(a, b): [m for m in movements() if m[0] in (0, 2)] + LEFT.get((a, b), []) for a, b in movements() if a % 2}
"""The same of a side street from north and south: it gives way to the main one, too."""


def movements_in(layout: Layout) -> Movements:
    return movements_of(
        NumberedNetwork(layout.network), layout.movements, layout.priority, layout.clearance_m, layout.yields
    )


@pytest.mark.parametrize("name", ["crossing", "merge", "roundabout"])
def test_by_classes_those_who_yield_do_so_to_all_with_priority(name: str) -> None:
    found, layout = movements_in(SCENARIOS.get(name).make_layout()), SCENARIOS.get(name).make_layout()
    first = np.array([road in layout.priority for road in layout.movements])
    near = np.isfinite(found.clear_m)
    assert (found.yields == (near & first & ~first[:, None])).all()
    assert (found.role == np.where(first, FIRST, np.where((near & first).any(axis=1), YIELDS, USUAL))).all()
    assert not found.closed.any() and not found.clears.any() and found.braking_m_s2 == np.inf


def test_a_left_turn_of_the_main_road_yields_and_goes_before_the_side_road() -> None:
    layout = place_from(crossing(yields=LEFT | SIDE), "main").make_layout()
    found, number = movements_in(layout), {road: k for k, road in enumerate(layout.movements)}
    main_left, oncoming, side = number["in0", "out3"], number["in2", "out0"], number["in1", "out3"]
    assert found.role[[main_left, oncoming, side]].tolist() == [YIELDS, FIRST, YIELDS]
    assert found.yields[main_left, oncoming] and not found.yields[oncoming, main_left]
    assert found.yields[side, main_left] and not found.yields[main_left, side]
    assert found.braking_m_s2 < 5


def test_yields_of_a_place_are_read_and_checked() -> None:
    plain = place_from(crossing(yields=LEFT), "main").description.plain
    lane = next(lane for lane in plain["roads"] if lane["from"] == "in0" and lane["to"] == "out3")
    assert [list(names) for names in lane["yields"]] == [["in2", "out0"], ["in2", "out3"]]
    lane["yields"] = (("in2", "out2"),)
    with pytest.raises(InvalidValueError, match=r"roads\[\d+\]\.yields.*must be a road, got \[in2, out2\]"):
        place_from(plain, "wrong")
    lane["yields"] = (("in0", "out3"),)
    with pytest.raises(InvalidValueError, match="cannot yield to itself"):
        place_from(plain, "wrong")


def two(line: list[tuple[float, float]], other: list[tuple[float, float]], width_m: float = 3.2) -> bool:
    network = RoadNetwork()
    network.add_lane("a", "b", PolylineLane(line, width_m))
    network.add_lane("c", "d", PolylineLane(other, width_m))
    return bool(np.isfinite(clearances(network, [("a", "b"), ("c", "d")], 3.4)).any())


def test_lanes_side_by_side_are_no_conflict_and_opposite_turns_are() -> None:
    straight, right = [(0.0, 0.0), (20.0, 0.0)], [(0.0, -3.2), (6.0, -3.5), (10.0, -6.0), (12.0, -12.0)]
    assert not two(straight, [(0.0, -3.2), (20.0, -3.2)])
    assert not two(straight, [(0.0, -2.95), (20.0, -2.95)], 3.5)  # as lanes that turn together come to lie
    assert two(straight, [(0.0, -2.8), (20.0, -2.8)], 3.5)
    assert not two(straight, [(20.0, 3.2), (0.0, 3.2)])  # oncoming
    assert two(straight, [(20.0, 2.2), (0.0, 2.2)])
    assert not two(straight, right)
    assert two(straight, [(0.0, -3.2), (10.0, -3.2), (20.0, -0.5)])  # it joins
    left = [(-10.0, -1.6), (-3.0, -1.0), (1.0, 2.0), (1.6, 10.0)]
    opposite = [(10.0, 2.6), (4.5, 2.0), (0.9, -0.9), (-1.0, -10.0)]
    apart_m = np.linalg.norm(PolylineLane(left).points[:, None] - PolylineLane(opposite).points, axis=2).min()
    assert 2.5 < apart_m < 4.2 and two(left, opposite)
