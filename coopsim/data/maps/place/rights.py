"""Right of way at a map's junctions: what the file says, else rules."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from coopsim.data.maps.place.lines import turn_rad
from coopsim.data.maps.place.strips import Strip
from coopsim.data.maps.street_map import StreetJunction, StreetMap

_SIGN_M = 40.0  # a sign this far before a junction holds at it
_OPPOSITE_RAD = np.radians(135.0)


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
