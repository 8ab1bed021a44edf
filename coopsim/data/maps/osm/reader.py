"""The reader of OpenStreetMap's files (`.osm`)."""

from __future__ import annotations

import dataclasses
from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from tempfile import TemporaryDirectory
from xml.sax.saxutils import quoteattr

import numpy as np

from coopsim.data.maps.elements import read_elements
from coopsim.data.maps.osm.content import Content, Item, Places
from coopsim.data.maps.osm.netconvert import make_network
from coopsim.data.maps.osm.projection import Utm
from coopsim.data.maps.osm.solids import Solids
from coopsim.data.maps.street_map import StreetMap
from coopsim.data.maps.sumo.network import read_network
from coopsim.errors import MapFileError

_YARDS = ("driveway", "parking_aisle", "drive-through")
"""Ways of `service` that are left out: their many small junctions are on private ground."""
_LEFT = (
    "AU BB BD BN BW CY FJ GB GY HK ID IE IM IN JM JP KE LK LS MO MT MU MW MY MZ NA NP NZ PG PK SC SG SR SZ TH TT TZ UG "
    "ZA ZM ZW"
)
"""Countries where vehicles keep to the left, by ISO 3166."""
_COUNTRY = ("addr:country", "is_in:country_code", "ISO3166-1", "ISO3166-1:alpha2")


def read_osm(path: Path, content: Content) -> StreetMap:
    """Read a map of OpenStreetMap: roads by netconvert, all else from its elements.

    Raises:
        MissingDependencyError: netconvert is not there.
        MapFileError: the file has no roads, or netconvert makes no network of them.
    """
    roads = [way for way in content.ways.values() if _is_road(way, content)]
    if not roads:
        raise content.root.error("must have a <way> with a tag highway, or a <relation> of type lanelet")
    with TemporaryDirectory() as folder:
        small, network = Path(folder) / "roads.osm", Path(folder) / "roads.net.xml"
        _write(small, content, roads)
        try:
            warnings = make_network(small, network, keeps_left(content))
        except MapFileError as error:
            raise error.at(str(path)) from None
        elements = read_elements(network)
        streets = read_network(path, next(elements), elements)
    utm = Utm.of(streets.projection)
    if utm is None:
        raise content.root.error(f"netconvert gave an unknown projection {streets.projection!r}; accepted: UTM")
    beside = Solids(content, Places.projected(content, utm, np.array(streets.offset_m[:2])))
    return dataclasses.replace(
        streets,
        format=f"OpenStreetMap {content.root.get('version')}, by {streets.format}",
        solids=tuple(beside.solids),
        areas=(*streets.areas, *beside.areas),
        repaired=(*content.notes.repaired, *warnings, *streets.repaired),
        left_out=dict(sorted((Counter(streets.left_out) + content.notes.left_out).items())),
    )


def keeps_left(content: Content) -> bool:
    """Return whether vehicles keep to the left: by a tag `driving_side`, else by countries of addresses."""
    tags = [each.tags for each in (*content.relations.values(), *content.ways.values())] + list(content.tagged.values())
    sides = Counter(each["driving_side"] for each in tags if "driving_side" in each)
    if sides:
        return sides.most_common(1)[0][0] == "left"
    countries = Counter(each[key].upper() for each in tags for key in _COUNTRY if key in each)
    return bool(countries) and countries.most_common(1)[0][0] in _LEFT.split()


def _is_road(way: Item, content: Content) -> bool:
    """Return whether netconvert gets a way: those on private yards are left out, with a note."""
    if "highway" not in way.tags or way.tags.get("area") == "yes":
        return False
    if way.tags.get("service") in _YARDS:
        content.notes.left_out["ways highway on yards"] += 1
        return False
    return True


def _write(path: Path, content: Content, roads: list[Item]) -> None:
    """Write roads, their nodes, and relations that restrict turns: netconvert gets nothing else of a strange file."""
    rows = {row: None for way in roads for row in content.known(way)}
    nodes, degrees = content.nodes, content.degrees
    with open(path, "w", encoding="utf-8") as file:
        file.write('<osm version="0.6">\n')
        for row in rows:
            lat, lon = degrees[row].tolist()
            tags = _tags(content.tagged.get(nodes[row], {}))
            file.write(f'<node id={quoteattr(nodes[row])} lat="{lat:.9f}" lon="{lon:.9f}">{tags}</node>\n')
        for way in roads:
            parts = "".join(f"<nd ref={quoteattr(nodes[row])}/>" for row in content.known(way))
            raced = {**way.tags, "highway": "unclassified"} if way.tags["highway"] == "raceway" else way.tags
            file.write(f"<way id={quoteattr(way.id)}>{parts}{_tags(raced)}</way>\n")
        for relation in content.relations.values():
            if relation.tags.get("type") == "restriction":
                parts = "".join(
                    f"<member type={quoteattr(each.kind)} ref={quoteattr(each.id)} role={quoteattr(each.role)}/>"
                    for each in relation.members
                )
                file.write(f"<relation id={quoteattr(relation.id)}>{parts}{_tags(relation.tags)}</relation>\n")
        file.write("</osm>\n")


def _tags(tags: Mapping[str, str]) -> str:
    return "".join(f"<tag k={quoteattr(key)} v={quoteattr(value)}/>" for key, value in tags.items())
