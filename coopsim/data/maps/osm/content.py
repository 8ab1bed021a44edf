"""Content of OSM files: nodes, ways and relations with their tags. Lanelet2 keeps its maps in such files, too."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from coopsim.data.maps.elements import Element
from coopsim.data.maps.notes import Notes
from coopsim.data.maps.osm.projection import Utm
from coopsim.geometry.se3 import Floats

Tags = Mapping[str, str]
_NO_TAGS: Tags = {}
_NORTHERNMOST_DEG, _WIDEST_DEG = 84.0, 10.0
_METRES = {"": 1.0, "m": 1.0, "ft": 0.3048, "'": 0.3048, "km": 1000.0}


@dataclass(frozen=True, slots=True)
class Member:
    """A part of a relation, or a node of a way: kind of element, id, and role."""

    kind: str
    id: str
    role: str = ""


@dataclass(frozen=True, slots=True, eq=False)
class Item:
    """A way or a relation.

    Attributes:
        element: the element without children, for messages.
        tags: its tags.
        members: nodes of a way, members of a relation, in order.
    """

    element: Element
    tags: Tags
    members: tuple[Member, ...]

    @property
    def id(self) -> str:
        """Name in the file."""
        return self.element.get("id")

    def of_role(self, *roles: str) -> list[str]:
        """Return the ids of members with one of these roles."""
        return [each.id for each in self.members if each.role in roles]


class Content:
    """Content of a file.

    Attributes:
        notes: record of repairs and omissions.
        ways: ways by id.
        relations: relations by id.
        tagged: tags of the nodes that have some, by id.
    """

    def __init__(self, root: Element, elements: Iterator[Element]) -> None:
        self.root, self.notes = root, Notes()
        self.ways, self.relations = dict[str, Item](), dict[str, Item]()
        self.tagged: dict[str, Tags] = {}
        self._row: dict[str, int] = {}
        self._degrees: list[tuple[float, float]] = []
        for element in elements:
            if element.tag in ("node", "way", "relation") and not _is_deleted(element):
                self._add(element)
        if not self._degrees:
            raise root.error("must have a <node>")
        apart = np.abs(self.degrees - self._degrees[0])
        if np.minimum(apart, 360.0 - apart).max() > _WIDEST_DEG:
            raise root.error(f"must have nodes within {_WIDEST_DEG:g} degrees of the first one")

    @property
    def degrees(self) -> Floats:
        """Latitude and longitude (N, 2) of the nodes."""
        return np.array(self._degrees)

    @property
    def nodes(self) -> tuple[str, ...]:
        """Ids of the nodes, in the order of `degrees`."""
        return tuple(self._row)

    def known(self, way: Item) -> list[int]:
        """Return the rows of the nodes of a way; those that the file lacks are passed over, with a note."""
        rows = [row for each in way.members if (row := self._row.get(each.id)) is not None]
        if len(rows) < len(way.members):
            self.notes.repair("nodes that the file lacks are passed over", f"way {way.id}")
        return rows

    def row(self, node: str) -> int:
        """Return the row of a node."""
        return self._row[node]

    def _add(self, element: Element) -> None:
        name = element.need("id")
        tags = {each.need("k"): each.get("v") for each in element.all("tag")} or _NO_TAGS
        items = self.ways if element.tag == "way" else self.relations
        if name in (self._row if element.tag == "node" else items):
            self.notes.repair("elements with the id of another one are left out", f"{element.tag} {name}")
            return
        if element.tag == "node":
            self._add_node(element, name, tags)
            return
        members = tuple(
            Member("node", each.need("ref")) if each.tag == "nd" else
            Member(each.need("type"), each.need("ref"), each.get("role"))
            for each in element.all("nd", "member")
        )  # fmt: skip
        self.notes.take_points(len(members), element)
        bare = Element(element.tag, {"id": name}, element.file, element.line)
        items[name] = Item(bare, tags, members)

    def _add_node(self, element: Element, name: str, tags: Tags) -> None:
        usual = 0.0 if "local_x" in tags else None  # such a file may have no degrees
        lat, lon = element.number("lat", usual), element.number("lon", usual)
        if abs(lat) > _NORTHERNMOST_DEG or abs(lon) > 180:
            raise element.error(f"lat must be from -84 to 84 and lon from -180 to 180 degrees, got {lat:g}, {lon:g}")
        self._row[name] = len(self._degrees)
        self._degrees.append((lat, lon))
        if tags:
            self.tagged[name] = tags


class Places:
    """Nodes of a file in space: `metres` (N, 3) in the order of `degrees`."""

    def __init__(self, content: Content, metres: Floats) -> None:
        self._content, self.metres = content, metres

    @classmethod
    def projected(cls, content: Content, utm: Utm, offset_m: Floats) -> Places:
        """Return the nodes in a zone of UTM, less an offset (2,), at a height of 0."""
        degrees = content.degrees
        flat = utm.metres(degrees[:, 0], degrees[:, 1]) - offset_m
        return cls(content, np.column_stack([flat, np.zeros(len(flat))]))

    def line(self, way: Item) -> Floats:
        """Return the nodes (K, 3) m of a way, in order."""
        return self.metres[self._content.known(way)].reshape(-1, 3)

    def node(self, name: str) -> Floats:
        """Return a node (3,) m."""
        return np.asarray(self.metres[self._content.row(name)])


def quantity(text: str, units: Mapping[str, float] = _METRES) -> float | None:
    """Return a tag's number in the unit that counts 1, such as "12.5 m"; None where it is no positive number."""
    found = re.fullmatch(r"\s*(\d{1,6}(?:[.,]\d{1,9})?)\s*(\D*?)\s*", text)
    if found is None or found[2] not in units:
        return None
    return float(found[1].replace(",", ".")) * units[found[2]] or None


def _is_deleted(element: Element) -> bool:
    return element.get("action") == "delete" or element.get("visible") == "false"
