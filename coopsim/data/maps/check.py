"""Check a map, and say what is in it: can each lane be reached and left?"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from coopsim.data.maps.street_map import DRIVEN, StreetLane, StreetMap

_SHOWN = 5


@dataclass(frozen=True, slots=True)
class MapCheck:
    """Connections of the driven lanes of a map; a change to a lane beside counts as a way.

    Attributes:
        unreached: lanes that no lane leads to.
        unleft: lanes that lead to no lane.
        joined: lanes of the largest part in which each can be reached from each other.
        lanes: all driven lanes outside junctions.
    """

    unreached: tuple[str, ...]
    unleft: tuple[str, ...]
    joined: tuple[str, ...]
    lanes: tuple[str, ...]


def driven_lanes(streets: StreetMap) -> list[StreetLane]:
    """Return the lanes on which vehicles drive, outside junctions."""
    return [lane for lane in streets.lanes.values() if lane.kind in DRIVEN]


def check_map(streets: StreetMap) -> MapCheck:
    """Check which lanes can be reached and left."""
    lanes = driven_lanes(streets)
    place = {lane.id: index for index, lane in enumerate(lanes)}
    moves = {(start, end) for start, after in streets.links.items() for end in after}
    moves |= {(way.start, way.end) for way in streets.ways.values()}
    moves |= {(lane.id, side) for lane in lanes for side in (lane.left, lane.right) if side is not None}
    pairs = np.array([(place[start], place[end]) for start, end in sorted(moves)], dtype=np.int64).reshape(-1, 2)
    size = len(lanes)
    names = tuple(lane.id for lane in lanes)
    if not size:
        return MapCheck((), (), (), ())
    graph = coo_matrix((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(size, size))
    _, part = connected_components(graph, directed=True, connection="strong")
    largest = np.argmax(np.bincount(part))
    reached, left = (np.bincount(pairs[:, side], minlength=size) > 0 for side in (1, 0))
    unreached, unleft, joined = (
        tuple(name for name, is_chosen in zip(names, chosen.tolist(), strict=True) if is_chosen)
        for chosen in (~reached, ~left, part == largest)
    )
    return MapCheck(unreached, unleft, joined, names)


def describe_map(streets: StreetMap) -> Iterator[str]:
    """Yield what is in a map, what was repaired and left out, and how its lanes hang together: a line each."""
    yield f"{streets.source}: {streets.format}, {'left' if streets.left_hand else 'right'}-hand traffic"
    driven, check = driven_lanes(streets), check_map(streets)
    kinds = Counter[str](lane.kind for lane in streets.lanes.values() if lane.kind not in DRIVEN)
    lengths = sum(lane.length_m for lane in driven), sum(way.length_m for way in streets.ways.values())
    yield f"lanes: {len(driven)} driven, {lengths[0] / 1e3:.2f} km; others: {_counts(kinds)}"
    turns = Counter[str](way.turn for way in streets.ways.values())
    yield f"junctions: {len(streets.junctions)}, ways over them: {len(streets.ways)}, {lengths[1] / 1e3:.2f} km; " + (
        _counts(turns)
    )
    yield f"signals: {_counts(Counter[str](each.kind for each in streets.signals))}; programs: {len(streets.programs)}"
    yield f"crossings: {len(streets.crossings)}; areas: {_counts(Counter[str](each.kind for each in streets.areas))}"
    yield f"solids: {_counts(Counter[str](each.kind for each in streets.solids))}"
    yield f"left out: {_counts(Counter(streets.left_out))}"
    yield from (f"repaired: {line}" for line in streets.repaired)
    if not streets.repaired:
        yield "repaired: nothing"
    yield f"lanes that no lane leads to: {_named(check.unreached)}"
    yield f"lanes that lead to no lane: {_named(check.unleft)}"
    share = sum(streets.lanes[name].length_m for name in check.joined) / max(lengths[0], 1e-9)
    yield f"each can be reached from each other: {len(check.joined)} lanes, {100 * share:.0f} % of the length"


def _counts(counter: Counter[str]) -> str:
    return ", ".join(f"{count} {name}" for name, count in sorted(counter.items())) or "none"


def _named(names: Sequence[str]) -> str:
    more = ", ..." if len(names) > _SHOWN else ""
    return f"{len(names)} ({', '.join(names[:_SHOWN])}{more})" if names else "none"
