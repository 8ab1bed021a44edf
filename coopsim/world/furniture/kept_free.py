"""What of a place must stay free of furniture: roads and the sweep of long vehicles, people's ways, bays, buildings."""

from __future__ import annotations

import numpy as np

from coopsim.geometry import exact
from coopsim.geometry.se3 import Floats
from coopsim.types.taxonomy import ObjectClass
from coopsim.world.furniture.free_ground import BULKY, CROWN, GROUND, UNPAVED, Obstacles, make_obstacles
from coopsim.world.places.layout import Bay, Footways, Layout
from coopsim.world.places.road_network import CircularLane, Lane
from coopsim.world.snapshot import StaticPart
from coopsim.world.traffic.rules import cut_inside_m

KERB_M = 0.45
"""Least distance of furniture from the edge of a lane."""

WALK_M = 1.1
"""Least distance of furniture from the lines along which people walk and ride."""

_BUS_M = 12.5  # of the longest vehicles
_SWINGING_M = 6.0  # before and after a bend, where long vehicles still stand at an angle
_CHORD_M = 2.5
_WIDE_BEND_M = 60.0  # radius from which vehicles keep to their lane
_CROSSWALK_M, _SIGHT_M = 0.8, 4.0
_STOP_LINE_M = 6.0
_BAY_M = {ObjectClass.TRUCK: (10.0, 2.8), ObjectClass.BUS: (12.6, 2.8)}
_USUAL_BAY_M = (6.4, 2.6)
_UPRIGHT_M = 0.3  # parts that are higher are no surfaces
_HEAD_M = 2.2
_THIN_M = 0.7
_DRIVEWAY_M, _BEFORE_DRIVEWAY_M = 4.0, 6.0  # widest driveway, and from a yard to the road


def obstacles_of(layout: Layout, area: Floats) -> Obstacles:
    """Return all that must stay free within an area, its least and greatest x and y (2, 2) m."""
    outlines, margins, layers = list[Floats](), list[float](), list[int]()

    def add(shapes: list[Floats] | tuple[Floats, ...], margin_m: float, layer: int) -> None:
        outlines.extend(shapes)
        margins.extend([margin_m] * len(shapes))
        layers.extend([layer] * len(shapes))

    for lane in layout.network.lanes.values():
        add(_pieces_of(lane), lane.width / 2 + KERB_M + _sweep_m(lane), GROUND)
    add(layout.road_map.lanes, KERB_M, GROUND)
    add(layout.road_map.parking, KERB_M, GROUND)
    add(layout.road_map.yards, 0.1, UNPAVED)
    add([_ways_in(outline) for outline in layout.road_map.yards if len(outline) == 4], 0.1, UNPAVED)
    add(layout.road_map.walls, 0.15, GROUND)
    add(layout.road_map.crosswalks, _CROSSWALK_M, GROUND)
    add(layout.road_map.crosswalks, _SIGHT_M, BULKY)
    stops = [layout.network.get_lane((*road, 0)).position(0.0, 0.0)[None] for road in layout.movements]
    add(stops, _STOP_LINE_M, BULKY)
    for ways in (layout.footways, layout.cycleways):
        add(lines_of(ways) if ways is not None else [], WALK_M, GROUND)
    add([_bay_outline(bay) for bay in layout.bays], KERB_M, GROUND)
    add(layout.road_map.buildings, 0.1, GROUND | CROWN)
    add([rsu.translation[None, :2] for rsu in layout.rsus], 0.6, GROUND)
    add([rsu.translation[None, :2] for rsu in layout.rsus], 2.0, CROWN)
    for part in (*layout.static, *layout.furnishing):
        if part.name not in ("building", "wall"):
            add(_foot(part), 0.2, GROUND)
            add(_crown(part), 0.0, CROWN)
    return make_obstacles(outlines, margins, layers, area)


def lanes_of(layout: Layout, area: Floats) -> Obstacles:
    """Return the lanes alone, without a margin."""
    lanes = [(piece, lane.width / 2) for lane in layout.network.lanes.values() for piece in _pieces_of(lane)]
    return make_obstacles([piece for piece, _ in lanes], [half for _, half in lanes], [GROUND] * len(lanes), area)


def lines_of(ways: Footways, *, crossing: bool = True) -> list[Floats]:
    """Return the ways of a graph (2, 2) m, each once; without `crossing` only those that cross no road."""
    start, place = np.nonzero(ways.neighbours >= 0)
    end = ways.neighbours[start, place]
    pairs = np.unique(np.sort(np.column_stack([start, end]), axis=1), axis=0)
    if not crossing:
        pairs = pairs[~ways.crossing[pairs[:, 0], pairs[:, 1]]]
    return list(ways.nodes[pairs])


