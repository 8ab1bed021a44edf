"""The shape of the ground: Groundworks lay a place on kerbs, crowned roads, humps and water.

Roads are crowned by carriageways: lanes that lie side by side, whichever way they lead, between two junctions.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from coopsim.geometry import exact
from coopsim.geometry.outlines import along_of
from coopsim.geometry.se3 import Floats
from coopsim.support.arrays import numbered
from coopsim.support.kernels import njit
from coopsim.types import Ints
from coopsim.world.models.surfaces import wet_albedo
from coopsim.world.places.layout import ASPHALT, PAVEMENT, Layout
from coopsim.world.places.polyline import PolylineLane
from coopsim.world.places.relief import Relief, drape, laid_on, with_triangles
from coopsim.world.places.road_network import CircularLane, Lane, LaneIndex, Road, RoadNetwork
from coopsim.world.relief.kerbs import kerb_faces, pavement_tops
from coopsim.world.relief.surfaces import Hump, crown_triangles, normals_of
from coopsim.world.relief.terrain import CELL_M, Terrain
from coopsim.world.snapshot import StaticPart

_ROAD_REFLECTIVITY, _PAVEMENT_REFLECTIVITY = 0.18, 0.35
_PAVING, _KERB = (104, 92, 86), (172, 170, 163)
_BESIDE = ("ground", "grass", "yard", "parking")  # surfaces below the road's
_LAID = ("road", "pavement")  # further parts that are cut to lie on a terrain
_CLOSER = 0.3  # factor on their depths: things on them stand at the height 0
_WATER_M, _PAINT_M = 0.004, 0.008  # over the road: in this order water and paint lie on it
_GAMMA = 2.2  # of colours


@dataclass(frozen=True, slots=True)
class Groundworks:
    """The shape of the ground.

    Attributes:
        kerb_m: height of the pavements over the roads.
        crown: fall of the roads from the middle to the gutters, m per m.
        humps: on the roads.
        wet: outlines (K, 2) m of water on the roads, convex, counter-clockwise.
        terrain: on which all of these lie; None: it is flat.
    """

    kerb_m: float = 0.0
    crown: float = 0.0
    humps: tuple[Hump, ...] = ()
    wet: tuple[Floats, ...] = ()
    terrain: Terrain | None = None

    def applied(self, layout: Layout, flat: Collection[Road]) -> Layout:
        """Return a layout on this ground, without crowns on movements and `flat` roads; flat ground changes nothing."""
        flat_ground = self.kerb_m == 0 and self.crown == 0 and not self.humps and not self.wet
        if flat_ground and self.terrain is None:
            return layout
        crowned = carriageways(layout.network, {*layout.movements, *flat}) if self.crown > 0 else []
        crown = _joined([crown_triangles(*road, self.crown) for road in crowned])
        humps = _joined([hump.triangles(Relief(crown)) for hump in self.humps])
        raised, terrain, below = layout.road_map.pavements if self.kerb_m > 0 else (), self.terrain, []
        tops = pavement_tops(raised, self.kerb_m)
        kerbs = kerb_faces(raised, self.kerb_m, np.inf if terrain is None else CELL_M / 4)
        if terrain is not None:
            crown, humps, tops = (terrain.laid(each) for each in (crown, humps, tops))
            kerbs, below = terrain.followed(kerbs), [terrain.triangles]
        road = Relief(np.concatenate([*below, crown, humps]))
        relief = Relief(np.concatenate([road.grid.triangles, tops]))
        parts = [
            *(
                _on_ground(part, road, relief, terrain)
                for part in layout.static
                if part.name != "pavement" or not raised
            ),
            *_surface("road", crown, ASPHALT, _ROAD_REFLECTIVITY),
            *_surface("hump", humps, _PAVING, _ROAD_REFLECTIVITY),
            *_surface("pavement", tops, PAVEMENT, _PAVEMENT_REFLECTIVITY),
            *_surface("kerb", kerbs, _KERB, _PAVEMENT_REFLECTIVITY),
            *self._water(road),
        ]
        rsus = tuple(relief.raised(unit) for unit in layout.rsus)
        return replace(layout, static=tuple(parts), rsus=rsus, relief=relief)

    def _water(self, road: Relief) -> list[StaticPart]:
        """Build the patches of water on the road."""
        laid = _lifted(drape(pavement_tops(self.wet, 0.0), road.grid), _WATER_M)
        albedo = wet_albedo(np.array([_ROAD_REFLECTIVITY]))[0]
        light = wet_albedo(exact.settled((np.array(ASPHALT) / 255) ** _GAMMA))
        red, green, blue = np.round(255 * exact.settled(light ** (1 / _GAMMA))).astype(int).tolist()
        return _surface("water", laid, (red, green, blue), float(albedo))


def _on_ground(part: StaticPart, road: Relief, relief: Relief, terrain: Terrain | None) -> StaticPart:
    """Return a part of flat ground as it is on this one: paint lies on the road, and masts stand where they are."""
    if part.name == "marking":
        return laid_on(part, road.grid, _PAINT_M)
    if part.name in _BESIDE:
        part = replace(part, vertices=part.vertices * [1.0, 1.0, _CLOSER])
    if terrain is not None and part.name in (*_BESIDE, *_LAID):
        return with_triangles(part, terrain.laid(part.vertices[part.faces]))
    if part.name == "mast":
        rise_m = relief.heights(part.vertices[:, :2].mean(axis=0)[None])[0]
        return replace(part, vertices=_lifted(part.vertices, float(rise_m)))
    return part


def _surface(name: str, triangles: Floats, color: tuple[int, int, int], reflectivity: float) -> list[StaticPart]:
    """Build a part of triangles (T, 3, 3) m; none of none."""
    if not len(triangles):
        return []
    faces = np.arange(3 * len(triangles)).reshape(-1, 3)
    return [StaticPart(name, triangles.reshape(-1, 3), faces, color, reflectivity, closed=False)]


def _lifted(points: Floats, up_m: float) -> Floats:
    lifted: Floats = points + np.array([0.0, 0.0, up_m])
    return lifted


def _joined(parts: Sequence[Floats]) -> Floats:
    return np.concatenate([np.zeros((0, 3, 3)), *parts])


_SAGITTA_M = 0.1  # between a bend and its chords, from which a crown is 2.5 mm off
_SAMPLE_M = 4.0  # between the places where a carriageway's edges are measured
_SAME_M = 0.1  # by which its edges move at most from one to the next, measured from a lane's middle
_KINK_RAD = np.radians(20.0)  # at which lanes still lead on; places from files have no sharper ones
_TOUCH_M = 0.3  # largest gap between the edges of two lanes side by side
_ABREAST = 0.9  # cosine of the angle up to which lanes lie side by side
_OVER_M = 1.0  # by which lanes lie on one another in forks, and nowhere else
_MOST_LANES, _FARTHEST_M = 32, 100.0  # side by side, and from the middle of a lane to that of one beside it
_JUNCTION = 1_000_000_000  # rank of flat roads, higher than any other


class Carriageway(NamedTuple):
    """A strip of road.

    Attributes:
        line: (K, 2) m, along its middle.
        half_m: from the middle to each edge.
    """

    line: Floats
    half_m: float


def carriageways(network: RoadNetwork, flat: Collection[Road]) -> list[Carriageway]:
    """Return the carriageways of a place.

    Lanes are followed from node to node. Of those side by side the longest decides how far the carriageway goes. Where
    lanes join or leave it on the way it ends, and another one begins. There is none beside `flat` roads, such as
    movements over a junction, nor in forks.
    """
    lanes = network.lanes
    chains = _chains({index: lane for index, lane in lanes.items() if index[:2] not in flat})
    if not chains:
        return []
    points = dict(zip(lanes, lane_points(list(lanes.values())), strict=True))
    length_m = [sum(lanes[index].length for index in chain) for chain in chains]
    rank = dict.fromkeys(lanes, _JUNCTION)
    for k, number in enumerate(np.argsort(length_m, kind="stable").tolist()):
        rank |= dict.fromkeys(chains[number], k)
    by_lane = {index: _pieces(points[index], lane, rank[index]) for index, lane in lanes.items()}
    pieces = np.concatenate(list(by_lane.values()))
    found: list[Carriageway] = []
    for chain in chains:
        line = np.concatenate([*(points[index][:-1] for index in chain), points[chain[-1]][-1:]])
        places, along_m = _places(np.concatenate([by_lane[index] for index in chain]))
        found += _runs(line, along_m, *_edges(places, pieces), rank[chain[0]])
    return found


def _runs(line: Floats, along_m: Floats, low: Floats, high: Floats, longest: Ints, rank: int) -> list[Carriageway]:
    """Return the carriageways along a line (K, 2) of lanes of a rank, split where the lanes' edges move.

    `along_m` (P,) are places on the line, `low` and `high` (P,) m the right and left edges from the line to its left,
    and `longest` (P,) the highest rank of the lanes side by side.
    """
    at_m = along_of(line)
    own = longest == rank
    moved = np.maximum(np.abs(np.diff(low)), np.abs(np.diff(high))) > _SAME_M
    cut = np.flatnonzero(moved | (own[1:] != own[:-1])) + 1
    found, ends = [], [0, *cut.tolist(), len(own)]
    for first, end in pairwise(ends):
        if not own[first]:
            continue
        start_m = 0.0 if first == 0 else along_m[first]
        end_m = at_m[-1] if end == len(own) else along_m[end - 1]
        kept_m = np.concatenate([[start_m], at_m[(at_m > start_m) & (at_m < end_m)], [end_m]])
        right_m, left_m = float(low[first:end].max()), float(high[first:end].min())
        if end_m > start_m and left_m > right_m:
            part = np.stack([np.interp(kept_m, at_m, line[:, axis]) for axis in range(2)], axis=1)
            found.append(Carriageway(_shifted(part, (right_m + left_m) / 2), (left_m - right_m) / 2))
    return found


def lane_points(lanes: Sequence[Lane]) -> list[Floats]:
    """Return points (K, 2) m on the middles of lanes, from the start of each to its end."""
    points = _arcs_and_lines([lane for lane in lanes if not isinstance(lane, PolylineLane)])
    return [lane.points if isinstance(lane, PolylineLane) else next(points) for lane in lanes]


def _arcs_and_lines(lanes: Sequence[Lane]) -> Iterator[Floats]:
    if not lanes:
        return iter(())
    # A place on a lane is one on the line between two points, plus one on an arc; one of the two is nothing.
    rows = np.array([_shape(lane) for lane in lanes])
    counts = (
        np.maximum(np.ceil(np.array([lane.length for lane in lanes]) / _chord_m(rows[:, 4])), 1).astype(np.int64) + 1
    )
    lane, place = numbered(counts)
    row, share = rows[lane], place / (counts - 1)[lane]
    phase = row[:, 5] + share * (row[:, 6] - row[:, 5])
    points = row[:, :2] + share[:, None] * (row[:, 2:4] - row[:, :2])
    points += row[:, 4, None] * np.stack([exact.cos(phase), exact.sin(phase)], axis=1)
    return iter(np.split(points, np.cumsum(counts)[:-1]))


def _shape(lane: Lane) -> list[float]:
    """Return two points, x and y, and radius, first and last angle of an arc around them."""
    if isinstance(lane, CircularLane):
        return [*lane.center, *lane.center, lane.radius, lane.start_phase, lane.end_phase]
    return [*lane.position(0.0, 0.0), *lane.position(lane.length, 0.0), 0.0, 0.0, 0.0]


def _chord_m(radius_m: Floats) -> Floats:
    """Return the length (L,) of chords that are `_SAGITTA_M` from arcs (L,); a straight lane is one."""
    return np.where(radius_m > 0, np.sqrt(8 * radius_m * _SAGITTA_M), np.inf)


def _pieces(points: Floats, lane: Lane, rank: int) -> Floats:
    """Return start, end, half the width and rank of the straight pieces of a lane along points, (K - 1, 6)."""
    pieces = np.empty((len(points) - 1, 6))
    pieces[:, :2], pieces[:, 2:4], pieces[:, 4], pieces[:, 5] = points[:-1], points[1:], lane.width / 2, rank
    if isinstance(lane, PolylineLane):
        pieces[:, 4] = (lane.corners["width"][:-1] + lane.corners["width"][1:]) / 4
    return pieces


def _places(pieces: Floats) -> tuple[Floats, Floats]:
    """Return x, y, direction and half the width (P, 5) at places along pieces (S, 6), and how far along (P,) m."""
    along = pieces[:, 2:4] - pieces[:, :2]
    length_m = exact.hypot(along[:, 0], along[:, 1])
    counts = np.maximum(np.ceil(length_m / _SAMPLE_M), 1).astype(np.int64)
    own, place = numbered(counts)
    share = (place + 0.5) / counts[own]
    places = np.empty((len(own), 5))
    places[:, :2] = pieces[own, :2] + share[:, None] * along[own]
    places[:, 2:4], places[:, 4] = (along / length_m[:, None])[own], pieces[own, 4]
    along_m: Floats = (np.cumsum(length_m) - length_m)[own] + share * length_m[own]
    return places, along_m


def _chains(lanes: Mapping[LaneIndex, Lane]) -> list[list[LaneIndex]]:
    """Return lanes that follow each other; at a fork the straight one does, if there is only one."""
    onward: dict[tuple[str, int], list[LaneIndex]] = {}
    for index in lanes:
        onward.setdefault((index[0], index[2]), []).append(index)
    after: dict[LaneIndex, LaneIndex] = {}
    for index, lane in lanes.items():
        ways = onward.get((index[1], index[2]), [])
        ways = ways if len(ways) == 1 else [way for way in ways if lanes[way].tightest_m == np.inf]
        if len(ways) == 1 and abs(_turn(lane, lanes[ways[0]])) < _KINK_RAD and ways[0] not in after.values():
            after[index] = ways[0]
    chains = []
    for first in [index for index in lanes if index not in set(after.values())]:
        chain = [first]
        while chain[-1] in after:
            chain.append(after[chain[-1]])
        chains.append(chain)
    return chains


def _turn(lane: Lane, following: Lane) -> float:
    turn = following.heading_at(0.0) - lane.heading_at(lane.length)
    return float((turn + np.pi) % (2 * np.pi) - np.pi)


@njit(cache=True, nogil=True)
def _edges(places: Floats, pieces: Floats) -> tuple[Floats, Floats, Ints]:
    """Return right and left edge (P,) m and the highest rank (P,) of the lanes side by side at places on lanes.

    Where lanes lie on one another, as in a fork, the rank is `_JUNCTION`. Rows of `places` (P, 5) are x, y, direction
    and half the lane's width, of `pieces` (S, 6) start, end, half the width and rank of straight pieces of all lanes.
    """
    low, high, longest = -places[:, 4], places[:, 4].copy(), np.full(len(places), -1)
    spans = np.empty((_MOST_LANES, 3))
    for n in range(len(places)):
        met = _cross_section(places[n], pieces, spans)
        for _ in range(met):
            for k in range(met):
                if spans[k, 0] < high[n] + _TOUCH_M and spans[k, 1] > low[n] - _TOUCH_M:
                    low[n], high[n] = min(low[n], spans[k, 0]), max(high[n], spans[k, 1])
                    longest[n] = max(longest[n], int(spans[k, 2]))
        for k in range(met):
            for other in range(k):
                over_m = min(spans[k, 1], spans[other, 1]) - max(spans[k, 0], spans[other, 0])
                if over_m > _OVER_M and spans[k, 0] >= low[n] and spans[k, 1] <= high[n]:
                    longest[n] = _JUNCTION
    return low, high, longest


@njit(cache=True, nogil=True)
def _cross_section(place: Floats, pieces: Floats, spans: Floats) -> int:
    """Fill `spans` (N, 3) with right and left edge (m) and rank of lanes across a place; return their number.

    Lanes that cross the place's at an angle are left out, and those of streets far away.
    """
    x, y, ux, uy = place[0], place[1], place[2], place[3]
    met = 0
    for s in range(len(pieces)):
        ahead_a = (pieces[s, 0] - x) * ux + (pieces[s, 1] - y) * uy
        ahead_b = (pieces[s, 2] - x) * ux + (pieces[s, 3] - y) * uy
        if (ahead_a <= 0) == (ahead_b <= 0) or met == len(spans):
            continue
        left_a = (pieces[s, 1] - y) * ux - (pieces[s, 0] - x) * uy
        left_b = (pieces[s, 3] - y) * ux - (pieces[s, 2] - x) * uy
        abreast = abs(ahead_b - ahead_a) / exact.hypot(ahead_b - ahead_a, left_b - left_a)
        if abreast > _ABREAST:
            aside, half = left_a + ahead_a / (ahead_a - ahead_b) * (left_b - left_a), pieces[s, 4] / abreast
            if abs(aside) < _FARTHEST_M:
                spans[met] = aside - half, aside + half, pieces[s, 5]
                met += 1
    return met


def _shifted(line: Floats, left_m: float) -> Floats:
    """Return a line (K, 2) moved to its left, corners mitred."""
    return line + left_m * normals_of(line)
