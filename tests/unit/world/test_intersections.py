"""Junctions as roadside units describe them: lanes that lead to their lights, and times of the lights' changes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from lit_crossing import crossing

from coopsim.types.intersections import HOUR_DS, UNKNOWN_MARK, IntersectionMap, MovementPhase
from coopsim.world.custom.place import place_from
from coopsim.world.intersections import APPROACH_M, EXIT_M, LitJunction, lit_junctions
from coopsim.world.places.layout import Layout
from coopsim.world.places.road_network import RoadNetwork
from coopsim.world.places.signals import Signal

LETTERS = {
    MovementPhase.GREEN: "G",
    MovementPhase.GREEN_GIVE_WAY: "g",
    MovementPhase.YELLOW: "y",
    MovementPhase.YELLOW_AFTER_GIVE_WAY: "y",
    MovementPhase.RED: "r",
}
NS = 10**9


@pytest.fixture(scope="module")
def layout() -> Layout:
    return place_from(crossing(lights=True), "lit").make_layout()


def junction(layout: Layout, *phases: tuple[float, str], offset_s: float = 0.0) -> LitJunction:
    """A junction with one road for each letter."""
    roads = layout.signals[0].roads[: len(phases[0][1])]
    return LitJunction(replace(layout, signals=(Signal(roads, (), phases, offset_s),)), 0)


def groups_of(geometry: IntersectionMap) -> dict[tuple[int, int], int | None]:
    return {(lane.id, to): group for lane in geometry.lanes for to, group in lane.connections}


def test_phases_are_those_of_the_program_at_every_moment(layout: Layout) -> None:
    signal = replace(layout.signals[0], offset_s=3.7)
    lit = LitJunction(replace(layout, signals=(signal,)), 0)
    columns = ["".join(letters[k] for _, letters in signal.phases) for k in range(13)]
    known = lit.phases(0)
    assert len(known.group) == len(set(columns[:12])) + 1  # the crosswalk's group is its own
    for tenths in [*range(0, 700, 3), 36_000 * 5 + 1]:
        shown = lit.phases(tenths * NS // 10)
        letter = dict(zip(shown.group.tolist(), map(LETTERS.__getitem__, shown.phase.tolist()), strict=True))
        groups = groups_of(lit.map)
        assert sorted(letter[g] for g in groups.values() if g) == sorted(signal.state(tenths / 10)), tenths


def test_a_change_is_announced_to_the_tenth(layout: Layout) -> None:
    lit = junction(layout, (7.0, "Gr"), (3.5, "yr"), (2.0, "rr"), (9.0, "rG"), (3.0, "ry"), offset_s=2.0)
    times = np.arange(0, 60 * NS, NS // 10)
    shown = [lit.phases(int(time)) for time in times]
    for k in range(300):
        for column in range(2):
            now = shown[k].phase[column]
            later = next(j for j in range(k, len(times)) if shown[j].phase[column] != now)
            assert shown[k].left_s(int(times[k]))[column] == pytest.approx((later - k) / 10)


def test_yellow_says_what_was_green_before(layout: Layout) -> None:
    lit = junction(layout, (3.0, "yy"), (5.0, "rr"), (5.0, "Gg"))
    assert lit.phases(0).phase.tolist() == [MovementPhase.YELLOW, MovementPhase.YELLOW_AFTER_GIVE_WAY]


def test_marks_begin_anew_with_the_hour(layout: Layout) -> None:
    lit = junction(layout, (40.0, "Gr"), (20.0, "rG"))
    shown = lit.phases(3590 * NS)
    assert shown.likely_ds.tolist() == [0, 0] and shown.left_s(3590 * NS).tolist() == [10.0, 10.0]
    assert shown.left_s(3601 * NS).tolist() == [0.0, 0.0]  # heard late
    assert lit.phases(3595 * NS + 7200 * NS).left_s(10_795 * NS).tolist() == [5.0, 5.0]


def test_changes_far_away_and_never(layout: Layout) -> None:
    shown = junction(layout, (5000.0, "Gr"), (5000.0, "Gg")).phases(0)
    assert shown.earliest_ds.tolist() == [UNKNOWN_MARK, HOUR_DS]
    assert np.isnan(shown.left_s(0)[0]) and shown.left_s(0)[1] == np.inf


def test_lanes_lead_to_the_stop_lines_and_away(layout: Layout) -> None:
    (lit,) = lit_junctions(layout)
    geometry, kinds = lit.map, [(lane.kind, lane.approaches, lane.leaves) for lane in lit.map.lanes]
    assert [kinds.count(each) for each in (("vehicle", True, False), ("vehicle", False, True))] == [4, 4]
    assert kinds[8:] == [("crosswalk", True, True)] and [lane.id for lane in geometry.lanes] == [*range(1, 10)]
    assert len(groups_of(geometry)) == 12 + 1 and geometry.lane_width_m == 3.2
    lines = {tuple(np.round(lane.position(lane.length, 0.0), 6)) for lane in map(layout.network.get_lane, into(layout))}
    for lane in geometry.lanes[:8]:
        first = tuple(np.round(lane.points[0] + geometry.reference[:2], 6))
        assert (first in lines) == lane.approaches
        length_m = np.hypot(*np.diff(lane.points, axis=0).T).sum()
        assert length_m == pytest.approx(min(APPROACH_M, 76.0) if lane.approaches else EXIT_M)


def into(layout: Layout) -> list[tuple[str, str, int]]:
    return [index for index in layout.network.lanes if index[1] in {road[0] for road in layout.signals[0].roads}]


def test_a_place_without_lights_has_none() -> None:
    assert lit_junctions(place_from(crossing(), "unlit").make_layout()) == ()


def test_where_lanes_end_with_the_place_the_last_metre_is_the_exit(layout: Layout) -> None:
    network = RoadNetwork()
    for (start, end, _), lane in layout.network.lanes.items():
        if start != "out2":
            network.add_lane(start, end, lane)
    geometry = LitJunction(replace(layout, network=network), 0).map
    (cut,) = [lane.points for lane in geometry.lanes if np.hypot(*(lane.points[-1] - lane.points[0])) < 1.5]
    inner, end = cut + geometry.reference[:2]
    np.testing.assert_allclose(end, layout.network.get_lane(("out2", "out2.", 0)).position(0.0, 0.0), atol=1e-6)
    assert np.hypot(*inner) < np.hypot(*end) and len(groups_of(geometry)) == 13


def test_lights_before_which_no_lane_leads_are_left_out(layout: Layout) -> None:
    network = RoadNetwork()
    for (start, end, _), lane in layout.network.lanes.items():
        if start != "in2.":
            network.add_lane(start, end, lane)
    geometry = LitJunction(replace(layout, network=network), 0).map
    assert len(groups_of(geometry)) == 9 + 1 and len(geometry.lanes) == 3 + 4 + 1
