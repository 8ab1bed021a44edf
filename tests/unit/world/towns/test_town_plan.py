"""Tests of centre lines: they begin and end where they shall, and have no kinks."""

from __future__ import annotations

import itertools
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from coopsim.errors import InvalidValueError
from coopsim.world.drawn_options import TownOptions
from coopsim.world.towns import planning
from coopsim.world.towns.plan import Plan, Station, Street, StreetEnd, rounded
from coopsim.world.towns.planning import are_apart, draw_plan


def test_a_rounded_line_meets_its_ends_without_kinks() -> None:
    points = np.array([[0.0, 0.0], [80.0, 10.0], [120.0, 90.0]])
    line = rounded(points, (20.0, 30.0), 1)
    assert line is not None and len(line) == 3
    for before, after in pairwise(line):
        end = np.array([before.length_m])
        np.testing.assert_allclose(before.position(end, np.zeros(1))[0], after.start, atol=1e-9)
        np.testing.assert_allclose(np.sin(before.heading(end)[0] - after.heading_rad), 0.0, atol=1e-9)
    last = line[-1]
    np.testing.assert_allclose(last.position(np.array([last.length_m]), np.zeros(1))[0], points[-1], atol=1e-9)
    assert line[0].length_m >= 20.0 and last.length_m >= 30.0


def test_a_line_without_room_for_its_bend_is_refused() -> None:
    points = np.array([[0.0, 0.0], [30.0, 0.0], [30.0, 30.0]])
    assert rounded(points, (10.0, 10.0), 1) is None


def test_places_beside_a_street_are_on_its_left_where_aside_is_positive() -> None:
    line = rounded(np.array([[0.0, 0.0], [60.0, 0.0], [60.0, 70.0]]), (5.0, 5.0), 1)
    assert line is not None
    ends, stations = (StreetEnd(None), StreetEnd(None)), (Station(0.0, 1), Station(100.0, 2))
    street = Street(0, line, *ends, stations, 10.0)
    np.testing.assert_allclose(street.position([1.0, 2.0], 3.0), [[1.0, 3.0], [2.0, 3.0]])
    np.testing.assert_allclose(street.position(street.length_m - 1.0, 3.0), [[57.0, 69.0]])
    np.testing.assert_allclose(street.half_m([0.0, 50.0, 100.0]), [4.175, 6.3, 8.425])


def _outline(plan: Plan) -> list[tuple[object, ...]]:
    return [(s.number, s.length_m, s.begin, s.end, s.stations, s.speed_m_s) for s in plan.streets]


@pytest.mark.parametrize(("junctions", "lanes"), [(1, 3), (2, 2), (4, 1), (6, 1), (9, 1)])
def test_a_plan_has_the_wanted_junctions_and_lanes(junctions: int, lanes: int) -> None:
    plan = draw_plan(3, TownOptions(junctions=junctions, lanes=lanes))
    assert len(plan.junctions) == junctions
    assert max(junction.lanes for junction in plan.junctions) == lanes
    assert max(station.lanes for street in plan.streets for station in street.stations) == lanes
    assert plan.junctions[plan.meeting].lanes == lanes
    np.testing.assert_allclose(plan.junctions[plan.meeting].centre, 0.0)


def test_the_same_seed_gives_the_same_plan_and_another_seed_another() -> None:
    first, again, other = (_outline(draw_plan(seed, TownOptions())) for seed in (5, 5, 6))
    assert first == again
    assert first != other


def test_streets_of_many_towns_keep_their_distance_and_lead_from_stop_line_to_stop_line() -> None:
    for seed in range(15):
        plan = draw_plan(seed, TownOptions())
        assert plan.junctions and len(plan.streets) > 2
        for a, b in itertools.combinations(plan.streets, 2):
            shared = {a.begin.junction, a.end.junction} & {b.begin.junction, b.end.junction} - {None}
            spots = [street.position(np.linspace(*street.span_m, 30)) for street in (a, b)]
            for junction in shared:
                assert junction is not None
                node = plan.junctions[junction]
                spots = [each[np.linalg.norm(each - node.centre, axis=1) > node.stop_m + 30.0] for each in spots]
            if all(map(len, spots)):
                assert np.linalg.norm(spots[0][:, None] - spots[1], axis=2).min() > 16.0
        for node in plan.junctions:
            assert 3 <= len(node.arms) <= 5
            assert min(node.gap_rad(arm) for arm in range(len(node.arms))) > np.radians(60.0)
            for arm in node.arms:
                street = plan.streets[arm.street]
                end = street.begin if arm.outwards else street.end
                assert end.junction == node.number and node.arms[end.arm] is arm
                assert end.stop_m == node.stop_m


def test_a_plan_with_streets_on_top_of_each_other_is_found() -> None:
    plan = draw_plan(2, TownOptions(junctions=3))
    moved = replace(plan.streets[1], line=plan.streets[0].line, stations=plan.streets[0].stations, number=1)
    far = replace(plan, streets=(plan.streets[0], moved, *plan.streets[2:]), junctions=())
    assert are_apart(plan)
    assert not are_apart(replace(far, junctions=(plan.junctions[-1],)))


def test_a_town_that_is_not_found_is_an_error_that_says_what_to_change(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(planning, "_attempt", lambda *_: None)
    with pytest.raises(InvalidValueError, match=r"junctions=4 and lanes=2 was found for place_seed=3 .* use fewer"):
        draw_plan(3, TownOptions(junctions=4, lanes=2))
