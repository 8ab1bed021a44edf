"""Links of lanes that lead on to each other: within roads, between roads, and of the connections of junctions.

A link joins an end of a lane to an end of another. Traffic goes over it from the lane that ends there to the one that
begins there. So a connection that names the lane of the other direction does no harm.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping

from coopsim.data.maps.elements import Element
from coopsim.data.maps.notes import Notes
from coopsim.data.maps.opendrive.lanes import Key, Piece
from coopsim.data.maps.opendrive.roads import End, Road
from coopsim.data.maps.street_map import length_of
from coopsim.geometry import exact

_NOTED_M, _APART_M, _LEAST_M, _MOST_PAIRS = 1.0, 5.0, 0.1, 64
_ENDS: tuple[End, End] = ("start", "end")


class Links:
    """Links between pieces of driven lanes.

    Attributes:
        after: pieces that each leads on to, in order.
        before: pieces that lead to each.
    """

    def __init__(self, roads: Mapping[str, Road], notes: Notes) -> None:
        self._roads, self._notes = roads, notes
        self.after: dict[Key, dict[Key, None]] = {}
        self.before: dict[Key, dict[Key, None]] = {}
        self.pieces = {
            piece.key: piece
            for road in roads.values()
            for section in road.lanes.sections
            for piece in section.pieces.values()
            if piece.is_driven
        }
        for road in roads.values():
            self._within(road)
            for end in road.neighbours:
                self._between(road, end)

    def add_connection(self, connection: Element, junction: str, *, direct: bool) -> None:
        """Add the links of a junction's `<connection>`."""
        incoming = self._roads.get(connection.get("incomingRoad"))
        other = self._roads.get(connection.get("linkedRoad" if direct else "connectingRoad"))
        where = f"junction {junction}, line {connection.line}"
        if incoming is None or other is None:
            self._notes.repair("connections of roads that do not exist are passed over", where)
            return
        contact = connection.get("contactPoint")
        there = _ENDS[contact == "end"] if contact in _ENDS else other.end_nearest(incoming.ends["end"])
        named = [end for end, each in incoming.neighbours.items() if (each.kind, each.id) == ("junction", junction)]
        here = named[0] if len(named) == 1 else incoming.end_nearest(other.ends[there])
        for link in connection.all("laneLink"):
            self._link(incoming, here, link.lane_number("from"), other, there, link.lane_number("to"), where)

    def contract(self) -> None:
        """Take out pieces that are too short to be lanes: what leads to them leads on to what they lead to."""
        for key, piece in list(self.pieces.items()):
            before, after = self.before.get(key, {}), self.after.get(key, {})
            if length_of(piece.line) >= _LEAST_M or not before or not after or len(before) * len(after) > _MOST_PAIRS:
                continue
            for first in list(before):
                del self.after[first][key]
                for second in after:
                    self._connect(first, second)
            for second in list(after):
                del self.before[second][key]
            del self.pieces[key], self.before[key], self.after[key]
            self._notes.repair(f"lanes shorter than {_LEAST_M:g} m are joined to the next one", piece.name)

    def _within(self, road: Road) -> None:
        sections = [(index, each) for index, each in enumerate(road.lanes.sections) if each.numbers]
        for (_, first), (_, second) in itertools.pairwise(sections):
            for number, piece in first.pieces.items():
                for other in piece.after:
                    self._join(piece, "end", second.pieces.get(other), "start")
                    self._note_missing(other, second.numbers, f"lane {number} of road {road.id}")
            for number, piece in second.pieces.items():
                for other in piece.before:
                    self._join(piece, "start", first.pieces.get(other), "end")
                    self._note_missing(other, first.numbers, f"lane {number} of road {road.id}")

    def _between(self, road: Road, end: End) -> None:
        neighbour = road.neighbours[end]
        found = road.section_at(end)
        if neighbour.kind == "junction" or found is None:
            return
        other = self._roads.get(neighbour.id)
        if other is None:
            self._notes.repair("links to roads that do not exist are passed over", f"road {road.id}")
            return
        there = neighbour.end
        if there is None:
            self._notes.repair("links without contactPoint go to the nearer end", f"road {road.id}")
            there = other.end_nearest(road.ends[end])
        for number, piece in found[1].pieces.items():
            for to in piece.before if end == "start" else piece.after:
                self._link(road, end, number, other, there, to, f"lane {number} of road {road.id}")

    def _link(self, road: Road, end: End, number: int, other: Road, there: End, to: int, where: str) -> None:
        here, beyond = road.section_at(end), other.section_at(there)
        if here is None or beyond is None:
            return
        self._note_missing(number, here[1].numbers, where)
        self._note_missing(to, beyond[1].numbers, where)
        self._join(here[1].pieces.get(number), end, beyond[1].pieces.get(to), there)

    def _note_missing(self, number: int, numbers: frozenset[int], where: str) -> None:
        if number not in numbers and number != 0:
            self._notes.repair("links to lanes that do not exist are passed over", where)

    def _join(self, piece: Piece | None, end: End, other: Piece | None, there: End) -> None:
        """Link an end of a piece with an end of another, in the direction of travel."""
        if piece is None or other is None or not (piece.is_driven and other.is_driven):
            return
        leaves, enters = piece.along == (end == "end"), other.along == (there == "start")
        if leaves != enters:
            self._notes.repair("links of lanes that both begin or both end there are passed over", piece.name)
            return
        first, second = (piece, other) if leaves else (other, piece)
        if second.key in self.after.get(first.key, {}):
            return
        gap_m = float(exact.norm(second.line[0] - first.line[-1]))
        if gap_m > _APART_M:
            self._notes.repair(f"links of lanes that lie more than {_APART_M:g} m apart are passed over", first.name)
            return
        if gap_m > _NOTED_M:
            self._notes.repair(f"links of lanes that lie more than {_NOTED_M:g} m apart stay", first.name)
        self._connect(first.key, second.key)

    def _connect(self, first: Key, second: Key) -> None:
        if first != second:
            self.after.setdefault(first, {})[second] = None
            self.before.setdefault(second, {})[first] = None
