"""Description of a place: what the generator of towns, scenario files, programs and readers of maps make.

Fields are the keys under `place` in a scenario file. x is east and y north, m; directions are counter-clockwise from
east. A field that is None or empty has a usual value. `coopsim.world.custom.place.place_from` checks a description, and
builds the place: nothing may stand on a lane, and vehicles may not start or park in each other.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Annotated, Any

from coopsim.config.annotated import AtLeast, Checked, Line, OneOf, Point, plain_of
from coopsim.geometry.se3 import Floats
from coopsim.support.checks import require_between, require_count
from coopsim.types.taxonomy import ObjectClass
from coopsim.world.places.scenery import COLORS

PARKED = {label.title: label for label in ObjectClass if label not in (ObjectClass.PEDESTRIAN, ObjectClass.CHILD)}
"""Classes of vehicles that may stand in a bay, by name."""

SURFACES = {"road": "lanes", "pavement": "pavements", "grass": "grass", "yard": "yards", "parking": "parking"}
"""Fields of `RoadMap` by the kinds of surfaces. Of outlines that overlap, the first kind covers the others."""


LENGTHS_M, HEIGHTS_M = (0.9, 20.0), (0.025, 0.1)
"""Accepted sizes: the least length, and both heights, are those of Britain's regulations of 1999."""


def point_of(place: Floats) -> Point:
    """Return a place (2,) m as a point."""
    x, y = place.tolist()
    return x, y


def line_of(places: Floats) -> Line:
    """Return places (N, 2) m as points."""
    return tuple((x, y) for x, y in places.tolist())


_Width = Annotated[float, Checked(require_between, (2.5, 8))]
_Speed = Annotated[float, Checked(require_between, (1, 40))]
_Outline = Annotated[Line, AtLeast(3)]


@dataclass(frozen=True, slots=True)
class MapLane:
    """Lane from node to node: straight, over further points, an arc, or a loop to turn round in at a street's end.

    Lanes lead on where they share a node. Where they cross or join is found from how they lie: there vehicles wait at
    the beginning of the lane, the first to ask goes first, and all give way to lanes with priority.

    Attributes:
        start: node (key `from`).
        end: node (key `to`).
        via: points between them.
        curved: `via` and both ends are points of one lane that bends from each to the next; else each is the end of a
            straight piece, before which vehicles may have to wait.
        centre: middle of an arc.
        turn: "left" or "right" along an arc; "around": a loop from one lane to the next one on its left.
        width_m: width; None: 4.
        widths_m: widths at the start, at each point of `via`, and at the end, in place of `width_m`. Between them the
            width of a curved lane changes evenly; each straight piece is as wide as its narrower end.
        speed_m_s: limit; None: 11, of loops 5.5.
        priority: others give way.
        yields: nodes of lanes to which vehicles here give way, in place of the rule by `priority`; [] is to none.
        left: nodes of the lane on the left in the same direction, whose `right` is this one.
        right: likewise on the right. Drivers keep their lanes; neighbours are kept as maps have them.
    """

    start: str = field(metadata={"key": "from"})
    end: str = field(metadata={"key": "to"})
    via: Line = ()
    curved: bool = False
    centre: Point | None = None
    turn: Annotated[str, OneOf(("left", "right", "around"))] | None = None
    width_m: _Width | None = None
    widths_m: tuple[_Width, ...] = ()
    speed_m_s: _Speed | None = None
    priority: bool = False
    yields: tuple[tuple[str, ...], ...] | None = None
    left: tuple[str, ...] = ()
    right: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class MapPhase:
    """Phase of traffic lights: `seconds`, and the `state`: a letter for each light.

    G is green with priority, g green for those who yield, y yellow, r red. Without `yields`, those at g yield to all at
    G that they would cross.
    """

    seconds: float
    state: str


@dataclass(frozen=True, slots=True)
class MapSignal:
    """Traffic lights with one program, which is repeated.

    Attributes:
        roads: nodes of lanes (`[from, to]`) at whose beginnings vehicles wait.
        phases: the program; each state has a letter for every one of `roads`, then for every one of `crosswalks`.
        crosswalks: two nodes of `walks` each, ways over a road; people wait at y and r.
        offset_s: time from the episode's start to a start of the program.
    """

    roads: tuple[tuple[str, ...], ...]
    phases: tuple[MapPhase, ...]
    crosswalks: tuple[tuple[str, ...], ...] = ()
    offset_s: float = 0.0


@dataclass(frozen=True, slots=True)
class MapStart:
    """Start of a vehicle.

    Attributes:
        road: nodes of the lane.
        at_m: distance from its beginning.
        route: nodes to pass first, behind the lane's end; later turns are drawn.
        connected: rank, from 1, among the starts whose cars become connected; None: last.
    """

    road: tuple[str, ...]
    at_m: float
    route: tuple[str, ...] = ()
    connected: Annotated[int, Checked(require_count, (1,))] | None = None


@dataclass(frozen=True, slots=True)
class MapWays:
    """Ways of people, who go along them both ways, or of riders, who go along them one way.

    Attributes:
        nodes: points by name.
        ways: lists of nodes along each.
        crosswalks: ways over roads, in this form.
    """

    nodes: Mapping[str, Point]
    ways: tuple[tuple[str, ...], ...]
    crosswalks: tuple[tuple[str, ...], ...] = ()


@dataclass(frozen=True, slots=True)
class MapBay:
    """Place `at` which a vehicle may stand parked; `label` is a class: None is a car, now and then a van."""

    at: Point
    heading_deg: float
    label: Annotated[str, OneOf(tuple(PARKED))] | None = None


