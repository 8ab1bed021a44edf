"""Tests of the roads of a town: vehicles keep to the right, and can go from every arm to others."""

from __future__ import annotations

import numpy as np

from coopsim.world.drawn_options import TownOptions
from coopsim.world.towns.planning import draw_plan
from coopsim.world.towns.roads import lay_roads


def test_every_lane_leads_on_and_every_lane_outwards_of_an_arm_is_reached() -> None:
    for lanes in (1, 2, 3):
        roads = lay_roads(draw_plan(1, TownOptions(junctions=2, lanes=lanes)))
        begins, ends = ({getattr(road, end) for road in roads.roads} for end in ("start", "end"))
        assert begins == ends == set(roads.nodes)


def test_one_drives_on_the_right() -> None:
    plan = draw_plan(1, TownOptions(junctions=2))
    roads = lay_roads(plan)
    assert any(lane.way.stretch(lane.piece).curvature_1_m == 0.0 for lane in roads.lanes)
    for lane in roads.lanes:
        street, along = lane.way.street, (lane.piece.begin[1] + lane.piece.end[1]) / 2
        start, end = (np.array(roads.nodes[name]) for name in lane.road)
        middle, ahead = street.position(along)[0], end - start
        offset = (start + end) / 2 - middle
        if lane.way.stretch(lane.piece).curvature_1_m == 0.0:
            assert ahead[0] * offset[1] - ahead[1] * offset[0] < 0


def test_lengths_of_pieces_are_those_of_their_middle_lines() -> None:
    roads = lay_roads(draw_plan(2, TownOptions(junctions=2, lanes=2)))
    assert {lane.way.stretch(lane.piece).curvature_1_m == 0.0 for lane in roads.lanes} == {True, False}
    for lane in roads.lanes:
        start, end = (np.array(roads.nodes[name]) for name in lane.road)
        straight = lane.way.stretch(lane.piece).curvature_1_m == 0.0
        chord_m = float(np.linalg.norm(end - start))
        assert abs(lane.length_m - chord_m) < 1e-6 if straight else lane.length_m > chord_m
