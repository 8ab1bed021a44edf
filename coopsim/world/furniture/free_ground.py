"""Free ground of a place, on which nothing stands, drives, rides or walks: obstacles, and discs between them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from coopsim.geometry import exact
from coopsim.geometry.se3 import Floats
from coopsim.support.arrays import numbered
from coopsim.support.kernels import njit
from coopsim.types import Ints, Mask
from coopsim.types.taxonomy import ObjectClass
from coopsim.world.places.layout import Bay, Bystander, Footways, Layout
from coopsim.world.places.road_network import Lane
from coopsim.world.snapshot import StaticPart
from coopsim.world.traffic.rules import cut_inside_m

GROUND, CROWN, BULKY, UNPAVED = 1, 2, 4, 8
"""Layers: on the ground, spreading above it, hiding people who are about to cross, and not in yards and driveways."""

_CELL_M = 16.0
_LARGEST_M = 4.0
"""Radius of the largest disc that is asked about."""


class Obstacles(NamedTuple):
    """K convex outlines that must stay free, with a margin; two points are a line, one is a disc.

    Attributes:
        corners: (C, 2) m, corners of all outlines.
        starts: (K + 1,) first corner of each.
        margin_m: (K,) distances to keep around them.
        layers: (K,) layers that they concern.
        cell_starts: (X * Y + 1,) first entry in `near` of each cell of a grid.
        near: numbers of the obstacles near cells.
        origin_m: (2,) m, lower corner of the grid.
        shape: (2,) numbers of cells.
    """

    corners: Floats
    starts: Ints
    margin_m: Floats
    layers: Ints
    cell_starts: Ints
    near: Ints
    origin_m: Floats
    shape: Ints


class Discs(NamedTuple):
    """Discs that pieces of furniture cover: middles (P, 2), radii (P,) and layers (P,)."""

    middle_m: Floats
    radius_m: Floats
    layers: Ints


class Candidates(NamedTuple):
    """N pieces that may be put up, in order of preference.

    Attributes:
        discs: discs of all pieces.
        starts: (N + 1,) first disc of each piece.
        choice: (N,) number of alternatives, which follow each other: only the first that fits is put up; -1: none.
        run: (N,) pieces with one number may touch; -1: none.
    """

    discs: Discs
    starts: Ints
    choice: Ints
    run: Ints


def make_obstacles(outlines: list[Floats], margin_m: list[float], layers: list[int], area: Floats) -> Obstacles:
    """Sort outlines (each (K, 2) m, convex) into a grid over an area, its least and greatest x and y (2, 2) m."""
    corners = np.concatenate([np.zeros((0, 2)), *outlines])
    starts = np.cumsum([0, *(len(outline) for outline in outlines)])
    margins, origin = np.array(margin_m, dtype=np.float64), area[0] - _CELL_M
    shape = np.ceil((area[1] + _CELL_M - origin) / _CELL_M).astype(np.int64)
    low, high = (
        ends.reduceat(corners, starts[:-1]) if outlines else np.zeros((0, 2)) for ends in (np.minimum, np.maximum)
    )
    reach = (margins + _LARGEST_M)[:, None]
    first = np.clip(np.floor((low - reach - origin) / _CELL_M), 0, shape).astype(np.int64)
    last = np.clip(np.floor((high + reach - origin) / _CELL_M) + 1, 0, shape).astype(np.int64)
    rows, columns = np.maximum(last - first, 0).T
    which, place = numbered(rows * columns)
    cell = (first[which, 0] + place // columns[which]) * shape[1] + first[which, 1] + place % columns[which]
    cell_starts = np.concatenate([[0], np.cumsum(np.bincount(cell, minlength=int(shape.prod())))])
    near = which[np.argsort(cell, kind="stable")]
    return Obstacles(corners, starts, margins, np.array(layers, dtype=np.int64), cell_starts, near, origin, shape)


@njit(cache=True, nogil=True)
def settle(candidates: Candidates, obstacles: Obstacles, standing: Discs, gap_m: float) -> tuple[Mask, Discs]:
    """Decide on pieces one after the other; none fit beyond the grid of obstacles.

    `standing` are discs of pieces put up before; `gap_m` is kept between two pieces on the ground.

    Returns:
        The mask (N,) of the pieces that fit, and the discs of all pieces that stand then.
    """
    discs, starts, run = candidates.discs, candidates.starts, candidates.run
    middle = np.concatenate((standing.middle_m, discs.middle_m))
    radius = np.concatenate((standing.radius_m, discs.radius_m))
    layers = np.concatenate((standing.layers, discs.layers))
    owner, count = np.full(len(radius), -1), len(standing.radius_m)
    fits, chosen = np.zeros(len(run), np.bool_), -1
    for n in range(len(run)):
        if candidates.choice[n] >= 0 and candidates.choice[n] == chosen:
            continue
        free = True
        for p in range(starts[n], starts[n + 1]):
            free = free and _is_free(discs.middle_m[p], discs.radius_m[p], discs.layers[p], obstacles)
            for q in range(count if free else 0):
                apart = discs.radius_m[p] + radius[q] + gap_m
                dx, dy = discs.middle_m[p, 0] - middle[q, 0], discs.middle_m[p, 1] - middle[q, 1]
                same = (discs.layers[p] & layers[q] & (GROUND | CROWN)) != 0
                if same and dx * dx + dy * dy < apart * apart and not (run[n] >= 0 and run[n] == owner[q]):
                    free = False
                    break
        if free:
            fits[n], chosen = True, candidates.choice[n]
            for p in range(starts[n], starts[n + 1]):
                middle[count], radius[count], layers[count] = discs.middle_m[p], discs.radius_m[p], discs.layers[p]
                owner[count] = run[n]
                count += 1
    return fits, Discs(middle[:count], radius[:count], layers[:count])


@njit(cache=True, nogil=True)
def are_free(spots: Floats, radius_m: float, layers: int, obstacles: Obstacles) -> Mask:
    """Return the mask (N,) of the discs around points (N, 2) m that keep the margins of all obstacles in layers."""
    free = np.zeros(len(spots), np.bool_)
    for n in range(len(spots)):
        free[n] = _is_free(spots[n], radius_m, layers, obstacles)
    return free


@njit(cache=True, nogil=True)
def _is_free(spot: Floats, radius: float, layers: int, obstacles: Obstacles) -> bool:
    """Return whether a disc keeps the margins of all obstacles in its layers."""
    i, j = np.floor((spot[0] - obstacles.origin_m[0]) / _CELL_M), np.floor((spot[1] - obstacles.origin_m[1]) / _CELL_M)
    if not (0 <= i < obstacles.shape[0] and 0 <= j < obstacles.shape[1]):
        return False
    cell = int(i) * obstacles.shape[1] + int(j)
    for n in range(obstacles.cell_starts[cell], obstacles.cell_starts[cell + 1]):
        k = obstacles.near[n]
        if not layers & obstacles.layers[k]:
            continue
        if distance_to(spot, obstacles.corners, obstacles.starts[k], obstacles.starts[k + 1]) < (
            obstacles.margin_m[k] + radius
        ):
            return False
    return True


@njit(cache=True, nogil=True)
def distance_to(spot: Floats, corners: Floats, first: int, end: int) -> float:
    """Return the distance of a point (2,) from the convex outline of `corners` `first` to `end`; 0 inside of it."""
    left, right, nearest = False, False, np.inf
    for c in range(first, end):
        after = c + 1 if c + 1 < end else first
        ex, ey = corners[after, 0] - corners[c, 0], corners[after, 1] - corners[c, 1]
        dx, dy = spot[0] - corners[c, 0], spot[1] - corners[c, 1]
        turn, length2 = ex * dy - ey * dx, ex * ex + ey * ey
        left, right = left or turn > 0, right or turn < 0
        along = min(max((dx * ex + dy * ey) / length2, 0.0), 1.0) if length2 > 0 else 0.0
        nearest = min(nearest, exact.hypot(dx - along * ex, dy - along * ey))
    inside = end - first > 2 and not (left and right)
    return 0.0 if inside else nearest


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


def obstacles_of(layout: Layout, area: Floats, *, swept: bool = True) -> Obstacles:
    """Return the obstacles within an area, its least and greatest x and y (2, 2) m.

    Without `swept`, pieces may stand where long vehicles swing out, or cut a bend.
    """
    outlines, margins, layers = list[Floats](), list[float](), list[int]()

    def add(shapes: list[Floats] | tuple[Floats, ...], margin_m: float, layer: int) -> None:
        outlines.extend(shapes)
        margins.extend([margin_m] * len(shapes))
        layers.extend([layer] * len(shapes))

    for lane in layout.network.lanes.values():
        add(_pieces_of(lane), lane.width / 2 + KERB_M + (_sweep_m(lane) if swept else 0.0), GROUND)
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
    add([_outline(each) for each in layout.bystanders], 0.2, GROUND)
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
    """Return outlines (4 or 1, 2) m of ground that an upright part covers below people's heads; none of a surface."""
    low_m = part.vertices[:, 2].min()
    if np.ptp(part.vertices[:, 2]) < _UPRIGHT_M or low_m > _HEAD_M:
        return []
    if part.boxes is not None and part.closed:
        found = [rectangle_at(box[:2], box[3:5], float(box[6])) for box in part.boxes if box[2] < box[5] / 2 + _HEAD_M]
        if found:
            return found
    below = part.vertices[part.vertices[:, 2] < low_m + _HEAD_M]
    (x, y), (far_x, far_y) = below[:, :2].min(axis=0), below[:, :2].max(axis=0)
    if exact.hypot(far_x - x, far_y - y) < _THIN_M:  # a mast or a stem: the same from all sides
        return [below[:, :2].mean(axis=0)[None]]
    return [np.array([[x, y], [far_x, y], [far_x, far_y], [x, far_y]])]


