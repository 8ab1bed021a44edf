"""A crossing of two streets cut out of a map: curved turns, yields, lights, a crosswalk with people."""

from __future__ import annotations

from itertools import product

import numpy as np

from coopsim.world.places.description import (
    MapBuilding,
    MapLane,
    MapPhase,
    MapSignal,
    MapWays,
    PlaceDescription,
    line_of,
)

FAR_M, LINE_M, LANE_M, WALK_M = 90.0, 14.0, 3.2, 10.0


def _turned(arm: int, x: float, y: float) -> tuple[float, float]:
    cos, sin = ((1, 0), (0, 1), (-1, 0), (0, -1))[arm % 4]
    return cos * x - sin * y, sin * x + cos * y


def _turn(start: tuple[float, float], corner: tuple[float, float], end: tuple[float, float]) -> np.ndarray:
    """Return points on a parabola from start to end whose tangents meet in the corner."""
    t = np.linspace(0.0, 1.0, 9)[:, None]
    return (1 - t) ** 2 * np.array(start) + 2 * t * (1 - t) * np.array(corner) + t**2 * np.array(end)


def movements() -> list[tuple[int, int]]:
    """Return arms of the way in and the way out of all movements."""
    return [(a, b) for a, b in product(range(4), range(4)) if a != b]


def crossing(
    *, lights: bool = False, yields: dict[tuple[int, int], list[tuple[int, int]]] | None = None, cut: bool = True
) -> PlaceDescription:
    """Return the place. Lanes into the junction lead from `in0.` to `in0`, those out from `out0` to `out0.`."""
    nodes, roads = dict[str, tuple[float, float]](), list[MapLane]()
    for arm in range(4):
        nodes[f"in{arm}."], nodes[f"in{arm}"] = _turned(arm, FAR_M, LANE_M / 2), _turned(arm, LINE_M, LANE_M / 2)
        nodes[f"out{arm}"], nodes[f"out{arm}."] = _turned(arm, LINE_M, -LANE_M / 2), _turned(arm, FAR_M, -LANE_M / 2)
        for ends in ((f"in{arm}.", f"in{arm}"), (f"out{arm}", f"out{arm}.")):
            roads.append(MapLane(*ends, width_m=LANE_M, curved=True))
        if not cut:
            roads.append(MapLane(f"out{arm}.", f"in{arm}.", turn="around"))
    for a, b in movements():
        start, end = nodes[f"in{a}"], nodes[f"out{b}"]
        given = None if yields is None else tuple((f"in{c}", f"out{d}") for c, d in yields.get((a, b), ()))
        via = ()
        if (b - a) % 4 != 2:
            corner = _turned(a, _turned(-a, *end)[0], LANE_M / 2)
            via = line_of(_turn(start, corner, end)[1:-1])
        speed = 11.0 if (b - a) % 4 == 2 else 6.0
        lane = MapLane(f"in{a}", f"out{b}", via, width_m=LANE_M, speed_m_s=speed, curved=True, yields=given)
        roads.append(lane)
    walks = MapWays(
        nodes={"a": (-40.0, WALK_M), "b": (17.0, WALK_M), "c": (17.0, -WALK_M), "d": (-40.0, -WALK_M)},
        ways=(("a", "b"), ("c", "d")),
        crosswalks=(("b", "c"),),
    )
    houses = tuple(
        MapBuilding(tuple(_turned(arm, x, y) for x, y in ((25, 15), (80, 15), (80, 60), (25, 60))), 9.0)
        for arm in range(4)
    )
    return PlaceDescription(
        nodes=nodes,
        roads=tuple(roads),
        walks=walks,
        buildings=houses,
        cut=cut,
        signals=(program(),) if lights else (),
    )


def program() -> MapSignal:
    """Return two phases with yellow between; the crosswalk over the eastern arm goes with the north and south."""
    every = movements()

    def letters(green: tuple[int, int], yellow: bool) -> str:
        text = ""
        for a, b in every:
            left = (b - a) % 4 == 3
            text += "r" if a not in green else "y" if yellow else "g" if left else "G"
        return text

    phases = []
    for green, walk in (((0, 2), "r"), ((1, 3), "G")):
        phases += [MapPhase(12.0, letters(green, False) + walk), MapPhase(3.0, letters(green, True) + "r")]
        phases += [MapPhase(2.0, "r" * 13)]
    return MapSignal(tuple((f"in{a}", f"out{b}") for a, b in every), tuple(phases), (("b", "c"),))
