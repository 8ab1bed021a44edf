"""Everything beside the lanes of a drawn town: ways of people, parked vehicles, surfaces, buildings, masts."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np

from coopsim.geometry.se3 import Floats
from coopsim.support.rng import stream
from coopsim.world.towns.beside.corner_lots import build_corners
from coopsim.world.towns.beside.frontages import build_frontages
from coopsim.world.towns.beside.kerbside import add_humps, add_puddles, mark_bays
from coopsim.world.towns.beside.masts import place_masts
from coopsim.world.towns.beside.people_ways import PeopleWays, cross_at_junctions, cross_between, describe_ways
from coopsim.world.towns.beside.planting import line_streets, plant_behind
from coopsim.world.towns.beside.private_ground import PrivateGround
from coopsim.world.towns.beside.site import Site
from coopsim.world.towns.beside.surfaces import pave_junctions, pave_sides
from coopsim.world.towns.streets.kerb_lines import corner_kerb
from coopsim.world.towns.streets.kerb_sides import kerb_lines_of, trace_rounds
from coopsim.world.towns.streets.line_kernels import keep_corners
from coopsim.world.towns.streets.plan import Plan

KERB_M = 0.12
"""Height of pavements over the road."""

_WAY_M = 2.6  # from the kerb to the middle of people's way
_HALF_WAY_M = 1.5
_LANE_SIDE_M = 4.0  # from kerbs to both sides, at least: the lane, and the pavement
_CHORD_M = 6.0
_BORDER_M = _WAY_M + _HALF_WAY_M + 0.1


def dress_streets(plan: Plan, seed: int, openness: float | None = None) -> dict[str, Any]:
    """Draw all that is beside the lanes, not turned, as keys of the description of a place.

    Args:
        plan: streets and junctions.
        seed: an integer >= 0.
        openness: see `TownOptions`.

    Returns:
        The keys `walks`, `parked`, `paved`, `walls`, `buildings`, `trees`, `rsus`, `mast_m`, `drones_around`, `kerb_m`,
        `crown`, `humps` and `wet`, as far as there are any.
    """
    open_ = stream(seed, "openness").uniform() if openness is None else openness
    rounds = trace_rounds(plan)
    kerbs = kerb_lines_of(rounds)
    ways = PeopleWays(tuple(each.clear_beside(_WAY_M, kerbs) for each in rounds))
    cross_at_junctions(ways, rounds, plan)
    cross_between(ways, rounds, plan, seed)
    borders = [each.clear_beside(_BORDER_M, kerbs) for each in rounds]
    ground = PrivateGround(plan, rounds, borders, seed, open_)
    site = Site()
    _take_streets(site, plan, ways, kerbs)
    pave_junctions(site, plan)
    pave_sides(site, rounds, ways)
    place_masts(site, plan, rounds, ways, kerbs, seed)
    build_corners(site, ground)
    build_frontages(site, ground)
    line_streets(site, rounds, ways, seed)
    plant_behind(site, ground)
    mark_bays(site, plan, rounds, ways, seed)
    add_humps(site, plan, ways, seed)
    add_puddles(site, plan, seed)
    meeting = plan.junctions[plan.meeting]
    return {
        "walks": describe_ways(ways),
        **site.items,
        "mast_m": float(np.round(stream(seed, "masts").uniform(5.0, 8.0), 1)),
        "drones_around": meeting.centre.tolist(),
        "kerb_m": KERB_M,
        "crown": 0.025,
    }


def _take_streets(site: Site, plan: Plan, ways: PeopleWays, kerbs: tuple[Floats, Floats, Floats]) -> None:
    """Take the ground of streets, junctions, loops and people's ways."""
    for line in ways.lines:
        site.room.take_lines(line, np.roll(line, -1, axis=0), np.full(len(line), _HALF_WAY_M + 0.05))
    site.room.take_lines(kerbs[0], kerbs[1], np.maximum(kerbs[2], _LANE_SIDE_M))
    for street in plan.streets:
        first, last = street.span_m
        along = np.linspace(first, last, max(2, int((last - first) / _CHORD_M)))
        middle, half_m = street.position(along), street.half_m(along)
        site.room.take_lines(middle[:-1], middle[1:], np.maximum(half_m[:-1], half_m[1:]))
    for junction in plan.junctions:
        for arm in range(len(junction.arms)):
            kerb = corner_kerb(junction, arm)
            for here, there in pairwise(kerb[keep_corners(kerb, 1.0)]):
                site.room.take(np.array([junction.centre, here, there]))
