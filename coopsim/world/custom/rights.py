"""Right of way of a description: who yields to whom, and traffic lights."""

from __future__ import annotations

from collections.abc import Sequence

from coopsim.config.checked_entry import Entry
from coopsim.errors import UnknownNameError
from coopsim.world.custom.roads import Roads
from coopsim.world.places.description import MapSignal
from coopsim.world.places.road_network import Road
from coopsim.world.places.signals import LETTERS, SHORTEST_S, Signal


def add_rights(roads: Roads) -> None:
    """Add `yields` and `signals`, and the movements to which lights belong."""
    roads.signals = tuple(_signal(roads, each, number) for number, each in enumerate(roads.description.signals))
    _require_one_each(roads)
    ends = {road for signal in roads.signals for road in signal.roads} | set(roads.movements)
    roads.movements = tuple(index[:2] for index in roads.network.lanes if index[:2] in ends)
    pieces = {road: [piece for piece in roads.pieces[road] if piece in ends] for road in roads.pieces}
    for road, number in roads.number.items():
        given = roads.description.roads[number].yields
        if given is None:
            continue
        others = [roads.find(names, "roads", number, "yields") for names in given]
        if road in others:
            raise roads.entry(road, "yields").error("a road cannot yield to itself")
        first = tuple(piece for other in others for piece in pieces[other])
        roads.yields |= dict.fromkeys(pieces[road], first)


def _signal(roads: Roads, signal: MapSignal, number: int) -> Signal:
    entry = roads.root.part("signals", number)
    found = tuple(roads.pieces[roads.find(names, "signals", number, "roads")][0] for names in signal.roads)
    crosswalks = tuple(_crosswalk(roads, names, entry.part("crosswalks")) for names in signal.crosswalks)
    if not signal.phases:
        raise entry.part("phases").error("phases must be at least one, got none")
    for k, phase in enumerate(signal.phases):
        here, count = entry.part("phases", k), len(found) + len(crosswalks)
        if phase.seconds < SHORTEST_S:
            raise here.part("seconds").error(f"seconds must be at least {SHORTEST_S:g}, got {phase.seconds:g}")
        if len(phase.state) != count or set(phase.state) - set(LETTERS):
            raise here.part("state").error(
                f"state must be {count} of the letters {', '.join(LETTERS)}, one for each of the roads, then of the "
                f"crosswalks, got {phase.state!r}"
            )
    phases = tuple((float(phase.seconds), phase.state) for phase in signal.phases)
    return Signal(found, crosswalks, phases, float(signal.offset_s))


def _crosswalk(roads: Roads, names: Sequence[str], entry: Entry) -> tuple[int, int]:
    """Return the numbers of the nodes of a crosswalk."""
    walks = roads.description.walks
    nodes = {} if walks is None else {name: k for k, name in enumerate(walks.nodes)}
    for name in names:
        if name not in nodes:
            raise entry.error(str(UnknownNameError("node of walks", name, nodes)))
    if len(names) != 2:
        raise entry.error(f"a crosswalk must be two nodes of walks, got [{', '.join(names)}]")
    return nodes[names[0]], nodes[names[1]]


def _require_one_each(roads: Roads) -> None:
    """Refuse a road with two lights."""
    seen: set[Road] = set()
    for number, signal in enumerate(roads.signals):
        for road in signal.roads:
            if road in seen:
                raise roads.root.part("signals", number, "roads").error(
                    f"a road has one light, got two from {road[0]!r}"
                )
            seen.add(road)
