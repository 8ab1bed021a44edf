"""Streets around a middle: what crossings, roundabouts and single streets share.

A street has one lane each way, driving on the right, and ends in a turning loop, so that traffic never ends. Lanes are
named by their nodes: `far` -> `near` -> `stop` on the way in, `exit` -> `bend` -> `end` on the way out, and back by
`loop`, `apex` and `back`, each with the number of its arm.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from coopsim.geometry import exact
from coopsim.geometry.se3 import SE3, Floats
from coopsim.world.places.layout import LANE_M, Footways, StartSlot, rectangle
from coopsim.world.places.road_network import CircularLane, LaneIndex, Road, RoadNetwork, StraightLane

SPEED_M_S = 11.0
APPROACH_SPEED_M_S = 8.0
LOOP_SPEED_M_S = 5.5
RSU_HEIGHT_M = 5.0

_APPROACH_M = 24.0  # of an arm's lanes, where a lower speed holds
_TURN_SPEED_M_S = 6.5
_LOOP_RADIUS_M = 10.0
_NECK_RADIUS_M = 20.0  # of the bends between an arm and its loop: two trucks pass each other in them
_SLOT_SPACING_M = 15.0
_PAVEMENT_M = 3.0
_CROSSWALK_HALF_M = 1.5


@dataclass(frozen=True, slots=True)
class Streets:
    """Straight arms around the origin.

    Attributes:
        arms: their directions, in quarter turns from the x axis, ascending.
        stop_m: from the middle to the end of an inbound lane: as far as a bus needs to turn.
        length_m: from the middle to the turning loop.
        kerb_m: from an arm's middle line to the pavement.
        median_m: between an arm's lanes.
    """

    arms: tuple[int, ...] = (0, 1, 2, 3)
    stop_m: float = 18.0
    length_m: float = 119.0
    kerb_m: float = LANE_M
    median_m: float = 0.0

    @property
    def half_m(self) -> float:
        """The distance from an arm's middle line to that of a lane."""
        return (LANE_M + self.median_m) / 2

    @property
    def edge_m(self) -> float:
        """The distance from an arm's middle line to the edge of the lanes."""
        return self.half_m + LANE_M / 2

    @property
    def crosswalk_m(self) -> float:
        """The distance from the middle to the middle of a crosswalk."""
        return self.stop_m - 4.0

    @property
    def walk_m(self) -> float:
        """The distance from an arm's middle line to people's ways: long vehicles sweep over the inside of a bend."""
        return self.kerb_m + 2.5

    @property
    def corner_m(self) -> float:
        """The distance from both middle lines to the corner of a building."""
        return self.kerb_m + 8.0


def place(arm: int, point: tuple[float, float]) -> Floats:
    """Turn a point on arm 0 (which leads along x) to arm `arm`, by quarter turns."""
    cos, sin = ((1, 0), (0, 1), (-1, 0), (0, -1))[arm % 4]
    x, y = point
    return np.array([cos * x - sin * y, sin * x + cos * y], dtype=np.float64)


def place_all(arm: int, polygon: Floats) -> Floats:
    """Turn the corners (K, 2) of a polygon on arm 0 to arm `arm`."""
    return np.array([place(arm, (x, y)) for x, y in polygon])


def add_arms(network: RoadNetwork, streets: Streets) -> None:
    """Add all arms' two lanes, and the loops that join them at their far ends."""
    for arm in streets.arms:
        _add_lanes(network, streets, arm)
        _add_loop(network, streets, arm)


def add_bend(
    network: RoadNetwork,
    road: Road,
    centre: Floats,
    arc: tuple[float, float, float],
    speed_m_s: float,
    width_m: float = LANE_M,
) -> None:
    """Add a lane along an arc around `centre` (2,) m: its radius (m), first and last angle (rad).

    To the left if the angle grows, else to the right.
    """
    radius, start, end = arc
    network.add_lane(*road, CircularLane(centre, radius, start, end, width_m, speed_m_s))


def add_straight(
    network: RoadNetwork,
    road: Road,
    ends: tuple[Floats, Floats],
    speed_m_s: float = SPEED_M_S,
    width_m: float = LANE_M,
) -> None:
    """Add a straight lane between two points (2,) m."""
    network.add_lane(*road, StraightLane(*ends, width_m, speed_m_s))


def usual_node(name: str, arm: int) -> str:
    """Return the name of a node of the streets around one middle."""
    return f"{name}{arm}"


