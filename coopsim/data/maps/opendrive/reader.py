"""The reader of OpenDRIVE: one road after the other, then what links them."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from pathlib import Path

from coopsim.data.maps.elements import Element
from coopsim.data.maps.notes import Notes
from coopsim.data.maps.opendrive.links import Links
from coopsim.data.maps.opendrive.objects import Objects
from coopsim.data.maps.opendrive.roads import Road
from coopsim.data.maps.opendrive.signals import Signals
from coopsim.data.maps.street_map import StreetCrossing, StreetJunction, StreetLane, StreetMap
from coopsim.data.maps.ways import find_ways

_VERSIONS = range(4, 9)
_LOOSE = ("junctionGroup", "station")


class _Reading:
    """A file that is being read."""

    def __init__(self, path: Path, root: Element) -> None:
        self.path, self.root = path, root
        self.notes = Notes()
        self.roads: dict[str, Road] = {}
        self.signals, self.objects = Signals(self.notes), Objects(self.notes)
        self.junctions: dict[str, Element] = {}
        self.controllers: list[Element] = []
        self.header: Element | None = None

    def add(self, element: Element) -> None:
        """Read a child of the root."""
        if element.tag == "road":
            self._add_road(element)
        elif element.tag == "junction":
            self.junctions.setdefault(element.need("id"), element)
        elif element.tag == "controller":
            self.controllers.append(element)
        elif element.tag == "header":
            self.header = element
        elif element.tag in _LOOSE:
            self.notes.left_out[f"elements {element.tag}"] += 1

    def _add_road(self, element: Element) -> None:
        name = element.need("id")
        if name in self.roads:
            self.notes.repair("roads with the id of another one are left out", f"road {name}")
            return
        if not element.at_path("lanes", "laneSection"):
            self.notes.repair("roads without lanes are left out", f"road {name}")
            return
        road = self.roads[name] = Road.read(element, self.notes)
        self.signals.read(element, road)
        self.objects.read(element, road)

    def finish(self) -> StreetMap:
        """Return the map, once all is read."""
        if not self.roads:
            raise self.root.error("must have a <road> with lanes")
        self._check_junctions()
        links = Links(self.roads, self.notes)
        self._connect(links)
        links.contract()
        inside = {key: name for key in links.pieces if (name := self.roads[key[0]].junction) is not None}
        ways, chains = find_ways(links.pieces, links.after, inside, self.signals.lights(), self.notes)
        lanes = self._lanes(links)
        leads = {
            lanes[key].id: tuple(lanes[after].id for after in links.after.get(key, ()) if after in lanes)
            for key in links.pieces.keys() & lanes.keys()
        }
        header = self.header
        sides = {road.left_hand for road in self.roads.values()}
        if len(sides) > 1:
            self.notes.repair("roads of both rules, RHT and LHT, keep their own", self.path.name)
        return StreetMap(
            source=str(self.path),
            format=self._format(),
            lanes={lane.id: lane for lane in lanes.values()},
            links={lane.id: leads[lane.id] for key, lane in lanes.items() if leads.get(lane.id)},
            ways=ways,
            junctions={name: self._junction(each, chains) for name, each in self.junctions.items()},
            signals=self.signals.all(self.controllers, {key: lane.id for key, lane in lanes.items()}),
            crossings=(*self.objects.crossings, *self._cross_paths()),
            areas=tuple(self.objects.areas),
            solids=tuple(self.objects.solids),
            left_hand=sum(road.left_hand for road in self.roads.values()) * 2 > len(self.roads),
            offset_m=self._offset(),
            projection=" ".join(each.text.strip() for each in header.all("geoReference")) if header else "",
            repaired=self.notes.repaired,
            left_out={what: count for what, count in sorted(self.notes.left_out.items()) if count},
        )

    def _check_junctions(self) -> None:
        """Take roads out of junctions that do not exist, or that leave their main road as it is."""
        for name, road in self.roads.items():
            junction = self.junctions.get(road.junction) if road.junction is not None else None
            if road.junction is not None and junction is None:
                self.notes.repair("roads of junctions that do not exist are taken as outside", f"road {name}")
            if junction is None or junction.get("type") == "virtual":
                self.roads[name] = dataclasses.replace(road, junction=None)

    def _connect(self, links: Links) -> None:
        for name, junction in self.junctions.items():
            for connection in junction.all("connection"):
                if "virtual" in (junction.get("type"), connection.get("type")):
                    self.notes.left_out["connections of virtual junctions"] += 1
                else:
                    links.add_connection(connection, name, direct=junction.get("type") == "direct")

    def _lanes(self, links: Links) -> dict[tuple[str, int, int], StreetLane]:
        """Return the lanes that are no parts of ways, by the names of their pieces."""
        found = {}
        for road in self.roads.values():
            lefts, rights = road.lanes.lefts, road.lanes.rights
            for section in road.lanes.sections:
                for key, piece in ((each.key, each) for each in section.pieces.values()):
                    if piece.is_driven and (road.junction is not None or key not in links.pieces):
                        continue
                    left, right = (
                        links.pieces[side[key]].name if side.get(key) in links.pieces else None
                        for side in (lefts, rights)
                    )
                    found[key] = StreetLane(
                        piece.name, road.id, piece.kind, piece.line, piece.width_m, piece.speed_m_s, left, right,
                        road.junction,
                    )  # fmt: skip
        return found

    def _junction(self, element: Element, chains: dict[str, tuple[tuple[str, int, int], ...]]) -> StreetJunction:
        """Return a junction; of roads with a priority, the ways over one yield to those over the other."""
        pairs = [(each.get("low"), each.get("high")) for each in element.all("priority")]
        over: dict[str, list[str]] = {}
        for way, chain in chains.items() if pairs else ():
            for road in dict.fromkeys(key[0] for key in chain[1:-1]):
                over.setdefault(road, []).append(way)
        yields = {(one, two) for low, high in pairs for one in over.get(low, ()) for two in over.get(high, ())}
        return StreetJunction(element.need("id"), element.get("type") or "default", yields=frozenset(yields) or None)

    def _cross_paths(self) -> Iterator[StreetCrossing]:
        """Yield the crossings that junctions name, whose roads have lanes to walk on (1.8)."""
        for name, junction in self.junctions.items():
            for path in junction.all("crossPath"):
                road = self.roads.get(path.get("crossingRoad"))
                pieces = [piece for section in (road.lanes.sections if road else ())
                          for piece in section.pieces.values() if piece.kind in ("walk", "cycle")]  # fmt: skip
                if not pieces:
                    self.notes.repair("crossings without a road to walk on are passed over", f"junction {name}")
                for piece in pieces[:1]:
                    yield StreetCrossing(f"{name}.{path.get('id')}", piece.line, float(piece.width_m.max()))

    def _format(self) -> str:
        if self.header is None:
            self.notes.repair("the file has no <header>: it is taken as OpenDRIVE 1.4", self.path.name)
            return "OpenDRIVE 1.4"
        major, minor = (self.header.lane_number(name) for name in ("revMajor", "revMinor"))
        if major != 1 or minor not in _VERSIONS:
            self.notes.repair("versions other than OpenDRIVE 1.4 to 1.8 are read as if they were", f"{major}.{minor}")
        return f"OpenDRIVE {major}.{minor}"

    def _offset(self) -> tuple[float, float, float]:
        """Return what the header adds to coordinates."""
        for each in self.header.all("offset") if self.header is not None else ():
            if each.number("hdg", 0.0):
                self.notes.left_out["headings of the header's offset"] += 1
            return each.number("x", 0.0), each.number("y", 0.0), each.number("z", 0.0)
        return 0.0, 0.0, 0.0


def read_opendrive(path: Path, root: Element, elements: Iterator[Element]) -> StreetMap:
    """Read the rest of an OpenDRIVE file whose root has been read."""
    reading = _Reading(path, root)
    for element in elements:
        reading.add(element)
    return reading.finish()
