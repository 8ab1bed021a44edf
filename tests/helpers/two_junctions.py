"""A street that crosses two others right after each other: between the junctions no vehicle can stop."""

from __future__ import annotations

from itertools import product

from lit_crossing import _turn

from coopsim.world.places.description import MapLane, PlaceDescription, Point, line_of

FAR_M, HALF_M, LANE_M = 70.0, 10.0, 3.2
_ARMS = ("E", "N", "W", "S")


def two_junctions(gap_m: float = 6.0, *, priority: bool = False) -> PlaceDescription:
    """Return the place; `priority` is that of the street along x over those that cross it.

    Lanes into junction j (0 or 1) from arm a end at node `ja`, those out begin at `jA` for the arm's small letter.
    """
    nodes, roads = dict[str, Point](), list[MapLane]()
    for junction, arm in product((0, 1), range(4)):
        x = (2 * junction - 1) * (HALF_M + gap_m / 2)
        for name, aside in ((f"{junction}{_ARMS[arm]}", 1), (f"{junction}{_ARMS[arm].lower()}", -1)):
            nodes[name] = _at(x, arm, HALF_M, aside)
            between = (junction, arm) in ((0, 0), (1, 2))
            if not between:
                nodes[f"{name}."] = _at(x, arm, FAR_M, aside)
                ends = (f"{name}.", name) if aside > 0 else (name, f"{name}.")
                roads.append(MapLane(*ends, width_m=LANE_M, curved=True))
        for to in range(4):
            if to != arm:
                roads.append(_movement(nodes, junction, arm, to, x, priority=priority))
    for ends in (("0e", "1W"), ("1w", "0E")):
        roads.append(MapLane(*ends, width_m=LANE_M, curved=True))
    return PlaceDescription(nodes=nodes, roads=tuple(roads), cut=True)


def _at(x: float, arm: int, far_m: float, aside: int) -> Point:
    """Return a place on an arm; lanes into the junction are on the left side of it, seen from the junction."""
    ex, ey = ((1, 0), (0, 1), (-1, 0), (0, -1))[arm]
    return x + far_m * ex - aside * ey * LANE_M / 2, far_m * ey + aside * ex * LANE_M / 2


def _movement(nodes: dict[str, Point], junction: int, arm: int, to: int, x: float, *, priority: bool) -> MapLane:
    start = nodes[f"{junction}{_ARMS[arm]}"] = _at(x, arm, HALF_M, 1)
    end = nodes[f"{junction}{_ARMS[to].lower()}"] = _at(x, to, HALF_M, -1)
    corner = (start[0], end[1]) if arm % 2 else (end[0], start[1])
    straight = (to - arm) % 4 == 2
    return MapLane(
        f"{junction}{_ARMS[arm]}",
        f"{junction}{_ARMS[to].lower()}",
        () if straight else line_of(_turn(start, corner, end)[1:-1]),
        width_m=LANE_M,
        speed_m_s=11.0 if straight else 6.0,
        curved=True,
        priority=priority and straight and arm in (0, 2),
    )
