"""Right of way of a map's junctions: what the file says, else rules; and its lights, or made ones."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from coopsim.data.maps.place.lines import along_of, heading_of, turn_rad
from coopsim.data.maps.place.strips import Strip, conflicts_of
from coopsim.data.maps.street_map import SignalProgram, StreetJunction, StreetMap
from coopsim.world.places.description import MapPhase, MapSignal
from coopsim.world.places.signal_plans import LitMovement, make_program

_SIGN_M = 40.0  # a sign this far before a junction holds at it
_OPPOSITE_RAD = np.radians(135.0)
_LONGEST_S = 120.0  # a program with a longer phase is not one that runs by itself
_LETTERS = str.maketrans("oOsu", "gggr", "")
_SPEED_M_S = 13.9


def add_yields(streets: StreetMap, ways: Sequence[Strip]) -> None:
    """Say which ways each way yields to."""
    names = {each.name for each in ways}
    for junction, inside in _by_junction(streets, ways):
        if junction.yields is None:
            _yield_by_rules(streets, inside)
            continue
        first: dict[str, list[str]] = {}
        for late, early in sorted(junction.yields):
            if early in names:
                first.setdefault(late, []).append(early)
        for each in inside:
            each.yields = tuple(first.get(each.name, ()))


def _by_junction(streets: StreetMap, ways: Iterable[Strip]) -> list[tuple[StreetJunction, list[Strip]]]:
    found: dict[str, list[Strip]] = {}
    for each in ways:
        assert each.way is not None, "it is a way"
        found.setdefault(each.way.junction, []).append(each)
    return [(streets.junctions[name], inside) for name, inside in found.items()]


def approach_of(streets: StreetMap, strip: Strip) -> str:
    """Return the road that a way comes from."""
    assert strip.way is not None, "it is a way"
    return streets.lanes[strip.way.start].road


def _yield_by_rules(streets: StreetMap, ways: Sequence[Strip]) -> None:
    """Let ways from roads with signs, or from side roads, yield to the others, and left turns to oncoming traffic."""
    minor = _signed(streets, ways) or _side_roads(streets, ways)
    across = "right" if streets.left_hand else "left"
    for each in ways:
        road = approach_of(streets, each)
        others = [other for other in ways if approach_of(streets, other) != road]
        first = [other for other in others if road in minor and approach_of(streets, other) not in minor]
        if each.turn == across:
            first += [
                other
                for other in others
                if (approach_of(streets, other) in minor) == (road in minor)
                and other.turn != across
                and turn_rad(each.line[:2], other.line[:2]) > _OPPOSITE_RAD
            ]
        each.yields = tuple(other.name for other in first)


def _signed(streets: StreetMap, ways: Iterable[Strip]) -> set[str]:
    """Return the roads with a sign to stop or to yield before a junction."""
    signs = [each for each in streets.signals if each.kind in ("stop", "yield")]
    return {
        approach_of(streets, way)
        for way in ways
        for sign in signs
        if approach_of(streets, way) in {streets.lanes[name].road for name in sign.lanes if name in streets.lanes}
        and float(np.hypot(*(sign.at - way.line[0])[:2])) < _SIGN_M
    }


def _side_roads(streets: StreetMap, ways: Sequence[Strip]) -> set[str]:
    """Return the roads of a junction that are not on its main one: the fastest, then widest, that leads straight on.

    None where two that lead straight on are alike.
    """
    axes: dict[frozenset[str], tuple[float, int]] = {}
    for each in ways:
        if each.turn == "straight" and each.way is not None:
            axis = frozenset((approach_of(streets, each), streets.lanes[each.way.end].road))
            fast, wide = axes.get(axis, (0.0, 0))
            axes[axis] = max(fast, streets.lanes[each.way.start].speed_m_s or 0.0), wide + 1
    best = max(axes.values(), default=None)
    main = [axis for axis, rank in axes.items() if rank == best]
    roads = {approach_of(streets, each) for each in ways}
    if len(main) == 2 and not main[0] & main[1] and len(roads) == 2:  # one-way streets that cross
        return set()
    return roads - main[0] if len(main) == 1 else set()


def signals_of(streets: StreetMap, ways: Sequence[Strip], seed: int) -> tuple[MapSignal, ...]:
    """Return the lights of ways: by the file's programs, where these run by themselves, else made ones."""
    lights = {each.id: each for each in streets.signals if each.kind == "light"}
    lit: dict[str, list[Strip]] = {}
    for each in ways:
        assert each.way is not None, "it is a way"
        if each.way.program is not None:
            lit.setdefault(f"program {each.way.program}", []).append(each)
        elif any(name in lights for name in each.way.signals):
            lit.setdefault(f"junction {each.way.junction}", []).append(each)
    found = []
    for name, inside in lit.items():
        program = streets.programs.get(inside[0].way.program or "") if inside[0].way else None
        phases, offset_s = (_phases(program, inside), program.offset_s) if program else ((), 0.0)
        groups: dict[str, list[int]] = {}
        for number, each in enumerate(inside):
            for light in each.way.signals if each.way else ():
                if light in lights and lights[light].controller is not None:
                    groups.setdefault(str(lights[light].controller), []).append(number)
                    break
        if not phases:
            offset_s, movements = 0.0, [_movement(streets, each) for each in inside]
            made = make_program(movements, conflicts_of(inside), seed=seed, name=name, groups=tuple(groups.values()))
            phases = made
        if phases:
            roads = tuple((each.start, each.end) for each in inside)
            found.append(MapSignal(roads, phases, offset_s=float(offset_s)))
    return tuple(found)


def _phases(program: SignalProgram, ways: Sequence[Strip]) -> tuple[MapPhase, ...]:
    """Return the phases of a program for some ways; none where one lasts too long, or a way is never green."""
    links = [each.way.link for each in ways if each.way is not None]
    rows = [(seconds, "".join(state[link] for link in links).translate(_LETTERS)) for seconds, state in program.phases]
    rows = [(seconds, letters) for seconds, letters in rows if seconds >= 1.0]
    green = all(any(letters[k] in "Gg" for _, letters in rows) for k in range(len(links)))
    known = all(set(letters) <= set("Ggyr") for _, letters in rows)
    if not rows or not green or not known or max(seconds for seconds, _ in rows) > _LONGEST_S:
        return ()
    return tuple(MapPhase(float(seconds), letters) for seconds, letters in rows)


def _movement(streets: StreetMap, strip: Strip) -> LitMovement:
    assert strip.way is not None, "it is a way"
    lane = streets.lanes[strip.way.start]
    return LitMovement(
        lane.road,
        lane.id,
        heading_of(lane.line[-2:]),
        strip.turn,
        lane.speed_m_s or _SPEED_M_S,
        float(along_of(strip.line)[-1]),
    )
