"""A road's lanes: one piece for each lane of each lane section, with its middle line and width."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass

import numpy as np

from coopsim.data.maps.elements import Element
from coopsim.data.maps.notes import Notes
from coopsim.data.maps.opendrive.records import Cubics
from coopsim.data.maps.opendrive.surface import Surface
from coopsim.data.maps.street_map import DRIVEN, LaneKind
from coopsim.geometry.se3 import Floats

Key = tuple[str, int, int]
"""A piece of lane: road, index of its section, number of the lane."""

_DRIVE = "driving entry exit onRamp offRamp connectingRamp slipLane mwyEntry mwyExit HOV"
_KINDS: dict[str, LaneKind] = {
    **dict.fromkeys(_DRIVE.split(), "drive"),
    **dict.fromkeys(("bus", "taxi"), "bus"),
    "biking": "cycle",
    **dict.fromkeys(("sidewalk", "walking"), "walk"),
    "parking": "park",
    **dict.fromkeys(("shoulder", "border", "stop"), "shoulder"),
    **dict.fromkeys(("rail", "tram"), "rail"),
    "bidirectional": "shared",
    **dict.fromkeys(
        ["shared", "median", "curb", "restricted", "roadWorks", "special1", "special2", "special3"], "other"
    ),
}
_NO_LANE = "none"
_TO_M_S = {"": 1.0, "m/s": 1.0, "km/h": 1 / 3.6, "mph": 0.44704}
_LEAST_WIDTH_M, _LEAST_STEP_M, _SHORTEST_M = 0.02, 0.1, 1e-4


@dataclass(frozen=True, slots=True, eq=False)
class Piece:
    """A lane within a section.

    Attributes:
        key: road, section and number.
        kind: its use.
        line: its middle (K, 3) m, in the direction of travel.
        width_m: width (K,).
        along: whether travel is along the reference line.
        speed_m_s: limit; None: none is given.
        before: lanes that it is linked to at the start of the section, by number.
        after: likewise at the end.
    """

    key: Key
    kind: LaneKind
    line: Floats
    width_m: Floats
    along: bool
    speed_m_s: float | None
    before: tuple[int, ...]
    after: tuple[int, ...]

    @property
    def name(self) -> str:
        """Its id in the map."""
        return ".".join(map(str, self.key))

    @property
    def is_driven(self) -> bool:
        """True where vehicles drive on it, one way."""
        return self.kind in DRIVEN


@dataclass(frozen=True, slots=True, eq=False)
class Section:
    """A lane section: where it starts and ends, m, the numbers of its lanes, and those that have a piece."""

    start: float
    end: float
    numbers: frozenset[int]
    pieces: dict[int, Piece]


@dataclass(frozen=True, slots=True, eq=False)
class Lanes:
    """All lanes of a road: sections, and the numbers of lanes with their neighbours on the left and right."""

    sections: list[Section]
    lefts: dict[Key, Key]
    rights: dict[Key, Key]


def read_lanes(road: Element, surface: Surface, notes: Notes, *, left_hand: bool) -> Lanes:
    """Read the `<lanes>` of a road."""
    name = road.need("id")
    elements = sorted(road.at_path("lanes", "laneSection"), key=lambda each: each.number("s"))
    if not elements:
        raise road.error("must have <lanes> with a <laneSection>")
    offset = Cubics.read(road.at_path("lanes", "laneOffset"))
    length_m = surface.plan.length_m
    starts = [min(each.number("s"), length_m) for each in elements]
    speeds = _road_speeds(road)
    lanes = Lanes([], {}, {})
    for index, (element, start, end) in enumerate(zip(elements, starts, [*starts[1:], length_m], strict=True)):
        if end - start < _SHORTEST_M:
            lanes.sections.append(Section(start, end, frozenset(), {}))
            notes.repair("lane sections without length are left out", f"line {element.line}")
            continue
        cross = _Cross(element, surface, offset, start, end)
        notes.take_points(len(cross.s) * len(cross.lanes), element)
        section = Section(start, end, frozenset(cross.lanes), {})
        speed = [limit for at, limit in speeds if at <= (start + end) / 2]
        for number, piece in cross.pieces((name, index), left_hand, speed[-1] if speed else None, notes):
            section.pieces[number] = piece
        lanes.sections.append(section)
        _note_neighbours(section, lanes)
    return lanes


def _note_neighbours(section: Section, lanes: Lanes) -> None:
    numbers = sorted(section.pieces)
    for right, left in itertools.pairwise(numbers):
        first, second = section.pieces[right], section.pieces[left]
        adjacent = left - right == 1 or (right, left) == (-1, 1)
        if adjacent and first.along == second.along and first.is_driven and second.is_driven:
            pair = (first, second) if first.along else (second, first)
            lanes.lefts[pair[0].key], lanes.rights[pair[1].key] = pair[1].key, pair[0].key


class _Cross:
    """The cross-section of a lane section at all places along it."""

    def __init__(self, element: Element, surface: Surface, offset: Cubics, start: float, end: float) -> None:
        self.element, self.surface, self.start, self.end = element, surface, start, end
        found = element.at_path("left", "lane") + element.at_path("right", "lane")
        self.lanes = {each.lane_number("id"): each for each in reversed(found)}
        self.doubled = len(found) - len(self.lanes)
        self.lanes.pop(0, None)
        self.s = self._places(offset)
        self.offset = offset.at(self.s, end)

    def _places(self, offset: Cubics) -> Floats:
        """Return where to look (K,): at the grid of the reference line, where records start, and at both ends."""
        starts = [surface.starts for surface in (self.surface.elevation, self.surface.tilt, offset)]
        records = [each for lane in self.lanes.values() for each in lane.all("width", "border")]
        own = np.array([self.start + each.number("sOffset", 0.0) for each in records])
        inner = np.unique(np.concatenate([self.surface.plan.grid, self.surface.shapes.s, own, *starts]))
        inner = inner[(inner > self.start + _LEAST_STEP_M) & (inner < self.end - _LEAST_STEP_M)]
        cells = np.floor(inner / _LEAST_STEP_M)  # one place in each
        return np.concatenate([[self.start], inner[np.diff(cells, prepend=-1.0) > 0], [self.end]])

    def pieces(
        self, road: tuple[str, int], left_hand: bool, speed_m_s: float | None, notes: Notes
    ) -> list[tuple[int, Piece]]:
        """Return the lanes that have a width, from the middle to both sides."""
        if self.doubled:
            notes.repair("lanes with the number of another one are left out", f"line {self.element.line}")
        found = []
        for side in (1, -1):
            inner, level_t = self.offset, None
            for number in sorted((each for each in self.lanes if each * side > 0), key=abs):
                lane = self.lanes[number]
                outer = self._outer(lane, inner, side, notes)
                if lane.get("level") in ("true", "1"):
                    level_t = inner if level_t is None else level_t
                width = np.abs(outer - inner)
                if lane.get("type") == _NO_LANE:
                    notes.left_out["lanes of type none"] += 1
                elif width.max() < _LEAST_WIDTH_M:
                    notes.repair("lanes without width are left out", f"line {lane.line}")
                else:
                    line = self.surface.at(self.s, (inner + outer) / 2, self.end, level_t)
                    line[:, 2] += _raised(lane, self.start, self.s, self.end)
                    along = (number < 0) != left_hand
                    along ^= lane.get("direction") == "reversed"
                    found.append((number, self._piece(lane, (*road, number), line, width, along, speed_m_s)))
                inner = outer
        return found

    def _outer(self, lane: Element, inner: Floats, side: int, notes: Notes) -> Floats:
        """Return t (K,) of a lane's outer edge: by its width or, if it has none, by its border."""
        widths = lane.all("width")
        borders = lane.all("border")
        if widths or not borders:
            width = Cubics.read(widths, "sOffset", self.start).at(self.s, self.end)
            if (width < -_LEAST_WIDTH_M).any():
                notes.repair("widths below zero are taken as zero", f"line {lane.line}")
            return np.asarray(inner + side * np.maximum(width, 0.0))
        border = Cubics.read(borders, "sOffset", self.start).at(self.s, self.end) + self.offset
        return np.maximum(inner, border) if side > 0 else np.minimum(inner, border)

    def _piece(
        self, lane: Element, key: Key, line: Floats, width: Floats, along: bool, speed_m_s: float | None
    ) -> Piece:
        kind = _KINDS.get(lane.get("type"), "other")
        if lane.get("direction") == "both" and kind in DRIVEN:
            kind = "shared"
        order = slice(None) if along else slice(None, None, -1)
        limit = [_limit(each) for each in lane.all("speed") if self.start + each.number("sOffset", 0.0) <= self.end]
        before, after = (
            tuple(each.lane_number("id") for each in lane.at_path("link", end)) for end in ("predecessor", "successor")
        )
        speed = limit[0] if limit else speed_m_s
        return Piece(key, kind, line[order], width[order], along, speed, before, after)


