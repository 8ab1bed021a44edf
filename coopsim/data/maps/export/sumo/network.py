"""A drawn town as a network of SUMO: plain XML with all lines, of which `netconvert` makes junctions and requests."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
from scipy.spatial import ConvexHull

from coopsim.data.maps.export.bodies import bodies_of
from coopsim.data.maps.export.map_format import MAP_FORMATS, require_suffix
from coopsim.data.maps.export.parking_strips import parking_strips
from coopsim.data.maps.export.sumo.netconvert import make_network
from coopsim.data.maps.export.sumo.street_edges import WALK_M, Break, StreetEdges, breaks_of
from coopsim.data.maps.export.town_network import LaneEnd, Ring, TownNetwork, Way
from coopsim.data.maps.export.xml_parts import document, put, shape_text, text_of
from coopsim.geometry import exact
from coopsim.geometry.se3 import Floats
from coopsim.world.towns.plan import LANE_M

_TYPES = {"priority": "priority", "equal": "allway_stop", "roundabout": "priority"}
_AT_JUNCTION_M = 12.0  # crosswalks this far from the ends of a street are those of the junction
_TO_WALK_M = LANE_M / 2 + 2.6


_SUFFIX = ".net.xml"


@MAP_FORMATS.register("sumo")
def sumo_files(town: TownNetwork, path: Path) -> dict[Path, str]:
    """Write a network of SUMO (`.net.xml`), and polygons beside it (`.poly.xml`)."""
    require_suffix(path, _SUFFIX)
    network = make_network(plain_files(town), left_hand=town.inner_left < 0)
    return {path: network, path.with_name(path.name.removesuffix(_SUFFIX) + ".poly.xml"): polygons_text(town)}


def plain_files(town: TownNetwork) -> dict[str, str]:
    """Return the texts of plain XML by netconvert's options: nodes, edges, connections and programs of lights."""
    return _Plain(town).files()


_POLYGONS = {"building": "building", "barrier": "barrier", "vegetation": "barrier", "railing": "barrier"}


def polygons_text(town: TownNetwork) -> str:
    """Return the file of polygons: houses, walls, hedges and fences, and parking bays."""
    root = ElementTree.Element("additional")
    for number, body in enumerate(bodies_of(town.description)):
        kind = {**_POLYGONS, "parkingSpace": "amenity.parking"}.get(body.kind)
        if kind is None:
            continue
        line = np.vstack([body.line, body.line[:1]]) if body.closed else body.line
        color = {"building": "178,178,172", "barrier": "120,140,110"}.get(kind, "205,205,210")
        poly = put(
            root, "poly", id=f"{kind}{number}", type=kind, color=color, fill=body.closed, layer=0,
            shape=shape_text(line),
        )  # fmt: skip
        if body.height_m:
            put(poly, "param", key="height", value=body.height_m)
    return document(root)


