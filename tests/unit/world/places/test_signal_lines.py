"""Stop lines of traffic lights, as bars and by their lights."""

from __future__ import annotations

import numpy as np
from lit_crossing import crossing

from coopsim.world.custom.place import place_from
from coopsim.world.furniture.signal_heads import crosswalks_without_light, head_stands
from coopsim.world.places.signals import by_line, stop_bars

NORTHWARDS = np.array([[2.0, 5.0], [-2.0, 5.0]])
EAST_OF_IT = NORTHWARDS + np.array([4.0, 0.0])


def test_a_bar_lies_before_its_line_and_movements_from_one_lane_share_it() -> None:
    turned = NORTHWARDS + np.array([[0.0, 0.1], [0.0, -0.1]])
    bars = stop_bars([NORTHWARDS, turned, EAST_OF_IT], 1.0)
    assert by_line([NORTHWARDS, turned, EAST_OF_IT]) == [[0, 1], [2]]
    np.testing.assert_allclose(bars[0], [[2, 5], [0, 5], [0, 4], [2, 4]])
    np.testing.assert_allclose(bars[1], [[0, 5], [-2, 5], [-2, 4], [0, 4]])
    np.testing.assert_allclose(bars[2], [[6, 5], [2, 5], [2, 4], [6, 4]])
    assert stop_bars([], 1.0) == []


def test_lanes_side_by_side_have_one_head_which_looks_back() -> None:
    stands, head = head_stands([NORTHWARDS, EAST_OF_IT, NORTHWARDS[::-1] + np.array([40.0, 0.0])])
    assert set(head.tolist()) == {0, 1}
    first = stands[head == 0]
    np.testing.assert_allclose(first[:, 2], -np.pi / 2)
    right, left = first[first[:, 0] > 2], first[first[:, 0] < 2]
    assert right[:, 0].min() == 6.6 and left[:, 0].max() == -2.6 and len(right) == len(left)
    assert len(head_stands([])[0]) == 0


def test_crosswalks_with_a_light_need_no_sign() -> None:
    lit, bare = (place_from(crossing(lights=flag), "it").make_layout() for flag in (True, False))
    assert len(crosswalks_without_light(bare)) == 1 and crosswalks_without_light(lit) == []
