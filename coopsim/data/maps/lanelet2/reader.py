"""The reader of Lanelet2's files."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from coopsim.data.maps.lanelet2.junctions import junctions_of
from coopsim.data.maps.lanelet2.lanelets import Neighbours, has_y_south, lanelets_of, read_lanelets
from coopsim.data.maps.lanelet2.rules import Rules
from coopsim.data.maps.osm.content import Content, Places, Tags
from coopsim.data.maps.osm.projection import Utm
from coopsim.data.maps.osm.solids import WALLS_M, Solids
from coopsim.data.maps.street_map import StreetCrossing, StreetJunction, StreetLane, StreetMap
from coopsim.data.maps.ways import find_ways

_AXES = ("local_x", "local_y")


def has_lanelets(content: Content) -> bool:
    """Return whether a file has lanelets, and so is a map of Lanelet2."""
    return bool(lanelets_of(content))


def read_lanelet_map(path: Path, content: Content) -> StreetMap:
    """Read a map of Lanelet2.

    Raises:
        MapFileError: no lanelet can be driven on, or one is out of bounds; names file, line and element.
    """
    places, offset_m, projection = _placed(content)
    if has_y_south(content, places):
        content.notes.repair("y points south, as left borders lie on the right: y is reversed", "all nodes")
        places.metres[:, 1] *= -1.0
    lanelets = read_lanelets(content, places)
    if not any(each.is_driven for each in lanelets.values()):
        raise content.root.error("must have a <relation> of type lanelet, of subtype road, with two borders")
    beside, rules = Neighbours(lanelets), Rules(content, lanelets)
    rules.set_limits()
    junctions = junctions_of(lanelets, beside)
    ways, chains = find_ways(lanelets, beside.after, junctions, rules.lights(), content.notes)
    yields = rules.yields(ways, chains)
    crossings = [each for each in lanelets.values() if each.item.tags.get("subtype") == "crosswalk"]
    crossed = {each.name for each in crossings}
    lanes = {}
    for name, each in lanelets.items():
        if name not in junctions and name not in crossed:
            near = (beside.left.get(name), beside.right.get(name))
            left, right = (None if side in junctions else side for side in near)
            road = _leftmost(name, beside)
            lanes[name] = StreetLane(name, road, each.kind, each.line, each.width_m, each.speed_m_s, left, right)
    links = {name: after for name, follow in beside.after.items()
             if name in lanes and (after := tuple(each for each in follow if each in lanes))}  # fmt: skip
    solids = Solids(content, places, _meaning)
    return StreetMap(
        source=str(path),
        format="Lanelet2",
        lanes=lanes,
        links=links,
        ways=ways,
        junctions={
            name: StreetJunction(name, "lanelets", None, frozenset(yields[name]) if name in yields else None)
            for name in dict.fromkeys(junctions.values())
        },
        signals=rules.signals(places, lanes),
        crossings=tuple(StreetCrossing(each.name, each.line, float(each.width_m.mean())) for each in crossings),
        areas=tuple(solids.areas),
        solids=tuple(solids.solids),
        left_hand=beside.left_hand,
        offset_m=offset_m,
        projection=projection,
        repaired=content.notes.repaired,
        left_out=dict(sorted((+content.notes.left_out).items())),
    )


def _placed(content: Content) -> tuple[Places, tuple[float, float, float], str]:
    """Return nodes in space, their offset and projection: by tags local_x and local_y if all have them, else in UTM.

    UTM counts from the place with a whole tenth of a degree next to the middle: of simulators' maps this is (0, 0).
    """
    tags = [content.tagged.get(name, {}) for name in content.nodes]
    heights = np.array([_number(each.get("ele", "")) or 0.0 for each in tags])
    local = [[_number(each.get(axis, "")) for axis in _AXES] for each in tags]
    if all(None not in place for place in local):
        return Places(content, np.column_stack([np.array(local, dtype=np.float64), heights])), (0.0, 0.0, 0.0), ""
    lat, lon = np.round(content.degrees.mean(axis=0), 1).tolist()
    utm = Utm.around(lat, lon)
    origin = utm.metres(np.array([lat]), np.array([lon]))[0]
    places = Places.projected(content, utm, origin)
    places.metres[:, 2] = heights
    return places, (float(origin[0]), float(origin[1]), 0.0), utm.text


def _number(text: str) -> float | None:
    return float(text) if re.fullmatch(r"\s*-?\d{1,9}(\.\d*)?(e-\d\d?)?\s*", text) else None


def _leftmost(name: str, beside: Neighbours) -> str:
    seen = {name}
    while (left := beside.left.get(name)) is not None and left not in seen:
        seen.add(left)
        name = left
    return name


def _meaning(tags: Tags) -> Tags:
    """Return tags of Lanelet2 in the words of OpenStreetMap."""
    kind, subtype = tags.get("type", ""), tags.get("subtype", "")
    if kind == "multipolygon":
        words = {"building": {"building": "yes"}, "parking": {"amenity": "parking"}}.get(subtype, {})
        return {**words, "height": tags.get("height", "")}
    return {"barrier": kind, "height": tags.get("height", "")} if kind in WALLS_M else {}