def _crown(part: StaticPart) -> list[Floats]:
    """Return the outline (4, 2) m of foliage over people's heads."""
    if part.boxes is None or part.opacity == 1 or part.vertices[:, 2].max() <= _HEAD_M + 1.0:
        return []
    return [rectangle_at(box[:2], box[3:5], float(box[6])) for box in part.boxes]


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
    return lane.positions(lane.stations(_CHORD_M), 0.0)


def _pieces_of(lane: Lane) -> list[Floats]:
    """Return straight pieces (2, 2) m of a lane's middle line, of tight bends with their tangents at both ends."""
    points = middle_of(lane)
    if lane.tightest_m < _WIDE_BEND_M:
        headings = lane.heading_at(0.0) + np.pi, lane.heading_at(lane.length)
        before, beyond = (_SWINGING_M * np.array([exact.cos(heading), exact.sin(heading)]) for heading in headings)
        points = np.vstack([points[0] + before, points, points[-1] + beyond])
    return list(np.stack([points[:-1], points[1:]], axis=1))


def _sweep_m(lane: Lane) -> float:
    """Return the distance by which the longest vehicles leave a lane."""
    if lane.tightest_m >= _WIDE_BEND_M:
        return 0.0
    return float(cut_inside_m(_BUS_M, lane.tightest_m)) / 2


def _bay_outline(bay: Bay) -> Floats:
    size = _USUAL_BAY_M if bay.label is None else _BAY_M.get(bay.label, _USUAL_BAY_M)
    return rectangle_at(np.array([bay.x_m, bay.y_m]), np.array(size), bay.heading_rad)


def _outline(bystander: Bystander) -> Floats:
    size = np.array([bystander.length_m, bystander.width_m])
    return rectangle_at(np.array([bystander.x_m, bystander.y_m]), size, bystander.heading_rad)


def rectangle_at(middle: Floats, size: Floats, yaw: float) -> Floats:
    """Return the corners (4, 2) m of a rectangle around a place, of extents (2,) m ahead and across."""
    ahead, left = np.array([[exact.cos(yaw), exact.sin(yaw)], [-exact.sin(yaw), exact.cos(yaw)]])
    corners = np.array([[1.0, 1.0], [-1.0, 1.0], [-1.0, -1.0], [1.0, -1.0]]) * size / 2
    rectangle: Floats = middle + corners[:, :1] * ahead + corners[:, 1:] * left
    return rectangle
