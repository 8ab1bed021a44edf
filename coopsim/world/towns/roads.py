"""Nodes and roads of a town's description: every lane of its plan, piece by piece, and ways over junctions.

Nodes of lanes are named `s3f0.2`: street 3, forwards (`b`: backwards), lane 0 (next to the centre line), third place
along the lane. Those of a roundabout are `j2in1` and `j2out1`: junction 2, where arm 1 joins and leaves the ring.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any

import numpy as np

from coopsim.config.annotated import Point
from coopsim.geometry import exact
from coopsim.geometry.se3 import Floats
from coopsim.world.places.description import MapLane, point_of
from coopsim.world.towns.kerbs import touch_rad
from coopsim.world.towns.plan import LANE_M, Junction, Plan, Station, Street, Stretch

LanePlace = tuple[int, float]
"""Number of a lane, and `along_m` of its street."""


@dataclass(frozen=True, slots=True)
class LanePiece:
    """Piece of a lane on a stretch of its street; it ends in another lane where it splits off or joins one.

    `joins`: another piece ends in the same place, so vehicles may wait at the beginning.
    """

    begin: LanePlace
    end: LanePlace
    stretch: int
    joins: bool = False


class OneWayLanes:
    """Lanes of a street in one direction; `stations` are its cross-sections in the direction of travel."""

    def __init__(self, street: Street, forwards: bool) -> None:
        self.street, self.forwards = street, forwards
        self.stations = street.stations if forwards else street.stations[::-1]
        self._places = [station.along_m for station in street.stations]
        self._inner_m = [station.inner_m for station in street.stations]
        self._first = np.cumsum([0.0, *(stretch.length_m for stretch in street.line)]).tolist()

    def pieces(self) -> list[LanePiece]:
        """Return the pieces of all lanes."""
        found = list[LanePiece]()
        for lane in range(max(station.lanes for station in self.stations)):
            for before, after in pairwise(self.stations):
                if before.lanes == lane + 1 == after.lanes + 1:
                    found.append(self._piece((lane, before.along_m), (lane - 1, after.along_m), joins=True))
                elif before.lanes + 1 == lane + 1 == after.lanes:
                    found.append(self._piece((lane - 1, before.along_m), (lane, after.along_m)))
            for run in self._runs(lane):
                cuts = self._cuts(lane, run)
                found += [
                    self._piece((lane, a), (lane, b), joins=self._is_joined(lane, a, b)) for a, b in pairwise(cuts)
                ]
        return found

    def place(self, at: LanePlace) -> Floats:
        """Return a place (2,) m in the middle of a lane."""
        return np.asarray(self.street.position(at[1], self.aside_m(at))[0])

    def aside_m(self, at: LanePlace) -> float:
        """Return the distance of a lane's middle to the left of the street's centre line."""
        inner_m = float(np.interp(at[1], self._places, self._inner_m))
        return (-1.0 if self.forwards else 1.0) * (inner_m + at[0] * LANE_M)

    def stretch(self, piece: LanePiece) -> Stretch:
        """Return the stretch that a piece is on."""
        return self.street.line[piece.stretch]

    def centre(self, piece: LanePiece) -> Floats:
        """Return the middle (2,) m of an arc."""
        radius = 1 / self.stretch(piece).curvature_1_m
        return np.asarray(self.street.position(self._first[piece.stretch], radius)[0])

    def _piece(self, begin: LanePlace, end: LanePlace, *, joins: bool = False) -> LanePiece:
        middle = (begin[1] + end[1]) / 2
        return LanePiece(begin, end, int(np.searchsorted(self._first, middle, side="right")) - 1, joins)

    def _runs(self, lane: int) -> list[list[Station]]:
        """Return the cross-sections of each part of the street that has a lane."""
        runs = list[list[Station]]([[]])
        for station in self.stations:
            if station.lanes > lane:
                runs[-1].append(station)
            elif runs[-1]:
                runs.append([])
        return [run for run in runs if len(run) > 1]

    def _cuts(self, lane: int, run: list[Station]) -> list[float]:
        """Return the places at which pieces of a lane begin and end."""
        cuts = {run[0].along_m, run[-1].along_m}
        for before, after in pairwise(run):
            if before.inner_m != after.inner_m or self._is_joined(lane, before.along_m, after.along_m):
                cuts |= {before.along_m, after.along_m}
            elif lane + 1 == before.lanes < after.lanes:  # another lane splits off
                cuts.add(before.along_m)
        low, high = sorted((run[0].along_m, run[-1].along_m))
        cuts |= {joint for joint in self._first if low < joint < high}
        return sorted(cuts, reverse=not self.forwards)

    def _is_joined(self, lane: int, begin_m: float, end_m: float) -> bool:
        """Return whether the next lane joins a lane between two places."""
        for before, after in pairwise(self.stations):
            if (before.along_m, after.along_m) == (begin_m, end_m):
                return before.lanes == lane + 2 == after.lanes + 1
        return False


_LOOP_SPEED_M_S = 5.5
_ACROSS_M_S = 9.0  # straight over a junction without priority
_LATERAL_M_S2 = 2.6  # in bends
_GENTLE_RAD = math.radians(10.0)  # a way over a junction that bends by less is straight, with kinks of half of it


@dataclass(frozen=True, slots=True)
class TownLane:
    """Piece of a street's lane, and the names of the nodes of its road in the description."""

    road: tuple[str, str]
    way: OneWayLanes
    piece: LanePiece

    @property
    def length_m(self) -> float:
        """Length of the middle line."""
        ends = self.piece.begin, self.piece.end
        asides = [self.way.aside_m(at) for at in ends]
        along_m = abs(ends[1][1] - ends[0][1])
        ahead_m = along_m * (1 - asides[0] * self.way.stretch(self.piece).curvature_1_m)
        return float(exact.hypot(ahead_m, asides[1] - asides[0]))


