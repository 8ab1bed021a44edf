"""Elements of a road: reference line, links, and lanes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from coopsim.data.maps.export.opendrive.cross_sections import ANY_M, Section
from coopsim.data.maps.export.xml_parts import Element, put
from coopsim.world.towns.plan import Stretch

_TYPES = {"median": "median", "drive": "driving", "park": "parking", "walk": "sidewalk"}


@dataclass(frozen=True, slots=True)
class Link:
    """A neighbour before or behind a road.

    Attributes:
        kind: "road" or "junction".
        id: number of that.
        contact: "start" or "end" of that road; None: it is a junction.
        lanes: numbers of the lanes there, by the names of lanes here.
    """

    kind: str
    id: int
    contact: str | None
    lanes: Mapping[str, int]


@dataclass(frozen=True, slots=True, eq=False)
class RoadElement:
    """A road to be written.

    Attributes:
        id: its number.
        name: name in the town.
        line: reference line, in the world.
        sections: cross-sections.
        offset_m: from the reference line to the border between both directions, to the left.
        speed_m_s: limit.
        before: neighbour at its beginning.
        behind: neighbour at its end.
        junction: number of the junction that it crosses; -1: none.
        marks: type of the mark between both directions.
    """

    id: int
    name: str
    line: Sequence[Stretch]
    sections: Sequence[Section]
    offset_m: float
    speed_m_s: float
    before: Link
    behind: Link
    junction: int = -1
    marks: str = "none"

    @property
    def length_m(self) -> float:
        """Length of the reference line."""
        return float(sum(stretch.length_m for stretch in self.line))


def put_road(root: Element, road: RoadElement, right_ahead: bool, kerb_m: float) -> Element:
    """Add a road; `right_ahead` tells that lanes along it are on its right. Return it, for objects and signals."""
    rule = "RHT" if right_ahead else "LHT"
    element = put(
        root, "road", name=road.name, length=road.length_m, id=road.id, junction=road.junction, rule=rule
    )  # fmt: skip
    link = put(element, "link")
    for tag, other in (("predecessor", road.before), ("successor", road.behind)):
        put(link, tag, elementType=other.kind, elementId=other.id, contactPoint=other.contact)
    put(put(element, "type", s=0.0, type="town"), "speed", max=road.speed_m_s, unit="m/s")
    _put_line(put(element, "planView"), road.line)
    lanes = put(element, "lanes")
    if road.offset_m:
        put(lanes, "laneOffset", s=0.0, a=road.offset_m, b=0.0, c=0.0, d=0.0)
    for k, section in enumerate(road.sections):
        beside = [road.sections[at] if 0 <= at < len(road.sections) else None for at in (k - 1, k + 1)]
        _put_section(lanes, road, section, (beside[0], beside[1]), right_ahead, kerb_m)
    return element


def _put_line(plan_view: Element, line: Sequence[Stretch]) -> None:
    """Add the geometry of a reference line."""
    s = 0.0
    for each in line:
        x, y = each.start.tolist()
        geometry = put(plan_view, "geometry", s=s, x=x, y=y, hdg=each.heading_rad, length=each.length_m)
        if each.curvature_1_m:
            put(geometry, "arc", curvature=each.curvature_1_m)
        else:
            put(geometry, "line")
        s += each.length_m


def lane_number(section: Section, forwards: bool, name: str, right_ahead: bool) -> int:
    """Return a lane's number: from the middle outwards, negative on the right of the reference line."""
    return section.number(forwards, name) * (-1 if forwards == right_ahead else 1)


def _put_section(
    lanes: Element,
    road: RoadElement,
    section: Section,
    beside: tuple[Section | None, Section | None],
    right_ahead: bool,
    kerb_m: float,
) -> None:
    """Add a lane section; `beside` are those before and behind it."""
    element = put(lanes, "laneSection", s=section.start)
    for side, forwards in (("left", not right_ahead), ("center", None), ("right", right_ahead)):
        if forwards is None:
            centre = put(put(element, "center"), "lane", id=0, type="none", level=False)
            put(centre, "roadMark", sOffset=0.0, type=road.marks, color="standard", width=0.12)
        elif section.widths.get(forwards):
            group = put(element, side)
            names = list(section.widths[forwards])
            for name in names if side == "right" else names[::-1]:
                lane = _put_lane(group, section, forwards, name, right_ahead)
                _put_lane_link(lane, road, section, beside, forwards, name, right_ahead)
                _put_surface(lane, section, forwards, name, kerb_m)


def _put_lane(group: Element, section: Section, forwards: bool, name: str, right_ahead: bool) -> Element:
    number = lane_number(section, forwards, name, right_ahead)
    return put(group, "lane", id=number, type=_TYPES[name.rstrip("0123456789")], level=False)


def _put_lane_link(
    lane: Element,
    road: RoadElement,
    section: Section,
    beside: tuple[Section | None, Section | None],
    forwards: bool,
    name: str,
    right_ahead: bool,
) -> None:
    """Link a lane to those before and behind it, where it has a width."""
    link = put(lane, "link")
    ends = zip(
        ("predecessor", "successor"), beside, (road.before, road.behind), section.widths[forwards][name], strict=True
    )
    for tag, other, outside, width_m in ends:
        number = outside.lanes.get(name, 0) if other is None else lane_number(other, forwards, name, right_ahead)
        if number and width_m > ANY_M:
            put(link, tag, id=number)


def _put_surface(lane: Element, section: Section, forwards: bool, name: str, kerb_m: float) -> None:
    """Add width, mark on the outer border, and height."""
    begin, end = section.widths[forwards][name]
    put(lane, "width", sOffset=0.0, a=begin, b=(end - begin) / (section.end - section.start), c=0.0, d=0.0)
    names = list(section.widths[forwards])
    outside = names[names.index(name) + 1] if name != names[-1] else ""
    divides = name.startswith("drive") and outside.startswith("drive")
    mark, change = ("broken", "both") if divides else ("none", "none")
    put(lane, "roadMark", sOffset=0.0, type=mark, color="standard", width=0.12, laneChange=change)
    if name == "walk" and kerb_m:
        put(lane, "height", sOffset=0.0, inner=kerb_m, outer=kerb_m)
