import numpy as np
import pytest
from shapely import Polygon

from coopsim.geometry.outlines import distances_to_lines
from coopsim.world.drawn_options import TownOptions
from coopsim.world.towns.kerbs import CORNER, LOOP, STREET, kerb_lines_of, trace_rounds
from coopsim.world.towns.planning import draw_plan

SEEDS = (0, 3, 10)


@pytest.mark.parametrize("seed", SEEDS)
def test_rounds_pass_every_side_of_the_town_once(seed):
    plan = draw_plan(seed, TownOptions())
    sides = [side for each in trace_rounds(plan) for side in each.sides]
    streets = [(side.number, side.arm) for side in sides if side.kind == STREET]
    corners = [(side.number, side.arm) for side in sides if side.kind == CORNER]
    loops = sum(end.junction is None for street in plan.streets for end in (street.begin, street.end))
    assert sorted(streets) == sorted((street.number, way) for street in plan.streets for way in (-1, 1))
    assert sorted(corners) == [(j.number, arm) for j in plan.junctions for arm in range(len(j.arms))]
    assert sum(side.kind == LOOP for side in sides) == loops


@pytest.mark.parametrize("seed", SEEDS)
def test_parts_of_a_round_join(seed):
    rounds = trace_rounds(draw_plan(seed, TownOptions()))
    assert rounds and all(each.sides for each in rounds)
    for each in rounds:
        for side, after in zip(each.sides, [*each.sides[1:], each.sides[0]], strict=True):
            # Lanes of turning loops are a little narrower than those of streets.
            assert np.linalg.norm(side.kerb[-1] - after.kerb[0]) < 0.1


@pytest.mark.parametrize("seed", SEEDS)
def test_lines_beside_a_street_are_as_far_from_all_kerbs(seed):
    rounds = trace_rounds(draw_plan(seed, TownOptions()))
    lines = kerb_lines_of(rounds)
    assert rounds
    for each in rounds:
        distance_m = distances_to_lines(each.clear_offset(2.6, lines), *lines)
        assert distance_m.min() > 1.8  # at the ends of parking strips the line has corners


@pytest.mark.parametrize("seed", SEEDS)
def test_rounds_do_not_meet(seed):
    # The streets are what is outside of all blocks and inside of the round along the outside of the town.
    areas = [Polygon(each.kerb) for each in trace_rounds(draw_plan(seed, TownOptions()))]
    assert all(area.is_valid for area in areas)
    outer = max(areas, key=lambda area: area.area)
    assert all(outer.contains(area) for area in areas if area is not outer)
