"""Scenery of the built-in places: their outlines, ground, buildings and painted lines."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from coopsim.geometry.se3 import SE3, Floats
from coopsim.support.arrays import numbered
from coopsim.support.kernels import njit
from coopsim.types import Ints, Mask
from coopsim.world.places.layout import ASPHALT, GROUND, MARKING, PAVEMENT, box_part, flat_part, post_part, rectangle
from coopsim.world.places.polyline import CORNER, PolylineLane, piece_at, polyline_coordinates
from coopsim.world.places.road_network import Road, RoadNetwork, StraightLane
from coopsim.world.snapshot import RoadMap, StaticPart

Building = tuple[tuple[float, float], tuple[float, float], float]
"""Extent along x and along y, and height, m."""

PAINTS = ((176, 112, 88), (198, 186, 160), (140, 146, 158), (186, 150, 110))
COLORS = {
    **dict(zip(("brick", "sand", "slate", "ochre"), PAINTS, strict=True)),
    "white": (222, 220, 212),
    "rose": (204, 158, 146),
    "sage": (158, 170, 146),
    "umber": (124, 98, 80),
    "concrete": (160, 158, 152),
}
"""Colours of buildings; without one they have `PAINTS` by turns."""

_GROUND = rectangle((-260.0, 260.0), (-260.0, 260.0))


def town_map(
    lanes: Sequence[Floats],
    crosswalks: Sequence[Floats],
    pavements: Sequence[Floats],
    buildings: Sequence[Building],
    markings: Sequence[Floats] = (),
) -> RoadMap:
    """Return the outlines, with the buildings' footprints."""
    footprints = tuple(rectangle(x, y) for x, y, _ in buildings)
    return RoadMap(tuple(lanes), tuple(crosswalks), tuple(pavements), footprints, tuple(markings))


def town_parts(
    road_map: RoadMap,
    stripes: Sequence[Floats],
    buildings: Sequence[Building],
    rsus: Sequence[SE3],
    mast_m: float,
    ground: Floats = _GROUND,
) -> tuple[StaticPart, ...]:
    """Build ground, road, pavements, painted stripes, walls, and the masts of roadside units."""
    flat = [
        ("ground", [ground], -0.04, GROUND, 0.3),
        ("pavement", list(road_map.pavements), -0.01, PAVEMENT, 0.35),
        ("road", list(road_map.lanes), 0.0, ASPHALT, 0.18),
        ("marking", list(stripes), 0.02, MARKING, 0.8),
    ]
    return (
        *(flat_part(name, shapes, z_m, paint, share) for name, shapes, z_m, paint, share in flat if shapes),
        *walls_of(buildings),
        *(post_part("mast", rsu.translation[:2], mast_m) for rsu in rsus),
    )


def walls_of(buildings: Sequence[Building]) -> list[StaticPart]:
    """Build a block for each building."""
    return [
        box_part("building", (x[0], y[0], 0.0), (x[1], y[1], height_m), PAINTS[k % len(PAINTS)])
        for k, (x, y, height_m) in enumerate(buildings)
    ]


def corner_buildings(corner_m: float, signs: tuple[int, int], number: int) -> list[Building]:
    """Return three buildings in one quadrant: at the corner, hiding the roads from each other, and along each."""
    along, across, height = _SIZES[number % len(_SIZES)]
    near = corner_m
    spans = (
        ((near, near + along), (near, near + across), height),
        ((near + along + 9, near + along + 33), (near, near + 16), 0.7 * height),
        ((near, near + 16), (near + across + 9, near + across + 31), 0.8 * height),
    )
    return [(_signed(x, signs[0]), _signed(y, signs[1]), up) for x, y, up in spans]


def row_of_buildings(y_m: float, side: int) -> list[Building]:
    """Return a closed front along the x axis, `y_m` away on one side (1: left, -1: right) of it."""
    starts = (-88.0, -52.0, -14.0, 24.0, 58.0)
    lengths = (32.0, 34.0, 34.0, 30.0, 32.0)
    heights = (9.0, 14.0, 11.0, 16.0, 10.0)
    return [
        ((start, start + length), _signed((y_m, y_m + 16.0), side), height)
        for start, length, height in zip(starts, lengths, heights, strict=True)
    ]


_SIZES = ((34.0, 26.0, 14.0), (28.0, 36.0, 10.0), (40.0, 24.0, 18.0), (26.0, 30.0, 9.0))


