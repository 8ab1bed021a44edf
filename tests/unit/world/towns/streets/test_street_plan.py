"""Tests of plans of towns: options hold, streets keep their distance, junctions have arms far enough apart."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import pytest

from coopsim.errors import InvalidValueError
from coopsim.world.towns.streets import street_plan
from coopsim.world.towns.streets.clear_streets import are_apart
from coopsim.world.towns.streets.plan import Plan
from coopsim.world.towns.streets.street_plan import draw_plan
from coopsim.world.towns.streets.town_options import TownOptions


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
    monkeypatch.setattr(street_plan, "_attempt", lambda *_: None)
    with pytest.raises(InvalidValueError, match=r"junctions=4 and lanes=2 was found for place_seed=3 .* use fewer"):
        draw_plan(3, TownOptions(junctions=4, lanes=2))
