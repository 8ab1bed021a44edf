"""Ways of people along streets: pavements, corners and crosswalks, and the edges of the lanes."""

from __future__ import annotations

import numpy as np

from coopsim.world.places.layout import Footways
from coopsim.world.places.streets import Streets, place

_FAR_WALK_M = 75.0
_RIDE_M = 0.25  # from the lanes' edge inwards to where people ride
_JOIN_M = 5.0  # from the stop line outwards to where riders leave and join the lanes


def footways_of(streets: Streets) -> Footways:
    """Return ways along both sides of every arm, from arm to arm, and over every arm at its crosswalk.

    Every arm has four nodes: near and far on its left, near and far on its right.
    """
    nodes = [
        place(arm, (x, side * streets.walk_m))
        for arm in streets.arms
        for side in (1, -1)
        for x in (streets.crosswalk_m, _FAR_WALK_M)
    ]
    count = len(nodes)
    crossing, linked = np.zeros((2, count, count), dtype=bool)
    for k in range(len(streets.arms)):
        left, right = 4 * k, 4 * k + 2  # the near nodes of both sides; the far ones follow them
        following = (4 * (k + 1) + 2) % count  # the next arm's right side shares the corner of our left side
        for a, b in ((left, left + 1), (right, right + 1), (left, following), (left, right)):
            linked[a, b] = linked[b, a] = True
        crossing[left, right] = crossing[right, left] = True
    neighbours = np.full((count, 3), -1, dtype=np.int64)
    for node in range(count):
        to = np.flatnonzero(linked[node])
        neighbours[node, : len(to)] = to
    return Footways(np.array(nodes), neighbours, crossing)


def cycleways_of(streets: Streets) -> Footways:
    """Return ways on the right edge of every arm's lanes, and as for walkers around corners and over the arms.

    Far out riders turn round to the other side when there is a gap. Every arm has three nodes on its way in, from far
    out to the crosswalk, and after those of all arms three at the same places on its way out.
    """
    join_m, ride_m = streets.stop_m + _JOIN_M, streets.edge_m - _RIDE_M
    places = ((_FAR_WALK_M, ride_m), (join_m, ride_m), (streets.crosswalk_m, streets.walk_m))
    arms = len(streets.arms)
    nodes = [place(arm, spot) for arm in streets.arms for spot in places]
    nodes += [place(arm, (x, -y)) for arm in streets.arms for x, y in places]
    neighbours = np.full((6 * arms, 2), -1, dtype=np.int64)
    crossing = np.zeros((6 * arms, 6 * arms), dtype=bool)
    for k in range(arms):
        inwards, outwards = 3 * k, 3 * (arms + k)
        corner = 3 * (arms + (k + 1) % arms)  # the next arm's right side shares the corner of our left side
        neighbours[inwards, 0], neighbours[inwards + 1, 0] = inwards + 1, inwards + 2
        neighbours[inwards + 2] = outwards + 2, corner + 2
        neighbours[outwards + 2] = outwards + 1, 3 * ((k - 1) % arms) + 2
        neighbours[outwards + 1, 0], neighbours[outwards, 0] = outwards, inwards
        crossing[inwards + 2, outwards + 2] = crossing[outwards, inwards] = True
    return Footways(np.array(nodes), neighbours, crossing)