@dataclass(slots=True)
class TownRoads:
    """Roads of a town, and the lanes of streets.

    Attributes:
        nodes: points by name.
        roads: lanes between them.
        lanes: lanes of streets.
        stops: names of nodes at stop lines, by junction and arm, from the inner lane outwards; at turning loops by None
            and the number of the street.
        exits: names of the first nodes outwards, likewise.
    """

    nodes: dict[str, Point] = field(default_factory=dict)
    roads: list[MapLane] = field(default_factory=list)
    lanes: list[TownLane] = field(default_factory=list)
    stops: dict[tuple[int | None, int], list[str]] = field(default_factory=dict)
    exits: dict[tuple[int | None, int], list[str]] = field(default_factory=dict)

    def add_node(self, name: str, place: Floats) -> str:
        """Add a node at a place (2,) m; return its name."""
        self.nodes[name] = point_of(place)
        return name

    def add_bend(self, road: tuple[str, str], centre: Floats, left: bool, speed_m_s: float, **more: Any) -> None:
        """Add an arc around a centre (2,) m, at a comfortable speed."""
        radius = exact.hypot(self.nodes[road[0]][0] - centre[0], self.nodes[road[0]][1] - centre[1])
        turn = "left" if left else "right"
        speed = min(speed_m_s, math.sqrt(_LATERAL_M_S2 * radius))
        self.add_road(road, speed, centre=point_of(centre), turn=turn, **more)

    def add_road(self, road: tuple[str, str], speed_m_s: float, **more: Any) -> None:
        """Add a road, which is straight unless `more` bends it."""
        self.roads.append(MapLane(*road, width_m=LANE_M, speed_m_s=round(speed_m_s, 1), **more))


def lay_roads(plan: Plan) -> TownRoads:
    """Lay all roads of a plan."""
    found = TownRoads()
    for street in plan.streets:
        for forwards in (True, False):
            _add_lanes(found, street, forwards)
        if street.end.junction is None:
            (ahead,), (back,) = found.stops[None, street.number], found.exits[None, street.number]
            found.add_road((ahead, back), _LOOP_SPEED_M_S, turn="around")
    for junction in plan.junctions:
        if junction.kind == "roundabout":
            _add_ring(found, junction)
        else:
            _add_turns(found, junction, plan)
    return found


def _add_lanes(found: TownRoads, street: Street, forwards: bool) -> None:
    """Add the lanes of a street in one direction, and note their ends."""
    way = OneWayLanes(street, forwards)
    pieces, names = way.pieces(), dict[LanePlace, str]()
    for at in dict.fromkeys(at for piece in pieces for at in (piece.begin, piece.end)):
        name = f"s{street.number}{'f' if forwards else 'b'}{at[0]}.{sum(lane == at[0] for lane, _ in names)}"
        names[at] = found.add_node(name, way.place(at))
    for piece in pieces:
        road = names[piece.begin], names[piece.end]
        found.lanes.append(TownLane(road, way, piece))
        curvature = way.stretch(piece).curvature_1_m
        if curvature == 0.0:
            found.add_road(road, street.speed_m_s)
        else:
            found.add_bend(road, way.centre(piece), (curvature > 0) == forwards, street.speed_m_s)
    for station, end, ends in (
        (way.stations[-1], street.end if forwards else street.begin, found.stops),
        (way.stations[0], street.begin if forwards else street.end, found.exits),
    ):
        ends[end.junction, end.arm if end.junction is not None else street.number] = [
            names[lane, station.along_m] for lane in range(station.lanes)
        ]


def _add_turns(found: TownRoads, junction: Junction, plan: Plan) -> None:
    """Add the ways over a junction, from each lane inwards to the lanes of the same number outwards."""
    turns = turns_of(junction)
    for turn in turns:
        main = junction.main is not None and {turn.arm, turn.other} == set(junction.main)
        speed = plan.streets[junction.arms[turn.arm].street].speed_m_s
        more = {"priority": True} if main and any(meet(junction, turn, other) for other in turns) else {}
        _add_turn(found, junction, turn, speed if main else min(speed, _ACROSS_M_S), more)


