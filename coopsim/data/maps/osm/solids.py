"""Surroundings of roads in OpenStreetMap: buildings, walls, trees, poles, and ground to park or walk on."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np

from coopsim.data.maps.osm.content import Content, Item, Places, Tags, quantity
from coopsim.data.maps.rectangles import circle
from coopsim.data.maps.street_map import SolidKind, StreetArea, StreetSolid
from coopsim.geometry.outlines import along_of
from coopsim.geometry.se3 import Floats

_STOREY_M = 3.0
WALLS_M = {
    **dict.fromkeys(("wall", "retaining_wall", "city_wall", "fence", "guard_rail", "jersey_barrier"), 0.25),
    "hedge": 1.0,
}
"""Barriers that are walls, and their thickness."""
_CROWN_M, _POLE_M, _ROW_M, _LONGEST_ROW_M = 2.0, 0.15, 8.0, 5000.0
"""Radius of a tree without `diameter_crown`, and of a pole; distance of trees in a row, and its longest."""
_POLES = {("highway", "street_lamp"), ("power", "pole"), ("man_made", "utility_pole"), ("man_made", "flagpole")}
_NO_HOUSE = ("", "no", "roof", "carport")
_MOST_PARTS = 1000
"""Most ways of an outline."""
_TOLD = ("landuse", "leisure", "natural", "waterway", "power", "amenity", "man_made", "railway", "building", "barrier")


class Solids:
    """Solids and areas of a file, of which `meaning` gives tags in OpenStreetMap's words.

    Attributes:
        solids: buildings, walls, trees and poles.
        areas: ground to park or walk on.
    """

    def __init__(self, content: Content, places: Places, meaning: Callable[[Tags], Tags] = lambda tags: tags) -> None:
        self._content, self._places = content, places
        self.solids, self.areas = list[StreetSolid](), list[StreetArea]()
        for name, tags in content.tagged.items():
            self._add_node(name, tags)
        for way in content.ways.values():
            self._add(way, meaning(way.tags), [way])
        for relation in content.relations.values():
            if relation.tags.get("type") == "multipolygon":
                outer = [content.ways[name] for name in relation.of_role("outer", "") if name in content.ways]
                self._add(relation, meaning(relation.tags), outer)

    def _add_node(self, name: str, tags: Tags) -> None:
        pole = next((pair for pair in _POLES if tags.get(pair[0]) == pair[1]), None)
        if tags.get("natural") == "tree" or pole is not None:
            kind: SolidKind = "pole" if pole else "tree"
            self._add_round(name, kind, self._places.node(name), tags)

    def _add(self, item: Item, tags: Tags, outer: list[Item]) -> None:
        """Read a way, or a relation by its outer ways."""
        name, barrier = item.id, tags.get("barrier", "")
        if barrier in WALLS_M and item.element.tag == "way":
            line = self._places.line(item)
            if len(line) > 1:
                self.solids.append(StreetSolid(name, "wall", line, quantity(tags.get("height", "")), WALLS_M[barrier]))
        elif tags.get("natural") == "tree_row":
            for index, at in enumerate(_along(self._places.line(item))):
                self._add_round(f"{name}.{index}", "tree", at, tags)
        elif _is_house(tags) or tags.get("amenity") == "parking" or _is_square(tags):
            self._add_outlines(item, tags, outer)
        elif (key := next((key for key in _TOLD if key in tags), None)) is not None and "highway" not in tags:
            self._content.notes.left_out[f"{item.element.tag}s {key}"] += 1

    def _add_outlines(self, item: Item, tags: Tags, outer: list[Item]) -> None:
        for index, ring in enumerate(_rings(outer)):
            outline = self._places.line(Item(item.element, {}, ring.members[:-1]))
            name = f"{item.id}.{index}" if index else item.id
            if len(outline) < 3:
                self._content.notes.repair("outlines with fewer than three corners are left out", name)
            elif _is_house(tags):
                self.solids.append(StreetSolid(name, "building", outline, _height(tags)))
            else:
                self.areas.append(StreetArea(name, "walk" if _is_square(tags) else "park", outline[:, :2]))

    def _add_round(self, name: str, kind: SolidKind, at: Floats, tags: Tags) -> None:
        radius_m = (quantity(tags.get("diameter_crown", "")) or 2 * _CROWN_M) / 2 if kind == "tree" else _POLE_M
        self.solids.append(StreetSolid(name, kind, at + circle(radius_m), quantity(tags.get("height", ""))))


def _is_house(tags: Tags) -> bool:
    """Return whether tags are of a house that stands on the ground."""
    raised = tags.get("min_height") or tags.get("building:min_level")
    return tags.get("building", "") not in _NO_HOUSE and raised in (None, "0")


def _is_square(tags: Tags) -> bool:
    return tags.get("highway") == "pedestrian" and tags.get("area") == "yes"


def _height(tags: Tags) -> float | None:
    """Return the height of a building; None where it has neither one nor levels."""
    levels = quantity(tags.get("building:levels", ""), {"": 1.0})
    return quantity(tags.get("height", "")) or (levels * _STOREY_M if levels else None)


def _rings(ways: list[Item]) -> Iterator[Item]:
    """Yield closed outlines of ways that follow each other by their ends; those that never close are passed over."""
    left = [way.members for way in ways[:_MOST_PARTS] if len(way.members) > 1]
    while left:
        ring = left.pop()
        while ring[0].id != ring[-1].id:
            place = next((k for k, each in enumerate(left) if ring[-1].id in (each[0].id, each[-1].id)), None)
            if place is None:
                break
            more = left.pop(place)
            ring += more[1:] if more[0].id == ring[-1].id else more[-2::-1]
        else:
            yield Item(ways[0].element, {}, ring)


def _along(line: Floats) -> Floats:
    """Return places (K, 3) along a line, 8 m apart."""
    if len(line) < 2:
        return line
    along = along_of(line)
    at = np.arange(0.0, min(along[-1], _LONGEST_ROW_M) + 1e-6, _ROW_M)
    return np.column_stack([np.interp(at, along, line[:, axis]) for axis in range(3)])