def _foot(part: StaticPart) -> list[Floats]:
    """Return outlines (4 or 1, 2) m of what a part that stands up covers below people's heads; none of a surface."""
    low_m = part.vertices[:, 2].min()
    if np.ptp(part.vertices[:, 2]) < _UPRIGHT_M or low_m > _HEAD_M:
        return []
    if part.boxes is not None and part.closed:
        found = [_rectangle(box[:2], box[3:5], float(box[6])) for box in part.boxes if box[2] < box[5] / 2 + _HEAD_M]
        if found:
            return found
    below = part.vertices[part.vertices[:, 2] < low_m + _HEAD_M]
    (x, y), (far_x, far_y) = below[:, :2].min(axis=0), below[:, :2].max(axis=0)
    if exact.hypot(far_x - x, far_y - y) < _THIN_M:  # a mast or a stem: the same from all sides
        return [below[:, :2].mean(axis=0)[None]]
    return [np.array([[x, y], [far_x, y], [far_x, far_y], [x, far_y]])]


def _crown(part: StaticPart) -> list[Floats]:
    """Return the outline (4, 2) m of foliage over people's heads."""
    high = part.boxes is not None and part.opacity < 1 and part.vertices[:, 2].max() > _HEAD_M + 1.0
    return (
        [_rectangle(box[:2], box[3:5], float(box[6])) for box in part.boxes] if high and part.boxes is not None else []
    )


def _ways_in(yard: Floats) -> Floats:
    """Return a driveway (4, 2) m with the ground before and behind it; another yard as it is."""
    sides = np.roll(yard, -1, axis=0) - yard
    length = exact.hypot(sides[:, 0], sides[:, 1])
    longer = int(length[1] > length[0])
    if min(length[0], length[1]) > _DRIVEWAY_M:
        return yard
    beyond = _BEFORE_DRIVEWAY_M * sides[longer] / length[longer]
    ahead = np.zeros((4, 2))
    ahead[[(longer + 1) % 4, (longer + 2) % 4]] = beyond
    ahead[[longer, (longer + 3) % 4]] = -beyond
    extended: Floats = yard + ahead
    return extended


def middle_of(lane: Lane) -> Floats:
    """Return points (N, 2) m on a lane's middle line, in bends closely spaced."""
    count = 1 if not isinstance(lane, CircularLane) else int(np.ceil(lane.length / _CHORD_M))
    return lane.positions(np.linspace(0.0, lane.length, count + 1), 0.0)


def _pieces_of(lane: Lane) -> list[Floats]:
    """Return straight pieces (2, 2) m of a lane's middle line, of tight bends with their tangents at both ends."""
    points = middle_of(lane)
    if isinstance(lane, CircularLane) and lane.radius < _WIDE_BEND_M:
        headings = lane.heading_at(0.0) + np.pi, lane.heading_at(lane.length)
        before, beyond = (_SWINGING_M * np.array([exact.cos(heading), exact.sin(heading)]) for heading in headings)
        points = np.vstack([points[0] + before, points, points[-1] + beyond])
    return list(np.stack([points[:-1], points[1:]], axis=1))


def _sweep_m(lane: Lane) -> float:
    """Return how far the longest vehicles leave a lane."""
    bent = isinstance(lane, CircularLane) and lane.radius < _WIDE_BEND_M
    return float(cut_inside_m(_BUS_M, lane.radius)) / 2 if bent and isinstance(lane, CircularLane) else 0.0


def _bay_outline(bay: Bay) -> Floats:
    size = _BAY_M.get(bay.label, _USUAL_BAY_M) if bay.label is not None else _USUAL_BAY_M
    return _rectangle(np.array([bay.x_m, bay.y_m]), np.array(size), bay.heading_rad)


def _rectangle(middle: Floats, size: Floats, yaw: float) -> Floats:
    ahead, left = np.array([[exact.cos(yaw), exact.sin(yaw)], [-exact.sin(yaw), exact.cos(yaw)]])
    corners = np.array([[1.0, 1.0], [-1.0, 1.0], [-1.0, -1.0], [1.0, -1.0]]) * size / 2
    rectangle: Floats = middle + corners[:, :1] * ahead + corners[:, 1:] * left
    return rectangle
