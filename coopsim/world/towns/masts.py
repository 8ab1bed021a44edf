"""Places for roadside units: at corners of junctions, between the kerb and people's way."""

from __future__ import annotations

import numpy as np

from coopsim.geometry.se3 import Floats
from coopsim.support.rng import stream
from coopsim.world.towns.kerb_sides import CORNER, Round
from coopsim.world.towns.line_kernels import distances_to_lines
from coopsim.world.towns.people_ways import PeopleWays
from coopsim.world.towns.plan import Plan
from coopsim.world.towns.site import Site

_FROM_KERB_M = (0.9, 0.7, 0.5)
_FROM_WAY_M = 1.1  # half of a person, their way's breadth, and the mast
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
    lines = np.concatenate(ways.lines), np.concatenate([np.roll(line, -1, axis=0) for line in ways.lines])
    widths = np.zeros(len(lines[0]))
    found = []
    for each in rounds:
        for k, side in enumerate(each.sides):
            if side.kind != CORNER:
                continue
            own = np.flatnonzero(each.side == k)
            middle = int(own[len(own) // 2])
            spots = each.kerb[middle] + np.array(_FROM_KERB_M)[:, None] * each.right[middle]
            clear = distances_to_lines(spots, *kerbs) > np.array(_FROM_KERB_M) - 0.2
            clear &= distances_to_lines(spots, *lines, widths) > _FROM_WAY_M
            if clear.any():
                rng = stream(seed, "mast", str(side.number), str(side.arm))
                meets = side.number == plan.meeting
                found.append((not meets, rng.random(), spots[int(clear.argmax())], side.number))
    for elsewhere, draw, at, number in sorted(found, key=lambda each: each[:2]):
        if not elsewhere or draw < _ELSEWHERE or "rsus" not in site.items:
            site.add("rsus", at=at.tolist(), look_at=plan.junctions[number].centre.tolist())
            site.kerbside.take(at + np.array([[-0.2, 0.0], [0.2, 0.0]]), 0.2)