class _Plain:
    """Files that are being written."""

    def __init__(self, town: TownNetwork) -> None:
        self.town = town
        crosswalks = self._crosswalks()
        strips = parking_strips(town.plan)
        self.streets = {
            f"s{street.number}": StreetEdges(
                town,
                street,
                breaks_of(street, crosswalks.get((street.number, "middle"), [])),
                {forwards: strips[street.number, forwards] for forwards in (True, False)},
            )
            for street in town.plan.streets
        }
        self.at_junctions: dict[str, list[tuple[int, StreetEdges, int]]] = {}
        for (number, part), found in crosswalks.items():
            if part != "middle":
                edges, run = self.streets[f"s{number}"], 0 if part == "begin" else -1
                self.at_junctions.setdefault(edges.ends()[run], []).extend((each, edges, run) for each, _ in found)
        names = {"node": "nodes", "edge": "edges", "connection": "connections", "tllogic": "tlLogics"}
        self.roots = {name: ElementTree.Element(tag) for name, tag in names.items()}
        self.lights = {
            tuple(road): (f"lights{number}", k)
            for number, signal in enumerate(town.description.signals)
            for k, road in enumerate(signal.roads)
        }

    def files(self) -> dict[str, str]:
        """Return the files."""
        for edges in self.streets.values():
            self._put_street(edges)
        self._put_rings()
        for name, ways in self.town.junctions.items():
            self._put_junction(name, ways)
        self._put_programs()
        return {f"{name}-files": document(root) for name, root in self.roots.items()}

    def _put_street(self, edges: StreetEdges) -> None:
        """Add the edges of a street, and the junctions between them."""
        ends, speed_m_s = edges.ends(), edges.street.speed_m_s
        for run, (low, high) in enumerate(edges.runs):
            for forwards, order in ((True, 1), (False, -1)):
                start, end = ends[run : run + 2][::order]
                begin_m, end_m = (low, high)[::order]
                lines = [
                    edges.line(forwards, (begin_m, lane), (end_m, lane)) for lane in reversed(range(edges.lanes(run)))
                ]
                walk = edges.walk(forwards, begin_m, end_m)
                self._put_edge(edges.edge(run, forwards), (start, end), speed_m_s, walk, lines)
        for number, each in enumerate(edges.breaks):
            self._put_break(edges, number, each, ends[number + 1])

    def _put_edge(
        self, name: str, ends: tuple[str, str], speed_m_s: float, walk: Floats, lines: Sequence[Floats]
    ) -> None:
        """Add an edge: a lane for people, then those for vehicles, the inner one last."""
        edge = put(
            self.roots["edge"], "edge", {"id": name, "from": ends[0], "to": ends[1]}, numLanes=1 + len(lines),
            speed=speed_m_s, shape=shape_text(lines[-1]), spreadType="center",
        )  # fmt: skip
        put(edge, "lane", index=0, allow="pedestrian", width=WALK_M, shape=shape_text(walk))
        for index, line in enumerate(lines):
            put(edge, "lane", index=index + 1, disallow="pedestrian", width=LANE_M, shape=shape_text(line))

    def _put_break(self, edges: StreetEdges, number: int, each: Break, name: str) -> None:
        """Add a junction within a street."""
        lines = list[Floats]()
        for forwards, order in ((True, 1), (False, -1)):
            runs, (begin_m, end_m) = (number, number + 1)[::order], (each.begin_m, each.end_m)[::order]
            names, counts = [edges.edge(run, forwards) for run in runs], [edges.lanes(run) for run in runs]
            last = [(counts[0] - 1, counts[1] - 1)] if counts[0] != counts[1] else []
            for start, end in [*((lane, lane) for lane in range(min(counts))), *last]:
                lines.append(edges.line(forwards, (begin_m, start), (end_m, end)))
                ways = (names[0], counts[0] - start), (names[1], counts[1] - end)
                self._connect(*ways, lines[-1], edges.street.speed_m_s)
        self._put_node(name, "priority" if each.crosswalk is not None else "zipper", lines)
        if each.crosswalk is not None:
            self._put_crossing(name, each.crosswalk, edges, number)

    def _put_rings(self) -> None:
        """Add the rings of roundabouts."""
        groups: dict[str, list[Ring]] = {}
        for ring in self.town.rings:
            stations, aside_m = ring.lane.stations(1.0), -self.town.inner_left * _TO_WALK_M
            walk, line = (ring.lane.positions(stations, aside) for aside in (aside_m, 0.0))
            self._put_edge(ring.name, (ring.start, ring.end), ring.lane.speed_limit, walk, [line])
            groups.setdefault(ring.start.partition("a")[0], []).append(ring)
        for rings in groups.values():
            names = {"nodes": " ".join(ring.start for ring in rings), "edges": " ".join(ring.name for ring in rings)}
            put(self.roots["edge"], "roundabout", names)

    def _put_junction(self, name: str, ways: Sequence[Way]) -> None:
        """Add a junction, its ways, who goes first, and its crosswalks."""
        lines = [way.line for way in ways]
        for way, line in zip(ways, lines, strict=True):
            start, end = self._place_of(way.start, leaves=True), self._place_of(way.end, leaves=False)
            self._connect(start, end, line, way.lanes[0].speed_limit)
            if way.road in self.lights:
                program, link = self.lights[way.road]
                put(self.roots["tllogic"], "connection", _connection(start, end), tl=program, linkIndex=link)
        lit = [self.lights[way.road][0] for way in ways if way.road in self.lights]
        number = name.partition("a")[0]
        kind = _TYPES[self.town.plan.junctions[int(number[1:])].kind] if number[0] == "j" else "priority"
        self._put_node(name, "traffic_light" if lit else kind, lines, lit[0] if lit else None)
        for first, other in () if lit else self.town.first_ways(name):
            pair = {f"prohibit{end}": self._movement(way) for end, way in (("or", first), ("ed", other))}
            put(self.roots["connection"], "prohibition", pair)
        for crosswalk, edges, run in self.at_junctions.get(name, ()):
            self._put_crossing(name, crosswalk, edges, run)

    def _movement(self, way: Way) -> str:
        ends = self._place_of(way.start, leaves=True), self._place_of(way.end, leaves=False)
        return "->".join(edge for edge, _ in ends)

    def _place_of(self, lane: LaneEnd, *, leaves: bool) -> tuple[str, int]:
        """Return the edge and lane where a way leaves a lane or comes to it."""
        return self.streets[lane.road].place_of(lane, leaves=leaves) if lane.road in self.streets else (lane.road, 1)

    def _connect(self, start: tuple[str, int], end: tuple[str, int], line: Floats, speed_m_s: float) -> None:
        more = {"shape": shape_text(line), "speed": speed_m_s}
        put(self.roots["connection"], "connection", _connection(start, end) | more)

    def _put_node(self, name: str, kind: str, lines: Sequence[Floats], program: str | None = None) -> None:
        """Add a junction around lines (K, 2) m of its ways."""
        edges = np.concatenate([edge for line in lines for edge in _edges(line)])
        outline = edges[ConvexHull(edges).vertices]
        x, y = outline.mean(axis=0).round(3).tolist()
        put(self.roots["node"], "node", id=name, x=x, y=y, type=kind, tl=program, shape=shape_text(outline))

    def _put_crossing(self, node: str, number: int, edges: StreetEdges, run: int) -> None:
        """Add a crosswalk over the edges of a run; netconvert puts it at their stop line.

        With the place of the town's crosswalk, up to 4 m behind the line, vehicles of SUMO ran into people.
        """
        walks, signals = self.town.description.walks, self.town.description.signals
        names = frozenset(walks.crosswalks[number] if walks is not None else ())
        links = {
            frozenset(pair): len(signal.roads) + k for signal in signals for k, pair in enumerate(signal.crosswalks)
        }
        crossed = " ".join(edges.edge(run % len(edges.runs), forwards) for forwards in (True, False))
        more = {"width": WALK_M, "priority": True, "linkIndex": links.get(names)}
        put(self.roots["connection"], "crossing", more, node=node, edges=crossed)

    def _put_programs(self) -> None:
        """Add the programs of lights, before what says where they hold."""
        for number, signal in reversed(list(enumerate(self.town.description.signals))):
            name = {"id": f"lights{number}", "type": "static", "programID": "0", "offset": signal.offset_s}
            program = ElementTree.Element("tlLogic")
            for key, value in name.items():
                program.set(key, text_of(value))
            for phase in signal.phases:
                put(program, "phase", duration=phase.seconds, state=phase.state)
            self.roots["tllogic"].insert(0, program)

    def _crosswalks(self) -> dict[tuple[int, str], list[tuple[int, float]]]:
        """Return numbers and places along the street of crosswalks, by street and part: begin, middle or end."""
        walks, found = self.town.description.walks, dict[tuple[int, str], list[tuple[int, float]]]()
        along = {street.number: np.arange(0.0, street.length_m, 0.25) for street in self.town.plan.streets}
        lines = {number: self.town.place(self.town.plan.streets[number].position(at)) for number, at in along.items()}
        for number, names in enumerate(walks.crosswalks if walks is not None else ()):
            assert walks is not None
            middle = np.mean([walks.nodes[name] for name in names], axis=0)
            away = {street: exact.norm(line - middle, axis=1) for street, line in lines.items()}
            street = min(away, key=lambda each: float(away[each].min()))
            at = float(along[street][int(away[street].argmin())])
            low, high = self.town.plan.streets[street].span_m
            part = "begin" if at < low + _AT_JUNCTION_M else "end" if at > high - _AT_JUNCTION_M else "middle"
            found.setdefault((street, part), []).append((number, at))
        return found


def _edges(line: Floats) -> tuple[Floats, Floats]:
    """Return the edges (K, 2) m of a lane along a line (K, 2) m."""
    ahead = np.gradient(line, axis=0)
    ahead /= exact.norm(ahead, axis=1)[:, None]
    aside = LANE_M / 2 * np.column_stack([-ahead[:, 1], ahead[:, 0]])
    return line + aside, line - aside


def _connection(start: tuple[str, int], end: tuple[str, int]) -> dict[str, object]:
    return {"from": start[0], "to": end[0], "fromLane": start[1], "toLane": end[1]}
