"""Roads: surface, lanes, and what each end is linked to."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, Self

import numpy as np

from coopsim.data.maps.elements import Element
from coopsim.data.maps.notes import Notes
from coopsim.data.maps.opendrive.lanes import Lanes, Section, read_lanes
from coopsim.data.maps.opendrive.surface import Surface
from coopsim.geometry import exact
from coopsim.geometry.se3 import Floats

End = Literal["start", "end"]
_ENDS: tuple[End, End] = ("start", "end")
_FURTHEST_M, _WIDEST_GAP_M = 1e8, 0.5


@dataclass(frozen=True, slots=True)
class Neighbour:
    """The other side of a road's link: a road, at one of its ends (None: not said), or a junction."""

    kind: Literal["road", "junction"]
    id: str
    end: End | None


@dataclass(frozen=True, slots=True, eq=False)
class Road:
    """A road.

    Attributes:
        id: name.
        junction: the junction that it crosses; None: it is outside.
        left_hand: whether vehicles keep to the left.
        surface: its surface.
        lanes: its lanes.
        neighbours: the other sides of its links.
        ends: places (3,) m of the reference line's ends.
    """

    id: str
    junction: str | None
    left_hand: bool
    surface: Surface
    lanes: Lanes
    neighbours: dict[End, Neighbour]
    ends: dict[End, Floats]

    @classmethod
    def read(cls, element: Element, notes: Notes) -> Self:
        """Read a road with its lanes."""
        rule = element.get("rule", "RHT").upper() or "RHT"
        if rule not in ("RHT", "LHT"):
            raise element.error(f"rule must be RHT or LHT, got {rule!r}")
        surface = Surface.read(element, notes)
        name, length_m = element.need("id"), surface.plan.length_m
        _check_length(element, surface, notes)
        lanes = read_lanes(element, surface, notes, left_hand=rule == "LHT")
        _require_near(element, lanes)
        ends = surface.at(np.array([0.0, length_m]), np.zeros(2))
        junction = element.get("junction", "-1")
        neighbours = _neighbours(element, notes)
        inside = None if junction in ("-1", "") else junction
        return cls(name, inside, rule == "LHT", surface, lanes, neighbours, dict(zip(_ENDS, ends, strict=True)))

    def section_at(self, end: End) -> tuple[int, Section] | None:
        """Return the first or last section that has lanes, with its index."""
        sections = [(index, each) for index, each in enumerate(self.lanes.sections) if each.numbers]
        if not sections:
            return None
        return sections[0] if end == "start" else sections[-1]

    def end_nearest(self, place: Floats) -> End:
        """Return the end whose place is nearer."""
        start, end = (float(exact.norm(self.ends[each] - place)) for each in _ENDS)
        return "start" if start <= end else "end"


def _check_length(element: Element, surface: Surface, notes: Notes) -> None:
    length_m = surface.plan.length_m
    said_m = element.number("length", length_m)
    where = f"road {element.get('id')}"
    if abs(said_m - length_m) > 0.01 + 0.001 * length_m:
        notes.repair("lengths of roads that differ from their reference line's give way to it", where)
    if surface.plan.widest_gap_m > _WIDEST_GAP_M:
        notes.repair(f"reference lines with gaps above {_WIDEST_GAP_M:g} m stay as they are", where)


def _require_near(element: Element, lanes: Lanes) -> None:
    """Raise an error where a lane lies where no map does."""
    for section in lanes.sections:
        for piece in section.pieces.values():
            if not (np.abs(piece.line).max() < _FURTHEST_M and piece.width_m.max() < 1000.0):
                raise element.error(
                    f"has lane {piece.key[2]} at more than {_FURTHEST_M:g} m, or wider than 1000 m; accepted: less"
                )


def _neighbours(element: Element, notes: Notes) -> dict[End, Neighbour]:
    found: dict[End, Neighbour] = {}
    for tag, end in (("predecessor", _ENDS[0]), ("successor", _ENDS[1])):
        for each in element.at_path("link", tag)[:1]:
            kind, name, contact = each.get("elementType", "road"), each.need("elementId"), each.get("contactPoint")
            if each.get("elementS"):
                notes.left_out["links to the middle of a road"] += 1
            elif kind == "road":
                there = _ENDS[contact == "end"] if contact in _ENDS else None
                found[end] = Neighbour("road", name, there)
            elif kind == "junction":
                found[end] = Neighbour("junction", name, None)
            else:
                raise each.error(f"elementType must be road or junction, got {kind!r}")
    return found