def _signed(span: tuple[float, float], sign: int) -> tuple[float, float]:
    return span if sign > 0 else (-span[1], -span[0])


_DASH_M, _PERIOD_M, _HALF_M = 3.0, 7.5, 0.1
_TOUCH_M = 0.3  # largest gap between the edges of two lanes side by side


def lane_lines(network: RoadNetwork, movements: Collection[Road] = (), inner: int = 1) -> tuple[Floats, ...]:
    """Return dashes (4, 2) m, counter-clockwise, where two straight or two curved lanes lie side by side.

    There are none on `movements`. `inner` is the side of lanes on which oncoming ones are: 1 is the left, -1 the right.
    """
    every = [lane for index, lane in network.lanes.items() if index[:2] not in movements]
    lanes = [lane for lane in every if isinstance(lane, StraightLane)]
    curved = _curved_lines([lane for lane in every if isinstance(lane, PolylineLane)], inner)
    if not lanes:
        return curved
    start, along = (np.array([getattr(lane, name) for lane in lanes]) for name in ("start", "direction"))
    length_m, half_m = np.array([lane.length for lane in lanes]), np.array([lane.width for lane in lanes]) / 2
    left = inner * np.column_stack([-along[:, 1], along[:, 0]])  # the inner side
    counts = (length_m / _PERIOD_M).astype(np.int64)
    own, number = numbered(counts)
    at_m = (number + 0.5) * (length_m / np.maximum(counts, 1))[own]
    middle = start[own] + at_m[:, None] * along[own] + half_m[own, None] * left[own]
    offset = middle[:, None] - start
    ahead_m = (offset * along).sum(axis=2)
    aside_m = (offset * left).sum(axis=2)
    shared = (ahead_m > 0) & (ahead_m < length_m) & (np.abs(np.abs(aside_m) - half_m) < _TOUCH_M)
    # A line between opposite lanes is the inner edge of both: it belongs to the first.
    shared &= (aside_m < 0) | (np.arange(len(lanes)) > own[:, None])
    painted = shared.any(axis=1)
    reach, aside = _DASH_M / 2 * along[own], inner * _HALF_M * left[own]
    corners = (-reach - aside, reach - aside, reach + aside, aside - reach)
    return (*np.stack([middle + corner for corner in corners], axis=1)[painted], *curved)


def _curved_lines(lanes: Sequence[PolylineLane], inner: int) -> tuple[Floats, ...]:
    """Return dashes (4, 2) m, counter-clockwise, where two of the lanes lie side by side."""
    corners = np.concatenate([np.zeros(0, CORNER), *(lane.corners for lane in lanes)])
    first, found = np.cumsum([0, *(len(lane.corners) for lane in lanes)]), list[Floats]()
    for number, lane in enumerate(lanes):
        count = int(lane.length / _PERIOD_M)
        at_m = np.asarray((np.arange(count) + 0.5) * (lane.length / max(count, 1)), dtype=np.float64)
        middle = lane.positions(at_m, 0.0)
        left = lane.positions(at_m, inner) - middle  # the inner side
        middle += lane.widths_at(at_m)[:, None] / 2 * left
        reach, aside = _DASH_M / 2 * np.column_stack([left[:, 1], -left[:, 0]]), _HALF_M * left
        offsets = (-reach - aside, reach - aside, reach + aside, aside - reach)
        dashes = np.stack([middle + offset for offset in offsets], axis=1)
        found += list(dashes[_are_shared(middle, corners, first, number, inner)])
    return tuple(found)


@njit(cache=True, nogil=True)
def _are_shared(points: Floats, corners: NDArray[Any], first: Ints, own: int, inner: int) -> Mask:
    """Return the mask (N,) of points (N, 2) m on lane `own`'s inner edge that are on another lane's edge, too.

    An edge that is the inner one of both belongs to the first of them. Corners of lane k are those from `first[k]` on.
    """
    shared = np.zeros(len(points), np.bool_)
    for k in range(len(first) - 1):
        start, count = first[k], first[k + 1] - first[k]
        last = corners[first[k + 1] - 1]
        for n in range(len(points)):
            if k == own or shared[n]:
                continue
            along, aside = polyline_coordinates(corners, start, count, points[n, 0], points[n, 1])
            half_m = corners[piece_at(corners, start, count, along)].width / 2
            touches = 0 < along < last.along and abs(abs(aside) - half_m) < _TOUCH_M
            shared[n] = touches and (inner * aside < 0 or k > own)
    return shared
