"""The one form that maps of all formats are read into.

x is east, y north and z up, m, in the file's own plane; angles are counter-clockwise from east. Lines are in the
direction of travel. Nothing here knows a format or a simulation.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

from coopsim.geometry import exact
from coopsim.geometry.se3 import Floats

LaneKind = Literal["drive", "bus", "cycle", "walk", "park", "shoulder", "rail", "shared", "other"]
"""`shared`: vehicles of both directions may use it, as a lane to turn left from in the middle of a road."""

SignalKind = Literal["light", "stop", "yield", "sign"]
SolidKind = Literal["building", "wall", "tree", "pole"]
Turn = Literal["left", "straight", "right", "around"]

DRIVEN: tuple[LaneKind, ...] = ("drive", "bus")
"""Kinds of lanes that are linked, and have ways over junctions."""


def length_of(line: Floats) -> float:
    """Return the length, m, of a line (K, 3) in the plane."""
    return float(exact.norm(line[1:, :2] - line[:-1, :2]).sum())


@dataclass(frozen=True, slots=True, eq=False)
class StreetLane:
    """A piece of lane with one set of neighbours.

    Attributes:
        id: name in this map.
        road: name of its road or edge in the file.
        kind: its use.
        line: its middle (K, 3) m, K >= 2.
        width_m: width (K,) at each point.
        speed_m_s: limit; None: the file has none.
        left: lane to change to on the left, in the same direction; None: there is none.
        right: likewise on the right.
        junction: the junction that it lies in; None: it lies in none. Driven lanes in junctions are parts of ways.
        traffic_per_h: vehicles in an hour; None: nobody says.
    """

    id: str
    road: str
    kind: LaneKind
    line: Floats
    width_m: Floats
    speed_m_s: float | None = None
    left: str | None = None
    right: str | None = None
    junction: str | None = None
    traffic_per_h: float | None = None

    @property
    def length_m(self) -> float:
        """Length in the plane."""
        return length_of(self.line)


@dataclass(frozen=True, slots=True, eq=False)
class StreetWay:
    """A way over a junction, from the end of a lane to the beginning of another: one line, however the file divides it.

    Attributes:
        id: name in this map.
        start: the lane that it leaves.
        end: the lane that it leads to.
        junction: the junction.
        line: its middle (K, 3) m.
        width_m: width (K,).
        speed_m_s: limit; None: the file has none.
        turn: its direction.
        signals: lights that hold for it, by id.
        program: the signal program that it obeys; None: none.
        link: its place in the states of that program.
        traffic_per_h: vehicles in an hour; None: nobody says.
    """

    id: str
    start: str
    end: str
    junction: str
    line: Floats
    width_m: Floats
    speed_m_s: float | None
    turn: Turn
    signals: tuple[str, ...] = ()
    program: str | None = None
    link: int = -1
    traffic_per_h: float | None = None

    @property
    def length_m(self) -> float:
        """Length in the plane."""
        return length_of(self.line)


Pairs = frozenset[tuple[str, str]]


@dataclass(frozen=True, slots=True, eq=False)
class StreetJunction:
    """A junction.

    Attributes:
        id: name in the file.
        kind: the file's word for it.
        outline: (K, 2) m; None: the file has none.
        yields: pairs of ways of which the first yields to the second; None: the file does not say.
        foes: pairs of ways that conflict; None: the file does not say.
    """

    id: str
    kind: str
    outline: Floats | None = None
    yields: Pairs | None = None
    foes: Pairs | None = None


@dataclass(frozen=True, slots=True)
class SignalProgram:
    """A program of lights: phases of `(duration_s, state)`, a letter for each link (`G`, `g`, `y`, `r` as in SUMO)."""

    id: str
    offset_s: float
    phases: tuple[tuple[float, str], ...]


@dataclass(frozen=True, slots=True, eq=False)
class StreetSignal:
    """A light or a sign.

    Attributes:
        id: name in the file.
        kind: "light", "stop", "yield" or "sign".
        code: country, type and subtype of the file, with colons between them.
        value: number written on it, such as a speed; None: nothing.
        at: place (3,) m.
        heading_rad: direction in which it faces away from those it holds for.
        lanes: lanes that it holds for, outside junctions.
        controller: name that signals share which change together; None: it has none.
    """

    id: str
    kind: SignalKind
    code: str
    value: float | None
    at: Floats
    heading_rad: float
    lanes: tuple[str, ...] = ()
    controller: str | None = None


@dataclass(frozen=True, slots=True, eq=False)
class StreetCrossing:
    """A crossing for people.

    Attributes:
        id: name in the file.
        line: from side to side (K, 3) m.
        width_m: width.
        roads: roads or edges that it crosses, as far as the file says.
        program: the signal program that it obeys; None: none.
        link: its place in the states of that program.
    """

    id: str
    line: Floats
    width_m: float
    roads: tuple[str, ...] = ()
    program: str | None = None
    link: int = -1


@dataclass(frozen=True, slots=True, eq=False)
class StreetArea:
    """Ground on an outline (K, 2) m, for people ("walk") or parked vehicles ("park")."""

    id: str
    kind: Literal["walk", "park"]
    outline: Floats


@dataclass(frozen=True, slots=True, eq=False)
class StreetSolid:
    """A building, wall, tree or pole.

    Attributes:
        id: name in the file.
        kind: "building", "wall", "tree" or "pole".
        line: outline (K, 3) m on the ground; or the middle of a wall, where it has a thickness.
        height_m: height; None: the file does not say.
        thickness_m: thickness of a wall along `line`; None: `line` is an outline.
    """

    id: str
    kind: SolidKind
    line: Floats
    height_m: float | None
    thickness_m: float | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class StreetMap:
    """A map.

    Attributes:
        source: path of the file.
        format: its format and version.
        lanes: lanes by id, except driven ones in junctions.
        links: driven lanes that a driven lane leads on to, outside junctions.
        ways: ways over junctions, by id.
        junctions: junctions by id.
        programs: signal programs by id.
        signals: lights and signs.
        crossings: crossings for people.
        areas: ground for people or parked vehicles.
        solids: buildings, walls, trees and poles.
        left_hand: whether vehicles keep to the left.
        offset_m: sum to add to x, y and z for coordinates of the projection.
        projection: text of the projection, as PROJ or WKT; empty: the file has none.
        repaired: faults of the file, and their repair: a line each.
        left_out: numbers of elements that were not read, by what they are.
    """

    source: str
    format: str
    lanes: Mapping[str, StreetLane]
    links: Mapping[str, tuple[str, ...]]
    ways: Mapping[str, StreetWay]
    junctions: Mapping[str, StreetJunction]
    programs: Mapping[str, SignalProgram] = field(default_factory=dict)
    signals: tuple[StreetSignal, ...] = ()
    crossings: tuple[StreetCrossing, ...] = ()
    areas: tuple[StreetArea, ...] = ()
    solids: tuple[StreetSolid, ...] = ()
    left_hand: bool = False
    offset_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    projection: str = ""
    repaired: tuple[str, ...] = ()
    left_out: Mapping[str, int] = field(default_factory=dict)
