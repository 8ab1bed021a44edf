"""What lies beside the roads of a map: pavements, shoulders, bays, verges and islands."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from coopsim.data.maps.dress.field import Field
from coopsim.data.maps.dress.roads import Roads, is_gutter, pieces_of
from coopsim.data.maps.dress.surfaces import area_m2, convex_parts, off_road, strip
from coopsim.data.maps.dress.ways import usual_m
from coopsim.data.maps.street_map import LaneKind, StreetMap, edges_of
from coopsim.geometry import exact
from coopsim.geometry.se3 import Floats
from coopsim.world.places.description import SURFACES, MapArea, line_of

_KINDS: dict[LaneKind, str] = {
    "walk": "pavement",
    "shoulder": "road",
    "cycle": "road",
    "shared": "road",
    "park": "parking",
    "rail": "yard",
    "other": "grass",
}
_AREAS = {"walk": "pavement", "park": "parking"}
_UNDER_LANE_M, _BESIDE_M = -0.1, 1.0  # from kerbs; from people's ways to where they should be
_SLIT_M, _ISLAND_M = 1.0, 8.0  # mean widths of gaps between lanes that are road, and at most of raised islands


def paved(streets: StreetMap, roads: Roads, beside: list[Floats]) -> tuple[MapArea, ...]:
    """Return the surfaces beside the roads: of lanes and areas of a map, and between kerbs and people's ways."""
    found: dict[str, list[Floats]] = {kind: [] for kind in SURFACES}
    for lane in streets.lanes.values():
        if lane.kind in _KINDS:
            kind = "pavement" if is_gutter(lane) else _KINDS[lane.kind]
            found[kind] += strip(*edges_of(lane.line, lane.width_m))
    for area in streets.areas:
        found[_AREAS[area.kind]] += convex_parts(area.outline)
    found["pavement"] += _bands(roads.field, beside, usual_m(streets, roads.field))
    for kind, outline in _islands(roads):
        found[kind] += convex_parts(outline)
    for piece in roads.pieces[roads.beyond]:
        found["road"] += strip(*edges_of(piece[:4].reshape(2, 2), 2 * piece[4:]))
    for kind in ("pavement", "grass"):
        found[kind] = off_road(found[kind], roads.field)
    return tuple(MapArea(line_of(outline), kind) for kind, outlines in found.items() for outline in outlines)


def _bands(ground: Field, beside: list[Floats], wide_m: float) -> Iterator[Floats]:
    """Yield convex pieces (K, 2) m between the kerb and people's ways along it, which are `wide_m` from it."""
    if not beside:
        return
    ways = ground.of(np.concatenate([pieces_of(line) for line in beside]))
    for line in ground.lines(_UNDER_LANE_M):
        kerb = np.concatenate([line, line[:1]])
        away = kerb + wide_m * ground.away(kerb)
        cuts = np.flatnonzero(np.diff(ways.at(away) < _BESIDE_M)) + 1
        for part, outer in zip(np.split(kerb, cuts), np.split(away, cuts), strict=True):
            if len(part) > 1 and ways.at(outer[:1])[0] < _BESIDE_M:
                yield from strip(outer, part)


def _islands(roads: Roads) -> Iterator[tuple[str, Floats]]:
    """Yield the outlines (N, 2) m of gaps between lanes, which are road, and of islands, which are pavement."""
    for line in roads.field.lines(0.0):
        length_m = float(exact.norm(np.roll(line, -1, axis=0) - line).sum())
        width_m = -2 * area_m2(line) / max(length_m, 1e-9)
        if 0.0 < width_m < _ISLAND_M:
            yield ("road" if width_m < _SLIT_M else "pavement"), line
