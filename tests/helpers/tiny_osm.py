"""Small maps as OSM files: streets that cross, and what stands beside them; lanelets of a corner."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from xml.sax.saxutils import quoteattr

LAT_DEG, LON_DEG = 48.0, 9.0
_NORTH_M, _EAST_M = 111_146.9, 74_595.0
Tags = Mapping[str, str]
_NONE: Tags = {}


def _tags(tags: Tags) -> str:
    return "".join(f"<tag k={quoteattr(key)} v={quoteattr(value)}/>" for key, value in tags.items())


def node(name: str, x: float, y: float, /, **tags: str) -> str:
    """Return a node about (x, y) m in UTM from a place in the middle of zone 32."""
    lat, lon = LAT_DEG + y / _NORTH_M, LON_DEG + x / _EAST_M
    return f'<node id="{name}" lat="{lat:.9f}" lon="{lon:.9f}">{_tags(tags)}</node>\n'


def way(name: str, nodes: str, tags: Tags) -> str:
    """Return a way over nodes, with blanks between them."""
    return f'<way id="{name}">{"".join(f"<nd ref={each!r}/>" for each in nodes.split())}{_tags(tags)}</way>\n'


def relation(name: str, members: Iterable[tuple[str, str, str]], tags: Tags) -> str:
    """Return a relation of members (kind, id, role)."""
    parts = "".join(f'<member type="{kind}" ref="{ref}" role="{role}"/>' for kind, ref, role in members)
    return f'<relation id="{name}">{parts}{_tags(tags)}</relation>\n'


def osm(*parts: str) -> str:
    """Return a file."""
    return f'<?xml version="1.0"?>\n<osm version="0.6">\n{"".join(parts)}</osm>\n'


def ring(name: str, x: float, y: float, size: float, tags: Tags) -> str:
    """Return a square with a corner at (x, y), as a closed way with nodes of its own."""
    corners = [(x, y), (x + size, y), (x + size, y + size), (x, y + size)]
    nodes = "".join(node(f"{name}{k}", *corner) for k, corner in enumerate(corners))
    return nodes + way(name, f"{name}0 {name}1 {name}2 {name}3 {name}0", tags)


_MAIN = {"highway": "secondary", "maxspeed": "50", "lanes": "2", "name": 'A <b> & "c"'}
_SIDE = {"highway": "residential", "maxspeed": "30"}
STREETS = (
    node("1", -120, 0) + node("2", 0, 0, highway="traffic_signals") + node("3", 120, 0)
    + node("4", 0, -120) + node("5", 0, 120) + node("6", 60, 0) + node("7", 60, -20)
    + way("10", "1 2", _MAIN) + way("14", "2 6 3", _MAIN) + way("11", "4 2", _SIDE) + way("15", "2 5", _SIDE)
    + way("12", "6 7", {"highway": "service", "service": "driveway"})
    + relation("30", [("way", "10", "from"), ("node", "2", "via"), ("way", "15", "to")],
               {"type": "restriction", "restriction": "no_left_turn"})
)  # fmt: skip
BESIDE = (
    ring("a", 20, 20, 10, {"building": "yes", "building:levels": "3"})
    + ring("b", 40, 20, 10, {"building": "house", "height": "12,5 m"})
    + ring("c", 60, 20, 10, {"building": "roof"})
    + ring("d", 80, 20, 10, {"building": "yes", "building:min_level": "2"})
    + ring("e", 20, -40, 10, {"amenity": "parking"})
    + ring("f", 40, -40, 10, {"highway": "pedestrian", "area": "yes"})
    + ring("g", 60, -40, 10, {"landuse": "grass"})
    + node("h0", -40, 20) + node("h1", -20, 20) + node("h2", -20, 40) + node("h3", -40, 40)
    + way("h", "h0 h1 h2", {}) + way("i", "h0 h3 h2", {})
    + relation("j", [("way", "h", "outer"), ("way", "i", "outer"), ("way", "a", "inner")],
               {"type": "multipolygon", "building": "yes", "height": "30 ft"})
    + way("k", "h0 h1", {"barrier": "wall", "height": "2"}) + way("l", "h2 h3", {"barrier": "hedge"})
    + way("m", "h1 h2", {"natural": "tree_row"}) + way("n", "h1 h2", {"barrier": "gate"})
    + node("t", -30, -30, natural="tree", height="7", diameter_crown="6 m") + node("u", 10, 10, highway="street_lamp")
)  # fmt: skip
CROSSROADS = osm(STREETS, BESIDE)


def border(name: str, points: Iterable[tuple[float, float]], tags: Tags = _NONE, shared: Tags = _NONE) -> str:
    """Return a border of lanelets with nodes of its own, except those of `shared` (index: id)."""
    names, nodes = [], ""
    for k, (x, y) in enumerate(points):
        known = shared.get(str(k))
        names.append(known or f"{name}{k}")
        nodes += "" if known else node(names[-1], x, y)
    return nodes + way(name, " ".join(names), tags)


def lanelet(name: str, left: str, right: str, rules: str = "", /, **tags: str) -> str:
    """Return a lanelet between two borders that names regulatory elements."""
    members = [("way", left, "left"), ("way", right, "right")]
    members += [("relation", rule, "regulatory_element") for rule in rules.split()]
    return relation(name, members, {"type": "lanelet", **{key.replace("__", ":"): text for key, text in tags.items()}})


# From the west come two lanes, A on the left and B. B leads ahead to C or to the right to D. E is opposite A.
LANELETS = osm(
    border("m", [(0, 3), (100, 3)]),  # between A and E
    border("n", [(0, 0), (50, 0), (100, 0)], {"type": "line_thin", "subtype": "dashed"}),
    border("o", [(100, -3), (0, -3)]),  # written against the direction of travel
    border("p", [(0, 6), (100, 6)]),
    border("q", [(100, 0), (120, 0)], shared={"0": "n2"}),
    border("r", [(100, -3), (120, -3)], shared={"0": "o0"}),
    border("s", [(120, 0), (180, 0)], shared={"0": "q1"}), border("t", [(120, -3), (180, -3)], shared={"0": "r1"}),
    border("u", [(100, 0), (107, -2), (110, -10)], shared={"0": "n2"}),
    border("v", [(100, -3), (105, -5), (107, -10)], shared={"0": "o0"}),
    border("w", [(110, -10), (110, -60)], shared={"0": "u2"}),
    border("x", [(107, -10), (107, -60)], shared={"0": "v2"}),
    border("y", [(130, -30), (130, -33), (128, -34)], {"type": "traffic_light"}), border("z", [(100, 0), (100, -3)]),
    border("f", [(0, 9), (100, 9)], {"type": "fence", "height": "1.5"}),
    border("g", [(40, -10), (40, 10)]), border("h", [(44, -10), (44, 10)]),
    border("k", [(115, 10), (115, 3), (110.5, -5), (110, -10)], shared={"3": "u2"}),
    border("l", [(112, 10), (112, 3), (107.5, -5), (107, -10)], shared={"3": "v2"}),
    border("i", [(115, 40), (115, 10)], shared={"1": "k0"}), border("j", [(112, 40), (112, 10)], shared={"1": "l0"}),
    lanelet("A", "m", "n", subtype="road", speed_limit="50 km/h"), lanelet("B", "n", "o", "L S Y", subtype="road"),
    lanelet("E", "m", "p", location="urban"),
    lanelet("AH", "q", "r", subtype="road"), lanelet("RI", "u", "v", subtype="road"),
    lanelet("C", "s", "t", subtype="road", speed_limit="30 mph"), lanelet("D", "w", "x", subtype="road"),
    lanelet("F", "i", "j", "Y", subtype="road"), lanelet("SO", "k", "l", subtype="road"),
    lanelet("Z", "g", "h", subtype="crosswalk"), lanelet("W", "p", "f", participant__pedestrian="yes"),
    relation("L", [("way", "y", "refers"), ("way", "z", "ref_line")],
             {"type": "regulatory_element", "subtype": "traffic_light"}),
    relation("S", [], {"type": "regulatory_element", "subtype": "speed_limit", "sign_type": "10 m/s"}),
    relation("Y", [("relation", "B", "yield"), ("relation", "F", "right_of_way")],
             {"type": "regulatory_element", "subtype": "right_of_way"}),
    ring("ha", 60, 20, 10, {}), relation("hb", [("way", "ha", "outer")],
                                         {"type": "multipolygon", "subtype": "building", "height": "8"}),
)  # fmt: skip
