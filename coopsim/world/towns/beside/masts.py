"""Places for roadside units: at corners of junctions, between the kerb and people's way."""

from __future__ import annotations

import numpy as np

from coopsim.geometry import exact
from coopsim.geometry.se3 import Floats
from coopsim.support.rng import stream
from coopsim.world.towns.beside.people_ways import PeopleWays
from coopsim.world.towns.beside.site import Site
from coopsim.world.towns.streets.kerb_sides import CORNER, Round
from coopsim.world.towns.streets.line_kernels import distances_to_lines
from coopsim.world.towns.streets.plan import Plan

_FROM_KERB_M = (1.1, 0.9, 0.7)
_FROM_WAY_M = 1.1  # half of a person, their way's breadth, and the mast
_BARELY_M = 0.4  # the same at junctions without enough room, where agents meet
_LEAST = 2  # masts where they meet: the usual number
_CROSSWALK_MORE_M = 1.0  # from the middle of a crosswalk, besides
_SHARES = (0.5, 0.4, 0.6, 0.3, 0.7)  # of the length of the corner's kerb
_ELSEWHERE = 0.6  # share of other corners that have a mast; the first ones are where connected cars meet


def place_masts(
    site: Site, plan: Plan, rounds: tuple[Round, ...], ways: PeopleWays, kerbs: tuple[Floats, Floats, Floats], seed: int
) -> None:
    """Add masts, first those at the meeting junction; each looks at its junction's middle.

    Args:
        site: the town, changed in place.
        plan: streets and junctions.
        rounds: the edges of the streets.
        ways: of people.
        kerbs: see `kerb_lines_of`.
        seed: the town's.
    """
    spans = np.array(ways.spans()).reshape(-1, 2, 2)
    starts = np.concatenate([*ways.lines, spans[:, 0]])
    ends = np.concatenate([*(np.roll(line, -1, axis=0) for line in ways.lines), spans[:, 1]])
    widths = np.repeat([0.0, _CROSSWALK_MORE_M], [len(starts) - len(spans), len(spans)])
    found, spare = [], []
    for each in rounds:
        for side in each.sides:
            if side.kind != CORNER:
                continue
            spots, from_kerb_m = _spots(side.kerb)
            off_road = distances_to_lines(spots, *kerbs) > from_kerb_m - 0.2
            from_way_m = np.where(off_road, distances_to_lines(spots, starts, ends, widths), 0.0)
            clear = from_way_m > _FROM_WAY_M
            best = int(from_way_m.argmax())
            if not clear.any() and side.number == plan.meeting and from_way_m[best] > _BARELY_M:
                spare.append((from_way_m[best], spots[best], side.number))
            if clear.any():
                rng = stream(seed, "mast", str(side.number), str(side.arm))
                meets = side.number == plan.meeting
                found.append((not meets, rng.random(), spots[int(clear.argmax())], side.number))
    at_meeting = sum(not elsewhere for elsewhere, *_ in found)
    for _, at, number in sorted(spare, key=lambda each: -each[0])[: max(0, _LEAST - at_meeting)]:
        found.append((False, 1.0, at, number))  # people pass close by
    for elsewhere, draw, at, number in sorted(found, key=lambda each: each[:2]):
        if not elsewhere or draw < _ELSEWHERE or "rsus" not in site.items:
            site.add("rsus", at=at.tolist(), look_at=plan.junctions[number].centre.tolist())
            site.kerbside.take(at + np.array([[-0.2, 0.0], [0.2, 0.0]]), 0.2)


def _spots(kerb: Floats) -> tuple[Floats, Floats]:
    """Return places (N, 2) m to the right of a kerb (K, 2) m, best first, and their distances (N,) from it, m."""
    steps = np.diff(kerb, axis=0)
    passed_m = np.concatenate([[0.0], np.cumsum(exact.hypot(steps[:, 0], steps[:, 1]))])
    at_m = np.array(_SHARES) * passed_m[-1]
    step = steps[np.searchsorted(passed_m, at_m, side="right").clip(1, len(steps)) - 1]
    right = np.column_stack([step[:, 1], -step[:, 0]]) / exact.hypot(step[:, 0], step[:, 1])[:, None]
    on_kerb = np.column_stack([np.interp(at_m, passed_m, kerb[:, axis]) for axis in (0, 1)])
    away_m = np.repeat(_FROM_KERB_M, len(at_m))
    count = len(_FROM_KERB_M)
    return np.tile(on_kerb, (count, 1)) + away_m[:, None] * np.tile(right, (count, 1)), away_m
