"""The reader of SUMO's networks (`.net.xml`): everything in them is explicit, and is taken as it is."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from coopsim.data.maps.elements import Element
from coopsim.data.maps.notes import Notes
from coopsim.data.maps.street_map import (
    DRIVEN,
    Pairs,
    SignalProgram,
    StreetCrossing,
    StreetJunction,
    StreetLane,
    StreetMap,
    StreetWay,
    Turn,
)
from coopsim.data.maps.sumo.edges import Edges, line_between, reversed_rows
from coopsim.data.maps.turns import joined, turn_of
from coopsim.geometry import exact

_TURNS: dict[str, Turn] = {
    "s": "straight", "l": "left", "L": "left", "r": "right", "R": "right", "t": "around", "T": "around",
}  # fmt: skip
_MOST_PARTS, _TOUCH_M = 16, 0.1


class _Network:
    """A network that is being read."""

    def __init__(self, path: Path, root: Element) -> None:
        self.path, self.root, self.notes = path, root, Notes()
        self.edges = Edges(self.notes, root.get("lefthand") in ("true", "1"))
        self.connections: list[Element] = []
        self.junctions: dict[str, Element] = {}
        self.programs: dict[str, SignalProgram] = {}
        self.location: Element | None = None
        self.parts: dict[str, tuple[str, ...]] = {}

    def add(self, element: Element) -> None:
        """Read a child of the root."""
        if element.tag == "edge":
            self.edges.add(element)
        elif element.tag == "connection":
            self.connections.append(element)
        elif element.tag == "junction":
            self.junctions.setdefault(element.need("id"), element)
        elif element.tag == "tlLogic":
            self._add_program(element)
        elif element.tag == "location":
            self.location = element
        elif element.tag in ("roundabout", "prohibition"):
            self.notes.left_out[f"elements {element.tag}"] += 1

    def _add_program(self, element: Element) -> None:
        name = element.need("id")
        if name in self.programs:
            self.notes.left_out["further signal programs of a junction"] += 1
            return
        phases = tuple((each.number("duration"), each.need("state")) for each in element.all("phase"))
        if len({len(state) for _, state in phases}) != 1 or min(duration for duration, _ in phases) < 0.0:
            raise element.error("must have <phase> with a duration >= 0, and states of one length")
        offset = element.number("offset", 0.0)
        self.programs[name] = SignalProgram(name, offset, phases)

    def finish(self) -> StreetMap:
        """Return the map, once all is read."""
        edges = self.edges.edges
        lanes = {}
        for edge in edges.values():
            for index, lane in edge.lanes.items() if edge.function == "normal" else ():
                left, right = self.edges.side_lanes(lane, index) if lane.kind in DRIVEN else (None, None)
                lanes[lane.id] = dataclasses.replace(lane, left=left, right=right)
        if not lanes:
            raise self.root.error("must have an <edge> with a <lane>")
        links, ways = self._connect()
        offset = np.zeros(3)
        if self.location is not None:
            offset[:2] = -self.location.shape("netOffset")[0, :2]
        return StreetMap(
            source=str(self.path),
            format=f"SUMO {self.root.get('version')}".strip(),
            lanes=lanes,
            links={name: tuple(after) for name, after in links.items()},
            ways=ways,
            junctions={
                name: self._junction(each, ways)
                for name, each in self.junctions.items()
                if each.get("type") != "internal"
            },
            programs=self.programs,
            crossings=tuple(self._crossings()),
            areas=tuple(self.edges.areas),
            left_hand=self.edges.left_hand,
            offset_m=(float(offset[0]), float(offset[1]), 0.0),
            projection=self.location.get("projParameter") if self.location is not None else "",
            repaired=self.notes.repaired,
            left_out=dict(sorted(self.notes.left_out.items())),
        )

    def _connect(self) -> tuple[dict[str, list[str]], dict[str, StreetWay]]:
        """Return lanes that lead on to each other without a way, and the ways."""
        inner = {f"{each.get('from')}_{each.get('fromLane')}": each.get("via") for each in self.connections}
        links, ways = dict[str, list[str]](), dict[str, StreetWay]()
        for each in self.connections:
            ends = self._ends(each)
            if ends is None:
                continue
            start, end = ends
            parts = self._parts(each, inner)
            if not parts and float(exact.norm(end.line[0] - start.line[-1])) < _TOUCH_M:
                links.setdefault(start.id, []).append(end.id)
                continue
            way = self._way(each, start, end, parts)
            if way.id in ways:
                self.notes.repair("connections between the same lanes as another one are left out", way.id)
                continue
            ways[way.id] = way
            self.parts[way.id] = tuple(part.id for part in parts)
        return links, ways

    def _ends(self, connection: Element) -> tuple[StreetLane, StreetLane] | None:
        """Return the lanes of a connection; None where they are not driven, are within a junction, or do not exist."""
        found = []
        for name in ("from", "to"):
            edge = self.edges.edges.get(connection.need(name))
            lane = edge.lanes.get(connection.lane_number(f"{name}Lane")) if edge is not None else None
            if edge is not None and edge.function != "normal":
                return None
            if lane is None:
                if not connection.get("from").startswith(":") and not connection.get("to").startswith(":"):
                    where = f"line {connection.line}"
                    self.notes.repair("connections of lanes that do not exist are passed over", where)
                return None
            found.append(lane)
        start, end = found
        return (start, end) if start.kind in DRIVEN and end.kind in DRIVEN else None

    def _parts(self, connection: Element, inner: dict[str, str]) -> list[StreetLane]:
        """Return the lanes within the junction that a connection goes over, in order."""
        parts, via = list[StreetLane](), connection.get("via")
        for _ in range(_MOST_PARTS):
            if not via:
                break
            edge, _, index = via.rpartition("_")
            if edge not in self.edges.edges or not index.isdecimal():
                self.notes.repair("lanes that connections go over, but that do not exist, are passed over", via)
                break
            lane = self.edges.edges[edge].lanes.get(int(index))
            parts += [lane] if lane is not None else []
            via = inner.get(via, "")
        return parts

    def _way(self, connection: Element, start: StreetLane, end: StreetLane, parts: list[StreetLane]) -> StreetWay:
        if parts:
            line, width = joined([(part.line, part.width_m) for part in parts])
        else:
            line, width = line_between(start.line, end.line), np.array([start.width_m[-1], end.width_m[0]])
        limits = [part.speed_m_s for part in parts if part.speed_m_s is not None]
        program, link = self._signal(connection)
        junction = self.edges.edges[start.road].to
        turn = _TURNS.get(connection.get("dir")) or turn_of(line)
        name = f"{start.id}>{end.id}"
        speed = min(limits, default=start.speed_m_s)
        return StreetWay(name, start.id, end.id, junction, line, width, speed, turn, (), program, link)

    def _signal(self, connection: Element) -> tuple[str | None, int]:
        """Return the signal program of a connection, and its place in the states."""
        program = connection.get("tl") or None
        if program is None:
            return None, -1
        link = connection.lane_number("linkIndex")
        if program not in self.programs or not 0 <= link < len(self.programs[program].phases[0][1]):
            self.notes.repair("signals without a program, or without a place in it, are left out", f"tl {program}")
            return None, -1
        return program, link

    def _junction(self, element: Element, ways: dict[str, StreetWay]) -> StreetJunction:
        outline = element.shape()[:, :2] if len(element.get("shape").split()) >= 3 else None
        requests = {each.lane_number("index"): each for each in element.all("request")}
        if not requests:
            return StreetJunction(element.need("id"), element.get("type"), outline)
        inside = {lane: index for index, lane in enumerate(element.get("intLanes").split())}
        over: dict[int, list[str]] = {}
        for way in self._ways_by_junction(ways).get(element.get("id"), ()):
            for index in {inside[part] for part in self.parts[way] if part in inside}:
                over.setdefault(index, []).append(way)
        yields, foes = (self._pairs(requests, over, name) for name in ("response", "foes"))
        return StreetJunction(element.need("id"), element.get("type"), outline, yields, foes)

    def _ways_by_junction(self, ways: dict[str, StreetWay]) -> dict[str, list[str]]:
        if not hasattr(self, "_by_junction"):
            self._by_junction: dict[str, list[str]] = {}
            for way in ways.values():
                self._by_junction.setdefault(way.junction, []).append(way.id)
        return self._by_junction

    @staticmethod
    def _pairs(requests: dict[int, Element], over: dict[int, list[str]], name: str) -> Pairs:
        return frozenset(
            (one, two)
            for index, request in requests.items()
            for other in reversed_rows(request.get(name))
            for one in over.get(index, ())
            for two in over.get(other, ())
            if one != two
        )

    def _crossings(self) -> Iterator[StreetCrossing]:
        signals = {each.get("to"): each for each in self.connections if each.get("tl")}
        for name, edge in self.edges.edges.items():
            for lane in edge.lanes.values() if edge.function == "crossing" else ():
                program, link = self._signal(signals[name]) if name in signals else (None, -1)
                yield StreetCrossing(lane.id, lane.line, float(lane.width_m[0]), edge.crosses, program, link)


def read_network(path: Path, root: Element, elements: Iterator[Element]) -> StreetMap:
    """Read the rest of a network whose root has been read."""
    network = _Network(path, root)
    for element in elements:
        network.add(element)
    return network.finish()