@dataclass(frozen=True, slots=True)
class MapBuilding:
    """Block on a convex outline; `windows` are bands of glass, gables need four walls; `color` None: by turns."""

    outline: _Outline
    height_m: Annotated[float, Checked(require_between, (0.2, 500))]
    color: Annotated[str, OneOf(tuple(COLORS))] | None = None
    windows: bool = False
    roof: Annotated[str, OneOf(("flat", "gable"))] | None = None


@dataclass(frozen=True, slots=True)
class MapWall:
    """Wall of one height along a line; `thickness_m` None: 0.25."""

    along: Annotated[Line, AtLeast(2)]
    height_m: Annotated[float, Checked(require_between, (0.2, 20))]
    thickness_m: Annotated[float, Checked(require_between, (0.05, 2))] | None = None


@dataclass(frozen=True, slots=True)
class MapTree:
    """Tree with a plain crown, 9 m high and 5 m wide if no sizes are given; as furniture it has leaves."""

    at: Point
    height_m: Annotated[float, Checked(require_between, (2, 60))] | None = None
    crown_m: Annotated[float, Checked(require_between, (0.5, 30))] | None = None


@dataclass(frozen=True, slots=True)
class MapArea:
    """Surface on a convex outline, of a kind of `SURFACES`."""

    outline: _Outline
    kind: Annotated[str, OneOf(tuple(SURFACES))]


@dataclass(frozen=True, slots=True)
class MapUnit:
    """Place for a roadside unit, and the point that it faces."""

    at: Point
    look_at: Point


@dataclass(frozen=True, slots=True)
class MapFurniture:
    """Piece of furniture: `at` a place, or `along` a line; sizes that its kind has, None: the usual ones."""

    kind: str
    at: Point | None = None
    heading_deg: float | None = None
    along: Line = ()
    height_m: float | None = None
    crown_m: float | None = None
    width_m: float | None = None
    thickness_m: float | None = None
    stem_m: float | None = None


@dataclass(frozen=True, slots=True)
class MapHump:
    """Speed hump on a road; `heading_deg` is that of travel, `width_m` across; usually 3.7 m long, 0.075 m high."""

    at: Point
    heading_deg: float
    width_m: Annotated[float, Checked(require_between, (1, 40))]
    length_m: Annotated[float, Checked(require_between, LENGTHS_M)] | None = None
    height_m: Annotated[float, Checked(require_between, HEIGHTS_M)] | None = None


@dataclass(frozen=True, slots=True)
class MapPatch:
    """Patch of water on a road, on a convex outline."""

    outline: _Outline


@dataclass(frozen=True, slots=True, kw_only=True)
class PlaceDescription:
    """A place.

    Attributes:
        nodes: points on the middle of lanes, by name.
        roads: lanes between them.
        signals: traffic lights.
        cut: the place is cut out of a map: lanes may end, and vehicles that leave come in again where lanes begin, out
            of sight. Connected cars turn where they need not leave.
        starts: where vehicles start; None: every 15 m on straight lanes that no other crosses.
        cars_first: number of starts with a rank that have cars, whatever else is drawn.
        speeds_m_s: speeds that a policy can choose from, rising in equal steps; empty: 0, half and all of the limit.
        walks: ways of people.
        rides: ways of bicycles and scooters; None: `walks`.
        parked: bays.
        buildings: blocks.
        walls: walls.
        trees: trees.
        paved: further ground.
        rsus: places for roadside units, in order.
        mast_m: height of their masts; None: 5.
        drones_around: middle of the circles of drones; None: that of all nodes.
        furniture: pieces, seen in full detail; None: drawn where full detail is asked for.
        kerb_m: height of pavements over the road; those of `paved` must be 0.5 m from the middle of every lane.
        crown: fall of the roads to both sides, m per m, from 8 m behind junctions on.
        heights: x, y and z of places, m: the ground is a smooth surface near them, level far away. At these places its
            grade is at most 0.12: a steeper ground is smoothed.
        humps: speed humps.
        wet: patches of water.
    """

    nodes: Mapping[str, Point]
    roads: tuple[MapLane, ...]
    signals: tuple[MapSignal, ...] = ()
    cut: bool = False
    starts: tuple[MapStart, ...] | None = None
    cars_first: Annotated[int, Checked(require_count, (0,))] = 0
    speeds_m_s: tuple[float, ...] = ()
    walks: MapWays | None = None
    rides: MapWays | None = None
    parked: tuple[MapBay, ...] = ()
    buildings: tuple[MapBuilding, ...] = ()
    walls: tuple[MapWall, ...] = ()
    trees: tuple[MapTree, ...] = ()
    paved: tuple[MapArea, ...] = ()
    rsus: tuple[MapUnit, ...] = ()
    mast_m: Annotated[float, Checked(require_between, (1, 30))] | None = None
    drones_around: Point | None = None
    furniture: tuple[MapFurniture, ...] | None = None
    kerb_m: Annotated[float, Checked(require_between, (0, 0.3))] = 0.0
    crown: Annotated[float, Checked(require_between, (0, 0.05))] = 0.0
    heights: tuple[tuple[float, ...], ...] = ()
    humps: tuple[MapHump, ...] = ()
    wet: tuple[MapPatch, ...] = ()

    @property
    def plain(self) -> dict[str, Any]:
        """The same as plain data, as in a file: without what has its usual value."""
        return dict(plain_of(self))

    @property
    def identity(self) -> str:
        """A text that is the same for equal descriptions, in whatever order their keys are."""
        return json.dumps(self.plain, sort_keys=True)
