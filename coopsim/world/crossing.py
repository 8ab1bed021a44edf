"""The layout `crossing`: four arms meet between buildings; arms end in turning loops, so that traffic never ends."""

from __future__ import annotations

import numpy as np
from highway_env.road.lane import CircularLane, StraightLane
from highway_env.road.road import RoadNetwork

from coopsim.geometry.se3 import SE3, Floats
from coopsim.world.layout import (
    ASPHALT,
    GROUND,
    MARKING,
    PAVEMENT,
    Footways,
    Layout,
    Slot,
    box_part,
    flat_part,
    lane_outline,
    mast_part,
    rectangle,
)
from coopsim.world.snapshot import RoadMap, StaticPart

ARM_M = 115.0  # from the middle to the turning loop
STOP_M = 14.0  # from the middle to where an inbound lane ends
LANE_M = 4.0
LOOP_RADIUS_M = 10.0
NECK_RADIUS_M = 20.0  # of the bends between an arm and its loop: two trucks pass each other in them
APPROACH_M = 24.0  # of an arm's lanes, where a lower speed holds
CROSSWALK_M = 11.0  # from the middle
WALK_M = 6.5  # from an arm's middle line to where people walk: long vehicles sweep over the inside of a bend
FAR_WALK_M = 75.0
RIDE_M = 3.75  # from an arm's middle line to where people ride
MERGE_M = 19.0  # from the middle to where they leave and join the lanes
SLOT_SPACING_M = 15.0
BUILDING_CORNER_M = 10.0
RSU_OFFSET_M = 9.0
RSU_HEIGHT_M = 5.0

_SPEED, _APPROACH_SPEED, _TURN_SPEED, _LOOP_SPEED = 11.0, 8.0, 6.5, 5.5


def make_crossing() -> Layout:
    """Build the layout; it has no parameters and no randomness."""
    network = RoadNetwork()
    for arm in range(4):
        _add_arm(network, arm)
        _add_turns(network, arm)
    lanes = [quad for lane in network.lanes_list() for quad in lane_outline(lane)]
    lanes.append(rectangle((-STOP_M, STOP_M), (-LANE_M, LANE_M)))
    lanes.append(rectangle((-LANE_M, LANE_M), (-STOP_M, STOP_M)))
    slots = _slots()
    buildings = _buildings()
    rsus = tuple(_rsu(corner) for corner in range(4))
    return Layout(
        network,
        slots,
        _connected_first(slots),
        _footways(),
        rsus,
        RSU_HEIGHT_M,
        (0.0, _SPEED / 2, _SPEED),
        _static(lanes, buildings, rsus),
        RoadMap(
            tuple(lanes),
            tuple(_crosswalk(arm) for arm in range(4)),
            tuple(_pavements()),
            tuple(rectangle(x, y) for x, y, _ in buildings),
        ),
        cycleways=_cycleways(),
        movements=tuple((f"stop{arm}", f"exit{other}") for arm in range(4) for other in range(4) if other != arm),
    )


def _turn(arm: int, point: tuple[float, float]) -> Floats:
    """A point given on arm 0 (which leads along x), on arm `arm`, a quarter turn each."""
    cos, sin = ((1, 0), (0, 1), (-1, 0), (0, -1))[arm % 4]
    x, y = point
    return np.array([cos * x - sin * y, sin * x + cos * y], dtype=np.float64)


def _add_arm(network: RoadNetwork, arm: int) -> None:
    """Two lanes, driving on the right, and the loop that joins them at the far end."""
    half, bend = LANE_M / 2, ARM_M - APPROACH_M

    def straight(start: str, end: str, x: tuple[float, float], y: float, speed: float) -> None:
        lane = StraightLane(_turn(arm, (x[0], y)), _turn(arm, (x[1], y)), width=LANE_M, speed_limit=speed)
        network.add_lane(f"{start}{arm}", f"{end}{arm}", lane)

    straight("far", "near", (ARM_M, STOP_M + APPROACH_M), half, _SPEED)
    straight("near", "stop", (STOP_M + APPROACH_M, STOP_M), half, _APPROACH_SPEED)
    straight("exit", "bend", (STOP_M, bend), -half, _SPEED)
    straight("bend", "end", (bend, ARM_M), -half, _LOOP_SPEED)

    neck = NECK_RADIUS_M
    reach = np.sqrt((LOOP_RADIUS_M + neck) ** 2 - (neck + half) ** 2)  # from the lanes' end to the loop's middle
    tilt = np.arctan2(neck + half, reach)
    quarter = arm * np.pi / 2

    def arc(start: str, end: str, centre: tuple[float, float], phases: tuple[float, float], left: bool) -> None:
        lane = CircularLane(
            _turn(arm, centre),
            LOOP_RADIUS_M if left else neck,
            phases[0] + quarter,
            phases[1] + quarter,
            clockwise=left,  # highway-env looks at y from above: its clockwise is our left turn
            width=LANE_M,
            speed_limit=_LOOP_SPEED,
        )
        network.add_lane(f"{start}{arm}", f"{end}{arm}", lane)

    arc("end", "loop", (ARM_M, -half - neck), (np.pi / 2, tilt), left=False)
    # In two halves: highway-env measures along an arc of at most half a turn.
    arc("loop", "apex", (ARM_M + reach, 0.0), (tilt - np.pi, 0.0), left=True)
    arc("apex", "back", (ARM_M + reach, 0.0), (0.0, np.pi - tilt), left=True)
    arc("back", "far", (ARM_M, half + neck), (-tilt, -np.pi / 2), left=False)