def add_turns(
    network: RoadNetwork,
    streets: Streets,
    middle: Floats | None = None,
    node: Callable[[str, int], str] = usual_node,
    turns: Sequence[int] = (1, 2, 3),
) -> tuple[tuple[str, str], ...]:
    """Add lanes from every arm's stop line to the other arms' exits, around `middle` (2,) m; return these roads.

    `turns` are numbers of arms onwards: 1 to the right, 2 straight on, 3 to the left.
    """
    stop, half, roads = streets.stop_m, streets.half_m, []
    centre = np.zeros(2) if middle is None else middle
    for arm in streets.arms:
        for turn in turns:
            other = (arm + turn) % 4
            if other not in streets.arms:
                continue
            roads.append((node("stop", arm), node("exit", other)))
            if turn == 2:
                ends = centre + place(arm, (stop, half)), centre + place(arm, (-stop, half))
                add_straight(network, roads[-1], ends, APPROACH_SPEED_M_S)
                continue
            side = 1 if turn == 1 else -1  # the next arm is to the right of those who come in
            start = -side * np.pi / 2 + arm * np.pi / 2
            arc = (stop - half * side, start, start - side * np.pi / 2)
            add_bend(network, roads[-1], centre + place(arm, (stop, side * stop)), arc, _TURN_SPEED_M_S)
    return tuple(roads)


def middle_of(streets: Streets) -> list[Floats]:
    """Return the surface (K, 2) m between stop lines that turns leave open.

    The arms go on, up to the turns at the corners.
    """
    edge, stop = streets.edge_m, streets.stop_m
    # From the middle to where a right turn's outer edge meets that of an arm.
    round_m = stop - np.sqrt(np.square(stop) - np.square(stop - edge))
    corner = np.array([[edge, edge], [round_m, edge], [edge, round_m]])
    arms = [place_all(arm, rectangle((0.0, stop), (-edge, edge))) for arm in streets.arms]
    return arms + [place_all(arm, corner) for arm in streets.arms if (arm + 1) % 4 in streets.arms]


def _add_lanes(network: RoadNetwork, streets: Streets, arm: int) -> None:
    far, stop, half = streets.length_m, streets.stop_m, streets.half_m
    near, bend = stop + _APPROACH_M, far - _APPROACH_M
    for start, end, x, side, speed_m_s in (
        ("far", "near", (far, near), half, SPEED_M_S),
        ("near", "stop", (near, stop), half, APPROACH_SPEED_M_S),
        ("exit", "bend", (stop, bend), -half, SPEED_M_S),
        ("bend", "end", (bend, far), -half, LOOP_SPEED_M_S),
    ):
        ends = place(arm, (x[0], side)), place(arm, (x[1], side))
        add_straight(network, (f"{start}{arm}", f"{end}{arm}"), ends, speed_m_s)


def _add_loop(network: RoadNetwork, streets: Streets, arm: int) -> None:
    roads = (("end", "loop"), ("loop", "apex"), ("apex", "back"), ("back", "far"))
    for (start, end), ((x, y), arc) in zip(roads, turning_loop(streets.half_m), strict=True):
        quarter = arm * np.pi / 2
        turned = (arc[0], arc[1] + quarter, arc[2] + quarter)
        road, centre = (f"{start}{arm}", f"{end}{arm}"), place(arm, (streets.length_m + x, y))
        add_bend(network, road, centre, turned, LOOP_SPEED_M_S)


def turning_loop(half_m: float) -> tuple[tuple[tuple[float, float], tuple[float, float, float]], ...]:
    """Return four bends from one lane to the next, which are `half_m` from the middle line between them.

    Each has a center (m), and radius (m), first and last angle (rad). The lanes end at x = 0, and x leads on in the
    direction of the lane that is left, at y = -half_m.
    """
    neck = _NECK_RADIUS_M
    reach = np.sqrt(
        np.square(_LOOP_RADIUS_M + neck) - np.square(neck + half_m)
    )  # from the lanes' end to the loop's middle
    tilt = exact.arctan2(neck + half_m, reach)
    return (
        ((0.0, -half_m - neck), (neck, np.pi / 2, tilt)),
        # In two halves: a lane is an arc of at most half a turn.
        ((reach, 0.0), (_LOOP_RADIUS_M, tilt - np.pi, 0.0)),
        ((reach, 0.0), (_LOOP_RADIUS_M, 0.0, np.pi - tilt)),
        ((0.0, half_m + neck), (neck, -tilt, -np.pi / 2)),
    )


def slots_of(streets: Streets) -> tuple[StartSlot, ...]:
    """Return starts on all arms, none in a bend."""
    long_m = streets.length_m - streets.stop_m - _APPROACH_M
    return tuple(
        slot
        for arm in streets.arms
        for start, end, length_m in (("near", "stop", _APPROACH_M), ("far", "near", long_m), ("exit", "bend", long_m))
        for slot in spaced_slots((f"{start}{arm}", f"{end}{arm}", 0), length_m)
    )