@dataclass(frozen=True, slots=True)
class Turn:
    """Way over a junction from a lane of an arm to that of another, and the angle between the arms (rad)."""

    arm: int
    other: int
    lane: int
    angle: float


def turns_of(junction: Junction) -> list[Turn]:
    """Return the ways over a junction; every lane has one, inwards and outwards."""
    count = range(len(junction.arms))
    turns = [
        Turn(arm, other, lane, angle)
        for arm in count
        for lane in range(junction.lanes)
        for angle, other in _ways_of(
            lane, junction.lanes, sorted((_angle(junction, arm, other), other) for other in count if other != arm)
        )
    ]
    reached = {(turn.other, turn.lane) for turn in turns}
    for other, lane in [(other, lane) for other in count for lane in range(junction.lanes)]:
        if (other, lane) not in reached:
            angles = [(_angle(junction, arm, other), arm) for arm in count if arm != other]
            angle, arm = min(angles, key=lambda each: abs(each[0] - math.pi))
            turns.append(Turn(arm, other, lane, angle))
    return turns


def meet(junction: Junction, a: Turn, b: Turn) -> bool:
    """Return whether two ways over a junction cross (their ends alternate around it) or join (in the same end)."""
    if (a.arm, a.lane) == (b.arm, b.lane):
        return False
    if (a.other, a.lane) == (b.other, b.lane):
        return True
    lanes = junction.lanes
    begin, end, *others = (
        place
        for turn in (a, b)
        for place in (turn.arm * 2 * lanes + lanes + turn.lane, turn.other * 2 * lanes + lanes - 1 - turn.lane)
    )
    low, high = sorted((begin, end))
    return sum(low < place < high for place in others) == 1


def _angle(junction: Junction, arm: int, other: int) -> float:
    """Return the angle from an arm to another, counter-clockwise: less than half a turn is a turn to the right."""
    headings = [junction.arms[k].heading_rad for k in (arm, other)]
    return (headings[1] - headings[0]) % (2 * math.pi)


def _ways_of(lane: int, lanes: int, others: list[tuple[float, int]]) -> list[tuple[float, int]]:
    """Return the ways of a lane among others (angle, arm), from the right one to the left one."""
    if lanes == 1:
        return others
    straight = min(others, key=lambda each: abs(each[0] - math.pi))
    middle = [straight] if abs(straight[0] - math.pi) < math.radians(35.0) else []
    right = [each for each in others if each not in middle and each[0] < math.pi]
    left = [each for each in others if each not in middle and each[0] > math.pi]
    if lane == 0:
        own = left + (middle if lanes == 2 or not left else [])
        return own or right[-1:]
    if lane == lanes - 1:
        return (right + middle) or left[:1]
    return middle or left[:1] or right[-1:]


def _add_turn(found: TownRoads, junction: Junction, turn: Turn, speed_m_s: float, more: dict[str, Any]) -> None:
    number = junction.number
    road = found.stops[number, turn.arm][turn.lane], found.exits[number, turn.other][turn.lane]
    if abs(turn.angle - math.pi) < _GENTLE_RAD:
        found.add_road(road, speed_m_s, **more)
        return
    # The way is the same seen from either end, so its middle lies on the line that halves the angle between the arms.
    centre = junction.place(turn.arm, junction.stop_m, junction.stop_m * exact.tan(turn.angle / 2))
    found.add_bend(road, centre, turn.angle > math.pi, speed_m_s, **more)


def _add_ring(found: TownRoads, junction: Junction) -> None:
    """Add a roundabout's ring, counter-clockwise, and the bends between it and the arms; the ring has priority."""
    stub, count, touch = f"j{junction.number}", len(junction.arms), touch_rad(junction)
    aside_m = junction.entry_m + junction.inner_m
    for arm, each in enumerate(junction.arms):
        for name, angle in (("out", each.heading_rad - touch), ("in", each.heading_rad + touch)):
            spot = junction.centre + junction.ring_m * np.array([exact.cos(angle), exact.sin(angle)])
            found.add_node(f"{stub}{name}{arm}", spot)
    for arm in range(count):
        (stop,), (way_out,) = found.stops[junction.number, arm], found.exits[junction.number, arm]
        centres = [junction.place(arm, junction.stop_m, side * aside_m) for side in (1, -1)]
        found.add_bend((stop, f"{stub}in{arm}"), centres[0], False, _ACROSS_M_S)
        found.add_bend((f"{stub}out{arm}", way_out), centres[1], False, _ACROSS_M_S)
        found.add_bend((f"{stub}out{arm}", f"{stub}in{arm}"), junction.centre, True, _ACROSS_M_S, priority=True)
        after = (arm + 1) % count
        found.add_bend((f"{stub}in{arm}", f"{stub}out{after}"), junction.centre, True, _ACROSS_M_S)