def _add_turns(network: RoadNetwork, arm: int) -> None:
    """From an arm's stop line to the three other arms' exits."""
    half, quarter = LANE_M / 2, arm * np.pi / 2
    across = StraightLane(
        _turn(arm, (STOP_M, half)), _turn(arm, (-STOP_M, half)), width=LANE_M, speed_limit=_APPROACH_SPEED
    )
    network.add_lane(f"stop{arm}", f"exit{(arm + 2) % 4}", across)
    for other, side, left in (((arm + 1) % 4, 1, False), ((arm + 3) % 4, -1, True)):
        radius = STOP_M - half * side
        start = -side * np.pi / 2 + quarter
        lane = CircularLane(
            _turn(arm, (STOP_M, side * STOP_M)),
            radius,
            start,
            start - side * np.pi / 2,
            clockwise=left,
            width=LANE_M,
            speed_limit=_TURN_SPEED,
        )
        network.add_lane(f"stop{arm}", f"exit{other}", lane)


def _slots() -> tuple[Slot, ...]:
    slots = []
    for arm in range(4):
        for lane, length in (
            ((f"near{arm}", f"stop{arm}", 0), APPROACH_M),
            ((f"far{arm}", f"near{arm}", 0), ARM_M - STOP_M - APPROACH_M),
            ((f"exit{arm}", f"bend{arm}", 0), ARM_M - STOP_M - APPROACH_M),
        ):
            count = int(length // SLOT_SPACING_M)
            margin = (length - (count - 1) * SLOT_SPACING_M) / 2
            slots += [Slot(lane, margin + k * SLOT_SPACING_M) for k in range(count)]
    return tuple(slots)


def _connected_first(slots: tuple[Slot, ...]) -> tuple[int, ...]:
    """Cars on their way in, nearest first, each next one on another arm; then the rest.

    These see different parts of the crossing that they are about to share: what cooperation is for.
    """

    def rank(index: int) -> tuple[bool, int, int]:
        start, end, _ = slots[index].lane
        same_lane = [other for other in slots if other.lane == slots[index].lane]
        queue = sum(other.along_m > slots[index].along_m for other in same_lane)
        queue += 10 * start.startswith("far")
        # Arms in the order 0, 1, 2, 3 would put the first two side by side; opposite ones come last.
        return (start.startswith("exit"), queue, int(end[-1]))

    return tuple(sorted(range(len(slots)), key=rank))


def _footways() -> Footways:
    """Along both sides of every arm, around every corner, and over every arm at its crosswalk."""
    nodes = [_turn(arm, (x, side * WALK_M)) for arm in range(4) for side in (1, -1) for x in (CROSSWALK_M, FAR_WALK_M)]
    crossing = np.zeros((16, 16), dtype=bool)
    linked = np.zeros((16, 16), dtype=bool)
    for arm in range(4):
        left, right = 4 * arm, 4 * arm + 2  # the near nodes of both sides; the far ones follow them
        following = (4 * (arm + 1) + 2) % 16  # the next arm's right side shares the corner of our left side
        for a, b in ((left, left + 1), (right, right + 1), (left, following)):
            linked[a, b] = linked[b, a] = True
        linked[left, right] = linked[right, left] = True
        crossing[left, right] = crossing[right, left] = True
    neighbours = np.full((16, 3), -1, dtype=np.int64)
    for node in range(16):
        to = np.flatnonzero(linked[node])
        neighbours[node, : len(to)] = to
    return Footways(np.array(nodes), neighbours, crossing)


def _cycleways() -> Footways:
    """On the right edge of every arm's lanes; around corners and over the arms as people on foot.

    Far out one turns round to the other side when there is a gap. Every arm has three nodes on its way in, from far out
    to the crosswalk, and after those of all arms three at the same places on its way out.
    """
    places = ((FAR_WALK_M, RIDE_M), (MERGE_M, RIDE_M), (CROSSWALK_M, WALK_M))
    nodes = [_turn(arm, place) for arm in range(4) for place in places]
    nodes += [_turn(arm, (x, -y)) for arm in range(4) for x, y in places]
    neighbours = np.full((24, 2), -1, dtype=np.int64)
    crossing = np.zeros((24, 24), dtype=bool)
    for arm in range(4):
        inwards, outwards = 3 * arm, 12 + 3 * arm
        corner = 12 + 3 * ((arm + 1) % 4)  # the next arm's right side shares the corner of our left side
        neighbours[inwards, 0], neighbours[inwards + 1, 0] = inwards + 1, inwards + 2
        neighbours[inwards + 2] = outwards + 2, corner + 2
        neighbours[outwards + 2] = outwards + 1, 3 * ((arm + 3) % 4) + 2
        neighbours[outwards + 1, 0], neighbours[outwards, 0] = outwards, inwards
        crossing[inwards + 2, outwards + 2] = crossing[outwards, inwards] = True
    return Footways(np.array(nodes), neighbours, crossing)


def _rsu(corner: int) -> SE3:
    """On the corner to the left of arm `corner`, looking at the middle."""
    x, y = _turn(corner, (RSU_OFFSET_M, RSU_OFFSET_M))
    return SE3.from_xyz_yaw([x, y, 0.0], float(np.arctan2(-y, -x)))


def _crosswalk(arm: int) -> Floats:
    corners = rectangle((CROSSWALK_M - 1.5, CROSSWALK_M + 1.5), (-LANE_M, LANE_M))
    return np.array([_turn(arm, (x, y)) for x, y in corners])


def _pavements() -> list[Floats]:
    low, high = LANE_M, LANE_M + 3.0
    return [
        np.array([_turn(arm, (x, y)) for x, y in rectangle((BUILDING_CORNER_M - 2, ARM_M), sides)])
        for arm in range(4)
        for sides in ((low, high), (-high, -low))
    ]


_Building = tuple[tuple[float, float], tuple[float, float], float]


def _buildings() -> list[_Building]:
    """Four at the corners, close to the roads, so that arms are hidden from each other; eight along the arms."""
    corner = BUILDING_CORNER_M
    depths = ((34.0, 26.0, 14.0), (28.0, 36.0, 10.0), (40.0, 24.0, 18.0), (26.0, 30.0, 9.0))
    buildings: list[_Building] = []
    for k, (along, across, height) in enumerate(depths):
        sx, sy = ((1, 1), (-1, 1), (-1, -1), (1, -1))[k]
        for x, y, up in (
            ((corner, corner + along), (corner, corner + across), height),
            ((corner + along + 9, corner + along + 33), (corner, corner + 16), 0.7 * height),
            ((corner, corner + 16), (corner + across + 9, corner + across + 31), 0.8 * height),
        ):
            buildings.append((_signed(x, sx), _signed(y, sy), up))
    return buildings


def _signed(span: tuple[float, float], sign: int) -> tuple[float, float]:
    return span if sign > 0 else (-span[1], -span[0])


def _static(lanes: list[Floats], buildings: list[_Building], rsus: tuple[SE3, ...]) -> tuple[StaticPart, ...]:
    colors = ((176, 112, 88), (198, 186, 160), (140, 146, 158), (186, 150, 110))
    walls = [
        box_part("building", (x[0], y[0], 0.0), (x[1], y[1], height), colors[k % 4])
        for k, (x, y, height) in enumerate(buildings)
    ]
    return (
        flat_part("ground", [rectangle((-260.0, 260.0), (-260.0, 260.0))], -0.04, GROUND, 0.3),
        flat_part("pavement", _pavements(), -0.01, PAVEMENT, 0.35),
        flat_part("road", lanes, 0.0, ASPHALT, 0.18),
        flat_part("marking", [stripe for arm in range(4) for stripe in _stripes(arm)], 0.02, MARKING, 0.8),
        *walls,
        *(mast_part("mast", rsu.translation[:2], RSU_HEIGHT_M) for rsu in rsus),
    )


def _stripes(arm: int) -> list[Floats]:
    """A crosswalk's stripes."""
    return [
        np.array([_turn(arm, (x, y)) for x, y in rectangle((CROSSWALK_M - 1.5, CROSSWALK_M + 1.5), (low, low + 0.5))])
        for low in np.arange(-LANE_M + 0.25, LANE_M - 0.25, 1.0)
    ]
