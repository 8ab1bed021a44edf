"""The ground that roads of a map take: straight pieces of lanes and ways, and what is known of each."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from coopsim.data.maps.dress.field import Field, field_of
from coopsim.data.maps.street_map import DRIVEN, StreetLane, StreetMap
from coopsim.geometry import exact
from coopsim.geometry.outlines import keep_corners
from coopsim.geometry.se3 import Floats
from coopsim.types import Mask

_NARROWEST_M = 2.6  # drivers have at least as much
_STRAIGHT_M = 0.02
_BEYOND_M = 60.0  # that streets go on behind the end of their last lane
_ONE_ROAD_M, _ONE_WAY = 30.0, 0.7  # distance, and cosine of headings, up to which ends are those of one road
_CALM_M_S, _FAST_M_S = 60 / 3.6 + 0.01, 90 / 3.6 + 0.01
_NO_ROAD = ("walk", "other")
_GUTTER_M = 1.0  # shoulders that are narrower are part of the pavement


@dataclass(frozen=True, slots=True, eq=False)
class Roads:
    """Roads of a map.

    Attributes:
        field: distances from their surface.
        pieces: (S, 6) straight pieces: two ends and half the width at each, m.
        calm: (S,) whether the limit is at most 60 km/h, or unknown.
        fast: (S,) whether it is above 90 km/h.
        beyond: (S,) whether the piece goes on behind the end of a lane.
    """

    field: Field
    pieces: Floats
    calm: Mask
    fast: Mask
    beyond: Mask


def roads_of(streets: StreetMap) -> Roads:
    """Return the ground of a map's roads: all lanes but those to walk on, and ways over junctions."""
    parts, limits, beyond = list[Floats](), list[Floats](), list[Mask]()
    for line, width_m, limit, ends in _lines(streets):
        kept = keep_corners(np.column_stack([line, width_m / 2]), _STRAIGHT_M)
        line, width_m = line[kept], width_m[kept]
        pieces = np.column_stack([line[:-1], line[1:], width_m[:-1] / 2, width_m[1:] / 2])
        pieces = np.concatenate([pieces, *(_onward(pieces[each], each) for each in ends)])
        parts.append(pieces)
        limits.append(np.full(len(pieces), np.nan if limit is None else limit))
        beyond.append(np.arange(len(pieces)) >= len(line) - 1)
    limit_m_s, pieces, behind = np.concatenate(limits), np.concatenate(parts), np.concatenate(beyond)
    pieces[behind] = _side_by_side(pieces[behind])
    calm, fast = ~(limit_m_s > _CALM_M_S), limit_m_s > _FAST_M_S
    return Roads(field_of(pieces), pieces, calm, fast, behind)


def _lines(streets: StreetMap) -> Iterator[tuple[Floats, Floats, float | None, list[int]]]:
    """Yield the lines (K, 2) m of roads, widths (K,) m, limits (m/s), and ends behind which they go on: 0 or -1."""
    after = {name for name, onward in streets.links.items() if onward}
    after |= {way.start for way in streets.ways.values()}
    before = {way.end for way in streets.ways.values()} | {each for onward in streets.links.values() for each in onward}
    for lane in streets.lanes.values():
        if lane.kind in _NO_ROAD or is_gutter(lane):
            continue
        driven = lane.kind in DRIVEN
        ends = [end for end, met in ((0, before), (-1, after)) if driven and lane.id not in met]
        width_m = np.maximum(lane.width_m, _NARROWEST_M) if driven else lane.width_m
        yield lane.line[:, :2], width_m, lane.speed_m_s, ends
    for way in streets.ways.values():
        limit = streets.lanes[way.start].speed_m_s if way.speed_m_s is None else way.speed_m_s
        yield way.line[:, :2], np.maximum(way.width_m, _NARROWEST_M), limit, []


def is_gutter(lane: StreetLane) -> bool:
    """Return whether a lane is a shoulder on which nobody can stand."""
    return lane.kind == "shoulder" and float(lane.width_m.max()) < _GUTTER_M


def _onward(piece: Floats, end: int) -> Floats:
    """Return the straight piece (1, 6) that leads on from the beginning (0) or end (-1) of a piece (6,)."""
    start, stop = (piece[:2], piece[2:4]) if end else (piece[2:4], piece[:2])
    ahead = (stop - start) / max(float(exact.norm(stop - start)), 1e-9)
    half_m = piece[5] if end else piece[4]
    return np.array([[*stop, *(stop + _BEYOND_M * ahead), half_m, half_m]])


def _side_by_side(pieces: Floats) -> Floats:
    """Turn pieces (N, 6) behind ends that lie near each other to one direction, as lanes of a bend lie side by side."""
    starts, ahead = pieces[:, :2], (pieces[:, 2:4] - pieces[:, :2]) / _BEYOND_M
    near = exact.norm(starts[:, None] - starts) < _ONE_ROAD_M
    near &= exact.dot(ahead[:, None], ahead) > _ONE_WAY
    together: Floats = (near[..., None] * ahead).sum(axis=1)
    ahead = together / exact.norm(together, keepdims=True)
    return np.column_stack([starts, starts + _BEYOND_M * ahead, pieces[:, 4:]])


def driven_middles(streets: StreetMap) -> Floats:
    """Return the middles of driven lanes and ways as straight pieces (S, 6) without a width."""
    lines = [each.line[:, :2] for each in streets.lanes.values() if each.kind in DRIVEN]
    lines += [each.line[:, :2] for each in streets.ways.values()]
    return np.concatenate([pieces_of(line) for line in lines])


def pieces_of(line: Floats, half_m: float = 0.0) -> Floats:
    """Return the straight pieces (N - 1, 6) of a line (N, 2) m, of one width."""
    return np.column_stack([line[:-1], line[1:], np.full((len(line) - 1, 2), half_m)])
