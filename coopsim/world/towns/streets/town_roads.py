"""The keys `nodes` and `roads` of a town's description: every lane of its plan, piece by piece, and the ways between.

Nodes of lanes are named `s3f0.2`: street 3, forwards (`b`: backwards), lane 0 (next to the centre line), third place
along the lane. Those of a roundabout are `j2in1` and `j2out1`: junction 2, where arm 1 joins and leaves the ring.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from coopsim.geometry import exact
from coopsim.geometry.se3 import Floats
from coopsim.world.towns.streets.carriageway import Carriageway, LanePiece, LanePlace
from coopsim.world.towns.streets.kerb_lines import touch_rad
from coopsim.world.towns.streets.plan import LANE_M, Junction, Plan, Street

_LOOP_SPEED_M_S = 5.5
_ACROSS_M_S = 9.0  # straight over a junction without priority
_LATERAL_M_S2 = 2.6  # in bends
_GENTLE_RAD = math.radians(10.0)  # a way over a junction that bends by less is straight, with kinks of half of it


@dataclass(frozen=True, slots=True)
class TownLane:
    """A piece of a street's lane, and the road that it is in the description.

    Attributes:
        road: names of its nodes.
        way: lanes of the street in one direction.
        piece: of these.
    """

    road: tuple[str, str]
    way: Carriageway
    piece: LanePiece

    @property
    def length_m(self) -> float:
        """The length of its middle line."""
        ends = self.piece.begin, self.piece.end
        asides = [self.way.aside_m(at) for at in ends]
        along_m = abs(ends[1][1] - ends[0][1])
        ahead_m = along_m * (1 - asides[0] * self.way.stretch(self.piece).curvature_1_m)
        return float(exact.hypot(ahead_m, asides[1] - asides[0]))


@dataclass(slots=True)
class TownRoads:
    """Roads of a town, in the words of a scenario file.

    Attributes:
        nodes: [x, y] by name, m.
        roads: list of roads.
        lanes: the lanes of streets.
        stops: names of nodes at stop lines, by junction and arm, from the inner lane outwards; at turning loops by None
            and the number of the street.
        exits: the same of the first nodes outwards.
    """

    nodes: dict[str, list[float]] = field(default_factory=dict)
    roads: list[dict[str, Any]] = field(default_factory=list)
    lanes: list[TownLane] = field(default_factory=list)
    stops: dict[tuple[int | None, int], list[str]] = field(default_factory=dict)
    exits: dict[tuple[int | None, int], list[str]] = field(default_factory=dict)

    def add_node(self, name: str, place: Floats) -> str:
        """Add a node at a place (2,) m; return its name."""
        self.nodes[name] = [float(place[0]), float(place[1])]
        return name

    def add_bend(self, road: tuple[str, str], centre: Floats, left: bool, speed_m_s: float, **more: Any) -> None:
        """Add an arc around a place (2,) m, at a speed that is comfortable in it."""
        radius = exact.hypot(self.nodes[road[0]][0] - centre[0], self.nodes[road[0]][1] - centre[1])
        turn = "left" if left else "right"
        speed = min(speed_m_s, math.sqrt(_LATERAL_M_S2 * radius))
        middle = [float(centre[0]), float(centre[1])]
        self.add_road(road, speed, centre=middle, turn=turn, **more)

    def add_road(self, road: tuple[str, str], speed_m_s: float, **more: Any) -> None:
        """Add a road: straight, if `more` says nothing else."""
        self.roads.append({"from": road[0], "to": road[1], "width_m": LANE_M, "speed_m_s": round(speed_m_s, 1), **more})


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
    way = Carriageway(street, forwards)
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
    turns = _turns(junction)
    for turn in turns:
        main = junction.main is not None and {turn.arm, turn.other} == set(junction.main)
        speed = plan.streets[junction.arms[turn.arm].street].speed_m_s
        more = {"priority": True} if main and any(_meet(junction, turn, other) for other in turns) else {}
        _add_turn(found, junction, turn, speed if main else min(speed, _ACROSS_M_S), more)


@dataclass(frozen=True, slots=True)
class Turn:
    """A way over a junction: from a lane of an arm to that of another, and the angle between the arms (rad)."""

    arm: int
    other: int
    lane: int
    angle: float


def _turns(junction: Junction) -> list[Turn]:
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


def _meet(junction: Junction, a: Turn, b: Turn) -> bool:
    """Return whether two ways over a junction cross or join: where their ends alternate around it, or are the same."""
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
