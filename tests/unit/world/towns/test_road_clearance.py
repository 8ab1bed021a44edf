"""Masts stand on no lane."""

from __future__ import annotations

from coopsim.world.towns.drawn_place import describe_streets, draw_place
from coopsim.world.towns.road_clearance import off_roads

NODES = {"a": [0.0, 0.0], "b": [20.0, 0.0], "c": [40.0, 20.0]}
ROADS = [
    {"from": "a", "to": "b"},
    {"from": "b", "to": "c", "centre": [20.0, 20.0], "turn": "left"},
]


def test_masts_on_lanes_are_left_out() -> None:
    beside = [{"at": [10.0, 2.3]}, {"at": [34.0, 12.0]}, {"at": [20.0, 40.0]}]
    on = [{"at": [10.0, 2.0]}, {"at": [20.0 + 20.0 * 0.6, 20.0 - 20.0 * 0.8]}]
    assert off_roads([*beside, *on], NODES, ROADS) == beside


def test_a_town_with_a_wide_turn_can_be_read() -> None:
    assert len(describe_streets(5549)["rsus"]) >= 2
    assert len(draw_place(5549).make_layout().rsus) >= 2
