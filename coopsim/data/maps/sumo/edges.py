"""Edges of SUMO's networks: lanes by what may use them, crossings, and ground for people."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from coopsim.data.maps.elements import Element
from coopsim.data.maps.notes import Notes
from coopsim.data.maps.street_map import DRIVEN, LaneKind, StreetArea, StreetLane
from coopsim.geometry import exact
from coopsim.geometry.se3 import Floats

_CLASSES = frozenset(
    [
        "private",
        "emergency",
        "authority",
        "army",
        "vip",
        "pedestrian",
        "passenger",
        "hov",
        "taxi",
        "bus",
        "coach",
        "delivery",
        "truck",
        "trailer",
        "motorcycle",
        "moped",
        "bicycle",
        "scooter",
        "evehicle",
        "tram",
        "rail_urban",
        "rail",
        "rail_electric",
        "rail_fast",
        "subway",
        "cable_car",
        "wheelchair",
        "container",
        "drone",
        "aircraft",
        "ship",
        "custom1",
        "custom2",
    ]
)
_FOR: tuple[tuple[LaneKind, frozenset[str]], ...] = (
    ("drive", frozenset({"passenger"})),
    ("bus", frozenset({"bus", "coach", "taxi", "delivery", "truck"})),
    ("rail", frozenset({"tram", "rail_urban", "rail", "rail_electric", "rail_fast", "subway"})),
    ("walk", frozenset({"pedestrian"})),
    ("cycle", frozenset({"bicycle"})),
)
"""What a lane is for: the first whose classes may use it."""
_WIDTH_M, _WIDEST_M, _LEAST_M = 3.2, 200.0, 0.01


@dataclass(slots=True, eq=False)
class Edge:
    """An edge: where it leads, and its lanes by index."""

    id: str
    function: str
    to: str
    lanes: dict[int, StreetLane]
    crosses: tuple[str, ...] = ()


@dataclass(slots=True)
class Edges:
    """Edges by id, and ground for people."""

    notes: Notes
    left_hand: bool
    edges: dict[str, Edge] = field(default_factory=dict)
    areas: list[StreetArea] = field(default_factory=list)

    def add(self, element: Element) -> None:
        """Read an `<edge>`."""
        name, function = element.need("id"), element.get("function", "normal") or "normal"
        if name in self.edges:
            self.notes.repair("edges with the id of another one are left out", f"edge {name}")
            return
        if function == "connector":
            self.notes.left_out["edges of function connector"] += 1
            return
        if function == "walkingarea":
            self._add_areas(element)
            return
        crosses = tuple(element.get("crossingEdges").split())
        edge = self.edges[name] = Edge(name, function, element.get("to"), {}, crosses)
        for each in element.all("lane"):
            lane = self._lane(each, name, function)
            if lane is not None:
                edge.lanes[each.lane_number("index")] = lane
        if not edge.lanes and function == "normal":
            self.notes.repair("edges without lanes lead nowhere", f"edge {name}")

    def side_lanes(self, lane: StreetLane, index: int) -> tuple[str | None, str | None]:
        """Return the lanes on the left and right of a driven lane, by id."""
        lanes = self.edges[lane.road].lanes
        up, down = (
            other.id if (other := lanes.get(index + step)) is not None and other.kind in DRIVEN else None
            for step in (1, -1)
        )
        return (down, up) if self.left_hand else (up, down)

    def _add_areas(self, element: Element) -> None:
        for lane in element.all("lane"):
            outline = lane.shape()[:, :2]
            self.notes.take_points(len(outline), lane)
            if len(outline) < 3:
                self.notes.repair("walking areas with fewer than three corners are left out", lane.get("id"))
            else:
                self.areas.append(StreetArea(lane.need("id"), "walk", outline))

    def _lane(self, element: Element, edge: str, function: str) -> StreetLane | None:
        """Return a lane; None, with a note, where it has no length or width."""
        name, width_m = element.need("id"), element.number("width", _WIDTH_M)
        shape = element.shape()
        self.notes.take_points(len(shape), element)
        line = shape[np.concatenate([[True], exact.norm(np.diff(shape, axis=0)) > _LEAST_M])]
        if len(line) < 2:
            if function == "normal":  # in junctions SUMO has some, and ways do without them
                self.notes.repair("lanes without length are left out", f"lane {name}")
            return None
        if not 0.0 < width_m <= _WIDEST_M:
            if width_m > _WIDEST_M:
                raise element.error(f"width must be in (0, {_WIDEST_M:g}] m, got {width_m:g}")
            if width_m <= 0.0 and width_m != -1.0:
                self.notes.repair("lanes without width are left out", f"lane {name}")
                return None
            width_m = _WIDTH_M  # -1 is SUMO's word for the usual width
        speed = element.number("speed", 0.0)
        kind: LaneKind = "walk" if function == "crossing" else _kind(element)
        limit = speed if speed > 0.0 else None
        return StreetLane(name, edge, kind, line, np.full(len(line), width_m), limit)


def _kind(element: Element) -> LaneKind:
    allow, disallow = (frozenset(element.get(name).split()) for name in ("allow", "disallow"))
    if not allow or "all" in allow:
        allow = _CLASSES
    users = frozenset() if "all" in disallow else allow - disallow
    return next((kind for kind, classes in _FOR if users & classes), "other")


def reversed_rows(text: str) -> list[int]:
    """Return the indices of ones in a row of bits, which SUMO writes from the right."""
    return [index for index, bit in enumerate(reversed(text)) if bit == "1"]


def line_between(first: Floats, second: Floats) -> Floats:
    """Return the straight line (2, 3) from the end of a line to the start of another."""
    return np.stack([first[-1], second[0]])