def _raised(lane: Element, start: float, s: Floats, end: float) -> Floats:
    """Return how far (K,) the middle of a lane is raised over the road."""
    records = lane.all("height")
    if not records:
        return np.zeros(len(s))
    steps = sorted((start + each.number("sOffset", 0.0), each.number("inner", 0.0), each.number("outer", 0.0))
                   for each in records)  # fmt: skip
    table = np.array(steps)
    flat = Cubics(table[:, 0], np.column_stack([table[:, 1:].mean(axis=1), np.zeros((len(table), 3))]))
    return flat.at(s, end)


def _road_speeds(road: Element) -> list[tuple[float, float | None]]:
    """Return where limits of a road start, m, and the limits, m/s."""
    kinds = sorted(road.all("type"), key=lambda each: each.number("s", 0.0))
    return [(each.number("s", 0.0), _limit(speed)) for each in kinds for speed in each.all("speed")]


def _limit(speed: Element) -> float | None:
    """Return a limit, m/s; None where there is none."""
    text, unit = speed.get("max"), speed.get("unit")
    if text in ("no limit", "undefined", ""):
        return None
    if unit not in _TO_M_S:
        raise speed.error(f"unit must be m/s, km/h or mph, got {unit!r}")
    limit = speed.number("max") * _TO_M_S[unit]
    return limit if 0.0 < limit < math.inf else None
