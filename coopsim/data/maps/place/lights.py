"""Lights of a map's junctions: the file's programs, where these run by themselves, else made ones."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from coopsim.data.maps.place.lines import heading_of, part_of, spaced
from coopsim.data.maps.place.strips import Strip, conflicts_of
from coopsim.data.maps.street_map import SignalProgram, StreetCrossing, StreetMap, StreetWay, Turn
from coopsim.geometry import exact
from coopsim.geometry.se3 import Floats
from coopsim.world.places.description import MapPhase, MapSignal
from coopsim.world.places.signal_plans import LitCrossing, LitMovement, make_program

Crosswalks = Mapping[str, tuple[str, str]]
"""Two nodes of people's ways, by the id of the crossing."""

_LONGEST_S, _SHORTEST_S = 120.0, 1.0  # a program with a longer phase does not run by itself; shorter ones are left out
LETTERS_OF_SUMO = str.maketrans("oOsu", "gggr")
"""Off; a turn after a stop; red and yellow."""

_SPEED_M_S = 13.9
_MIRRORED: Mapping[Turn, Turn] = {"left": "right", "right": "left"}
_BESIDE_M, _OVER_M = 10.0, 1.5  # of lanes beside a junction that crossings belong to; from their middles to crossings


def signals_of(streets: StreetMap, strips: Sequence[Strip], crosswalks: Crosswalks, seed: int) -> tuple[MapSignal, ...]:
    """Return the lights of ways, and of the crossings among `crosswalks`; `seed` decides the times of made programs."""
    lit: dict[str, list[Strip]] = {}
    lights = {each.id: each.controller for each in streets.signals if each.kind == "light"}
    for strip in strips:
        way = _way(strip)
        if way.program is not None:
            lit.setdefault(f"program {way.program}", []).append(strip)
        elif any(name in lights for name in way.signals):
            lit.setdefault(f"junction {way.junction}", []).append(strip)
    found = []
    for name, inside in lit.items():
        way, roads = _way(inside[0]), tuple((each.start, each.end) for each in inside)
        program = None if way.program is None else streets.programs[way.program]
        crossings = [each for each in streets.crossings if each.id in crosswalks and each.program == way.program]
        if program is not None:
            phases = _phases(program, [*(_way(each).link for each in inside), *(each.link for each in crossings)])
            if phases:
                walks = tuple(crosswalks[each.id] for each in crossings)
                found.append(MapSignal(roads, phases, walks, program.offset_s))
                continue
        lines = [_with_lanes(streets, each) for each in inside] if crossings else []
        over = {each.id: _over(each, lines) for each in crossings}
        crossings = [each for each in crossings if any(over[each.id])]
        phases = make_program(
            [_movement(streets, each) for each in inside],
            conflicts_of(inside),
            [LitCrossing(_length_m(each), *over[each.id]) for each in crossings],
            seed=seed,
            name=name,
            groups=_groups(inside, lights),
        )
        if phases:
            found.append(MapSignal(roads, phases, tuple(crosswalks[each.id] for each in crossings)))
    return tuple(found)


def _way(strip: Strip) -> StreetWay:
    assert strip.way is not None, "it is a way"
    return strip.way


def _groups(strips: Sequence[Strip], lights: Mapping[str, str | None]) -> tuple[list[int], ...]:
    """Return the numbers of ways by the controller of the first of their lights that has one."""
    found: dict[str, list[int]] = {}
    for number, strip in enumerate(strips):
        controller = next((lights[name] for name in _way(strip).signals if lights.get(name)), None)
        if controller is not None:
            found.setdefault(controller, []).append(number)
    return tuple(found.values())


def _phases(program: SignalProgram, links: Sequence[int]) -> tuple[MapPhase, ...]:
    """Return the phases of a program for some links; none where one lasts too long, or a link is never green."""
    rows = [
        (seconds, "".join(state[link] for link in links).translate(LETTERS_OF_SUMO))
        for seconds, state in program.phases
        if seconds >= _SHORTEST_S
    ]
    green = all(any(letters[k] in "Gg" for _, letters in rows) for k in range(len(links)))
    known = all(set(letters) <= set("Ggyr") for _, letters in rows)
    if not rows or not green or not known or max(seconds for seconds, _ in rows) > _LONGEST_S:
        return ()
    return tuple(MapPhase(float(seconds), letters) for seconds, letters in rows)


def _movement(streets: StreetMap, strip: Strip) -> LitMovement:
    lane = streets.lanes[_way(strip).start]
    speed_m_s = lane.speed_m_s or _SPEED_M_S
    # Made programs are for traffic on the right, where left turns go over oncoming traffic.
    turn = _MIRRORED.get(strip.turn, strip.turn) if streets.left_hand else strip.turn
    return LitMovement(lane.road, lane.id, heading_of(lane.line[-2:]), turn, speed_m_s, strip.length_m)


def _length_m(crossing: StreetCrossing) -> float:
    return float(exact.norm(np.diff(crossing.line[:, :2], axis=0)).sum())


def _over(crossing: StreetCrossing, lines: Sequence[Floats]) -> tuple[tuple[int, ...], tuple[int, ...]]:
    """Return the numbers of ways, of points (N, 2), that go over a crossing as they enter, and as they leave."""
    points, entered, left = spaced(crossing.line, 1.0)[:, :2], list[int](), list[int]()
    low, high = points.min(axis=0) - _OVER_M, points.max(axis=0) + _OVER_M
    for number, line in enumerate(lines):
        if (line.max(axis=0) < low).any() or (line.min(axis=0) > high).any():
            continue
        apart_m = exact.norm(line[:, None] - points[None]).min(axis=1)
        if apart_m.min() < _OVER_M:
            (entered if int(np.argmin(apart_m)) < len(line) / 2 else left).append(number)
    return tuple(entered), tuple(left)


def _with_lanes(streets: StreetMap, strip: Strip) -> Floats:
    """Return points (N, 2) along a way, and the lanes before and behind it."""
    before, after = streets.lanes[_way(strip).start], streets.lanes[_way(strip).end]
    first, last = before.length_m, min(_BESIDE_M, after.length_m)
    parts = (
        part_of(before.line, before.width_m, max(first - _BESIDE_M, 0.0), first)[0],
        strip.line,
        part_of(after.line, after.width_m, 0.0, last)[0],
    )
    return np.concatenate([spaced(part, 1.0) for part in parts])[:, :2]
