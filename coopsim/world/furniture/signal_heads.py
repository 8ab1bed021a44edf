"""Heads of traffic lights beside their stop lines, and the lamps on them."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from coopsim.geometry import exact
from coopsim.geometry.se3 import Floats, wrap_angle
from coopsim.types import Ints
from coopsim.world.furniture.kinds import KINDS
from coopsim.world.places.description import MapFurniture
from coopsim.world.places.layout import Layout
from coopsim.world.places.signals import PRIORITY, RED, YELLOW, by_line
from coopsim.world.snapshot import StaticPart

LAMPS = ((RED, 0.16, (255, 48, 32)), (YELLOW, 0.475, (255, 190, 20)), (PRIORITY, 0.79, (30, 255, 110)))
"""Letter at which a lamp shines, its middle below the top of the head, m, and its colour."""

_RADIUS_M, _FRONT_M = 0.11, 0.306
_REFLECTIVITY = 0.1
_SAME_M = 0.01
_NEIGHBOUR_M = 1.0  # between the ends of stop lines side by side
_ALIKE = 0.9  # cosine of the angle between two of them
_ALONG_M = np.array([0.0, -0.5, 0.5, -1.0, 1.0, -1.5, 1.5, -2.0, 2.0, -3.0, -4.0, -5.0])  # behind the line
_ASIDE_M = 0.6 + 0.1 * np.arange(14)  # from the edge of the lane to a head
_SEEN_M, _BEHIND_M, _BESIDE_M = 45.0, 8.0, 15.0  # from a stop line to its head


def head_stands(stop_lines: Sequence[Floats]) -> tuple[Floats, Ints]:
    """Return possible stands of heads (N, 3), m and rad, one head for lines side by side, and the head of each (N,).

    On the right of the lanes first, then on their left.
    """
    lines = np.array([stop_lines[numbers[0]] for numbers in by_line(stop_lines)]).reshape(-1, 2, 2)
    ahead, left = _directions(lines)
    gap_m = exact.norm(lines[:, None, 1] - lines[:, 0], axis=2)
    alike = exact.dot(left[:, None], left[None]) > _ALIKE
    beside = (gap_m < _NEIGHBOUR_M) & alike & ~np.eye(len(lines), dtype=np.bool_)  # the second is left of the first
    along_m, aside_m = (each.ravel()[:, None] for each in np.meshgrid(_ALONG_M, _ASIDE_M, indexing="ij"))
    stands = []
    for first in np.flatnonzero(~beside.any(axis=0)).tolist():
        last = first
        while beside[last].any():
            last = int(beside[last].argmax())
        ends = (first, lines[first, 0], -1.0), (last, lines[last, 1], 1.0)
        spots = [end + along_m * ahead[k] + side * aside_m * left[k] for k, end, side in ends]
        facing = float(exact.arctan2(-ahead[first, 1], -ahead[first, 0]))
        stands.append(np.column_stack([np.vstack(spots), np.full(2 * len(along_m), facing)]))
    return np.vstack([np.zeros((0, 3)), *stands]), np.repeat(np.arange(len(stands)), 2 * len(along_m))


def crosswalks_without_light(layout: Layout) -> list[Floats]:
    """Return the outlines of a place's crosswalks without a light."""
    if layout.footways is None or not layout.signals:
        return list(layout.road_map.crosswalks)
    pairs = np.array([pair for signal in layout.signals for pair in signal.crosswalks], dtype=np.int64).reshape(-1, 2)
    lit = layout.footways.nodes[pairs].mean(axis=1)
    outlines = layout.road_map.crosswalks
    return [each for each in outlines if not (exact.norm(lit - each.mean(axis=0), axis=1) < _SAME_M).any()]


def lamp_parts(
    pieces: Sequence[MapFurniture], layout: Layout, relief_heights: Callable[[Floats], Floats] | None = None
) -> tuple[StaticPart, ...]:
    """Build the lamps of heads among furniture that stand at the lights that they show; see `furnishing_parts`."""
    heads = [piece for piece in pieces if piece.kind == "traffic_light" and piece.at is not None]
    if not layout.signals or not heads:
        return ()
    at, lights = np.array([head.at for head in heads]), _straight_first(layout)
    ground = np.zeros(len(at)) if relief_heights is None else relief_heights(at)
    found = list[StaticPart]()
    for head, place, ground_m in zip(heads, at, ground.tolist(), strict=True):
        heading = np.radians(head.heading_deg or 0.0)
        light = _light_at(place, heading, layout.road_map.stop_lines, lights)
        usual_m = KINDS["traffic_light"].sizes["height_m"].usual
        top_m = ground_m + (usual_m if head.height_m is None else head.height_m)
        found += [] if light is None else [_lamp(place, heading, top_m, light, *lamp) for lamp in LAMPS]
    return tuple(found)


def _directions(lines: Floats) -> tuple[Floats, Floats]:
    """Return unit vectors (N, 2) of travel over stop lines (N, 2, 2), from right to left, and to the left."""
    across = lines[:, 1] - lines[:, 0]
    left = across / np.maximum(exact.norm(across, axis=1), 1e-9)[:, None]
    return np.column_stack([left[:, 1], -left[:, 0]]), left


def _straight_first(layout: Layout) -> list[int]:
    """Return the numbers of the lights, those of the straightest movements first."""
    lanes = [layout.network.get_lane((*road, 0)) for signal in layout.signals for road in signal.roads]
    turn = [abs(float(wrap_angle(lane.heading_at(lane.length) - lane.heading_at(0.0)))) for lane in lanes]
    return sorted(range(len(turn)), key=lambda k: (round(turn[k], 3), k))


def _light_at(place: Floats, heading: float, stop_lines: Sequence[Floats], lights: list[int]) -> int | None:
    """Return the light that a head at a place (2,) m shows: of the nearest line it faces; None: there is none."""
    lines = np.array(stop_lines)[lights]
    ahead, left = _directions(lines)
    offset = place - lines.mean(axis=1)
    along, aside = exact.dot(offset, ahead), exact.dot(offset, left)
    faces = ahead[:, 0] * exact.cos(heading) + ahead[:, 1] * exact.sin(heading) < -0.7
    near = faces & (along > -_BEHIND_M) & (along < _SEEN_M) & (np.abs(aside) < _BESIDE_M)
    away_m = np.where(near, np.round(exact.norm(offset, axis=1), 3), np.inf)
    return lights[int(away_m.argmin())] if near.any() else None


def _lamp(
    place: Floats, heading: float, top_m: float, light: int, letter: str, below_m: float, color: tuple[int, int, int]
) -> StaticPart:
    """Build a disc that looks ahead; while it is dark it has a fifth of its colour."""
    turn = np.arange(8) * np.pi / 4
    aside, up = _RADIUS_M * exact.cos(turn), _RADIUS_M * exact.sin(turn)
    cos, sin = exact.cos(heading), exact.sin(heading)
    x, y = _FRONT_M * cos - aside * sin + place[0], _FRONT_M * sin + aside * cos + place[1]
    fan = np.arange(1, 7)
    faces = np.column_stack([np.zeros(6, dtype=np.int64), fan, fan + 1])
    red, green, blue = (value // 5 for value in color)
    return StaticPart(
        "traffic light",
        np.column_stack([x, y, top_m - below_m + up]),
        faces,
        (red, green, blue),
        _REFLECTIVITY,
        closed=False,
        boxes=np.zeros((0, 7)),
        lamp=(light, letter, color),
    )