def spaced_slots(lane: LaneIndex, length_m: float) -> list[StartSlot]:
    """Return as many starts on a lane as fit."""
    count = int(length_m // _SLOT_SPACING_M)
    margin_m = (length_m - (count - 1) * _SLOT_SPACING_M) / 2
    return [StartSlot(lane, margin_m + k * _SLOT_SPACING_M) for k in range(count)]


def inbound_first(slots: tuple[StartSlot, ...]) -> tuple[int, ...]:
    """Return the order of slots: inbound, nearest first, each next one on another arm; then the rest.

    These cars see different parts of the middle that they are about to share, which is the use of cooperation.
    """

    def rank(index: int) -> tuple[bool, int, int]:
        start, end, _ = slots[index].lane
        same_lane = [other for other in slots if other.lane == slots[index].lane]
        queue = sum(other.along_m > slots[index].along_m for other in same_lane)
        queue += 10 * start.startswith("far")
        return (start.startswith("exit"), queue, int(end[-1]))

    return tuple(sorted(range(len(slots)), key=rank))


def crosswalk_of(streets: Streets, arm: int) -> Floats:
    """Return the outline (4, 2) m of an arm's crosswalk."""
    return place_all(arm, rectangle(_crosswalk_x(streets), (-streets.edge_m, streets.edge_m)))


def stripes_of(streets: Streets, arms: tuple[int, ...] | None = None) -> list[Floats]:
    """Return the stripes (4, 2) m of the crosswalks over `arms`; None: over all."""
    return [
        place_all(arm, rectangle(_crosswalk_x(streets), (low, low + 0.5)))
        for arm in (streets.arms if arms is None else arms)
        for low in np.arange(-streets.edge_m + 0.25, streets.edge_m - 0.25, 1.0)
    ]


def pavements_of(streets: Streets) -> list[Floats]:
    """Return strips (4, 2) m along both sides of every arm; where the next arm is missing, as far as the middle."""
    low, high = streets.kerb_m, streets.kerb_m + _PAVEMENT_M
    return [
        place_all(
            arm, rectangle((streets.stop_m - 10.0 if (arm + side) % 4 in streets.arms else 0.0, streets.length_m), span)
        )
        for arm in streets.arms
        for side, span in ((1, (low, high)), (-1, (-high, -low)))
    ]


def corner_units(x: float, y: float) -> tuple[SE3, ...]:
    """Return places for roadside units in the four corners, `x` and `y` m from the middle, facing it."""
    spots = ((x, y), (-x, y), (-x, -y), (x, -y))
    return tuple(SE3.from_xyz_yaw([*spot, 0.0], float(exact.arctan2(-spot[1], -spot[0]))) for spot in spots)


def _crosswalk_x(streets: Streets) -> tuple[float, float]:
    return streets.crosswalk_m - _CROSSWALK_HALF_M, streets.crosswalk_m + _CROSSWALK_HALF_M


_FAR_WALK_M = 75.0
_RIDE_M = 0.25  # from the lanes' edge inwards to where people ride
_JOIN_M = 5.0  # from the stop line outwards to where riders leave and join the lanes


def footways_of(streets: Streets) -> Footways:
    """Return ways along both sides of every arm, from arm to arm, and over every arm at its crosswalk.

    Every arm has four nodes: near and far on its left, near and far on its right.
    """
    nodes = [
        place(arm, (x, side * streets.walk_m))
        for arm in streets.arms
        for side in (1, -1)
        for x in (streets.crosswalk_m, _FAR_WALK_M)
    ]
    count = len(nodes)
    crossing, linked = np.zeros((2, count, count), dtype=bool)
    for k in range(len(streets.arms)):
        left, right = 4 * k, 4 * k + 2  # the near nodes of both sides; the far ones follow them
        following = (4 * (k + 1) + 2) % count  # the next arm's right side shares the corner of our left side
        for a, b in ((left, left + 1), (right, right + 1), (left, following), (left, right)):
            linked[a, b] = linked[b, a] = True
        crossing[left, right] = crossing[right, left] = True
    return Footways.linking(nodes, linked, crossing)


def cycleways_of(streets: Streets) -> Footways:
    """Return ways on the right edge of every arm's lanes, and as for walkers around corners and over the arms.

    Far out riders turn round to the other side when there is a gap. Every arm has three nodes on its way in, from far
    out to the crosswalk, and after those of all arms three at the same places on its way out.
    """
    join_m, ride_m = streets.stop_m + _JOIN_M, streets.edge_m - _RIDE_M
    places = ((_FAR_WALK_M, ride_m), (join_m, ride_m), (streets.crosswalk_m, streets.walk_m))
    arms = len(streets.arms)
    nodes = [place(arm, spot) for arm in streets.arms for spot in places]
    nodes += [place(arm, (x, -y)) for arm in streets.arms for x, y in places]
    neighbours = np.full((6 * arms, 2), -1, dtype=np.int64)
    crossing = np.zeros((6 * arms, 6 * arms), dtype=bool)
    for k in range(arms):
        inwards, outwards = 3 * k, 3 * (arms + k)
        corner = 3 * (arms + (k + 1) % arms)  # the next arm's right side shares the corner of our left side
        neighbours[inwards, 0], neighbours[inwards + 1, 0] = inwards + 1, inwards + 2
        neighbours[inwards + 2] = outwards + 2, corner + 2
        neighbours[outwards + 2] = outwards + 1, 3 * ((k - 1) % arms) + 2
        neighbours[outwards + 1, 0], neighbours[outwards, 0] = outwards, inwards
        crossing[inwards + 2, outwards + 2] = crossing[outwards, inwards] = True
    return Footways(np.array(nodes), neighbours, crossing)
