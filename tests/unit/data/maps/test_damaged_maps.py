"""Damaged maps: each is one line that names the element and what is accepted, or is repaired with a warning."""

from __future__ import annotations

import gzip
import re
import time
import warnings
from pathlib import Path

import pytest
from tiny_maps import ARMS, CONTROLLER, JUNCTION, POLYGONS, SUMO, THREE_ROADS, opendrive, written
from tiny_osm import LANELETS, border, lanelet, node, osm

from coopsim.data.maps.reading import read_map
from coopsim.errors import MapFileError, MapWarning

_LINE = '<geometry s="0.0" x="0.0" y="0.0" hdg="0.0" length="100.0"><line/></geometry>'
_WIDTH = '<width sOffset="0" a="3.5" b="0" c="0" d="0"/>'

_LANELESS = opendrive(*ARMS[:2], ARMS[2].replace("laneSection", "section"), *ARMS[3:], JUNCTION)

REFUSED = {  # name: (text, what is changed, into what, what is told)
    "unknown geometry": (THREE_ROADS, "<line/>", "<helix/>", "<geometry> must have one of <line>, .* got <helix>"),
    "no geometry in a piece": (THREE_ROADS, "<line/>", "", "<geometry> must have one of .* got nothing"),
    "two geometries": (THREE_ROADS, "<line/>", '<line/><arc curvature="1"/>', "must have one of .* got <line>, <arc>"),
    "no plan view": (THREE_ROADS, f"<planView>{_LINE}</planView>", "", "<road id='1'> must have a <planView>"),
    "NaN for x": (THREE_ROADS, 'x="0.0"', 'x="nan"', "x must be a number from -1e9 to 1e9, got 'nan'"),
    "infinite length": (THREE_ROADS, 'length="100.0"', 'length="inf"', "length must be a number"),
    "text for a number": (THREE_ROADS, 'hdg="0.0"', 'hdg="east"', "hdg must be a number .* got 'east'"),
    "underscores": (THREE_ROADS, 'x="0.0"', 'x="1_0"', "x must be a number .* got '1_0'"),
    "no x": (THREE_ROADS, 'x="0.0" ', "", "<geometry> must have the attribute x"),
    "negative length": (THREE_ROADS, 'length="100.0"', 'length="-5"', r"length must be in \(0, 1e\+06\] m, got -5"),
    "a road of 10^9 m": (THREE_ROADS, 'length="100.0"', 'length="999999999"', "length must be in"),
    "10^9 points": (
        THREE_ROADS, _LINE, "".join(_LINE.replace('s="0.0"', f's="{k}e6"').replace("100.0", "9e5") for k in range(30)),
        "asks for more than the 4,000,000 points",
    ),
    "an arc like a coil": (THREE_ROADS, "<line/>", '<arc curvature="1e6"/>', "<arc> turns by more than 200 rad"),
    "a spiral like a coil": (THREE_ROADS, "<line/>", '<spiral curvStart="0" curvEnd="1e3"/>', "<spiral> turns by more"),
    "a spiral without an end": (THREE_ROADS, "<line/>", '<spiral curvStart="0"/>', "must have the attribute curvEnd"),
    "a cubic of another length": (
        THREE_ROADS, "<line/>", '<paramPoly3 pRange="normalized" aU="0" bU="1" aV="0" bV="0"/>', "is 1 m long, but",
    ),
    "a cubic of an unknown range": (
        THREE_ROADS, "<line/>", '<paramPoly3 pRange="full" bU="100"/>', "pRange must be arcLength or normalized",
    ),
    "NaN for a width": (THREE_ROADS, _WIDTH, _WIDTH.replace("3.5", "nan"), "<width> a must be a number"),
    "a width of 10^9 m": (THREE_ROADS, _WIDTH, _WIDTH.replace("3.5", "1e9"), "<road id='1'> has lane 1 at more than"),
    "a lane without number": (THREE_ROADS, '<lane id="1"', '<lane id="x"', "id must be a number"),
    "half a lane": (THREE_ROADS, '<lane id="1"', '<lane id="0.5"', "id must be an integer from -10000 to 10000"),
    "a road without id": (THREE_ROADS, '<road id="1" ', "<road ", "<road> must have the attribute id"),
    "an unknown rule": (THREE_ROADS, '<road id="1"', '<road rule="UP" id="1"', "rule must be RHT or LHT, got 'UP'"),
    "a link to a station": (THREE_ROADS, 'elementType="junction"', 'elementType="station"', "must be road or junction"),
    "a signal without place": (THREE_ROADS, 's="95" ', "", "<signal id='5'> must have the attribute s"),
    "10^9 trees": (THREE_ROADS, 'distance="5"', 'distance="1e-9"', "<repeat> asks for 2e.10 copies or steps; accepted"),
    "no roads": (opendrive(CONTROLLER), "", "", "<OpenDRIVE> must have a <road> with lanes"),
    "nothing in the root": ("<OpenDRIVE/>", "", "", "<OpenDRIVE> must have a <road> with lanes"),
    "another root": ("<html><body/></html>", "", "", "<html> is no road map; accepted: OpenDRIVE 1.4 to 1.8"),
    "a map of OpenStreetMap without anything": ('<osm version="0.6"/>', "", "", "<osm> must have a <node>"),
    "a map of OpenStreetMap without roads": (osm(node("1", 0, 0)), "", "", "must have a <way> with a tag highway"),
    "empty": ("", "", "", "this is no XML file, or it is cut off .*accepted: a whole file"),
    "no XML": ("lanes: 5", "", "", "this is no XML file"),
    "cut off in a road": (THREE_ROADS[:900], "", "", "cut off .* it ends within .*<road id='1'>"),
    "cut off at the end": (THREE_ROADS[:-3], "", "", "it is cut off"),
    "tags that do not match": (THREE_ROADS, "</planView>", "</plan>", "mismatched tag"),
    "a bomb of entities": (
        THREE_ROADS, '<?xml version="1.0"?>',
        '<?xml version="1.0"?><!DOCTYPE a [<!ENTITY a "aaaa"><!ENTITY b "&a;&a;&a;&a;">]>', "the entity 'a' is refused",
    ),
    "an entity of a file": (
        THREE_ROADS, '<?xml version="1.0"?>',
        '<?xml version="1.0"?><!DOCTYPE a [<!ENTITY a SYSTEM "file:///etc/passwd">]>', "the entity 'a' is refused",
    ),
    "an unknown encoding": (THREE_ROADS, '"1.0"?>', '"1.0" encoding="klingon"?>', "no XML file|unknown encoding"),
    "a thousand levels": (THREE_ROADS, "<link>", "<link>" * 1000, "is nested 64 elements deep"),
    "a shape of NaN": (SUMO, "0,-2 100,-2", "0,nan 100,-2", "<lane id='A_1'> shape must be points"),
    "a shape of one number": (SUMO, "0,-2 100,-2", "0 100,-2", "<lane id='A_1'> shape must be points x,y or x,y,z"),
    "no shape": (SUMO, ' shape="0,-2 100,-2"', "", "<lane id='A_1'> must have the attribute shape"),
    "a lane wide as a town": (SUMO, 'width="2" shape="0,-6', 'width="900" shape="0,-6', "width must be in .0, 200. m"),
    "phases of two lengths": (SUMO, 'state="rrG"', 'state="r"', "<tlLogic id='J'> must have <phase>"),
    "no phases": (SUMO.replace("<phase ", "<face "), "", "", "<tlLogic id='J'> must have <phase>"),
    "a network without lanes": ("<net/>", "", "", "<net> must have an <edge> with a <lane>"),
    "a node without longitude": (LANELETS, ' lon="9.0', ' lng="9.0', "<node id='m0'> must have the attribute lon"),
    "a node of NaN": (LANELETS, 'lat="48.0', 'lat="nan48.0', "<node id='m0'> lat must be a number"),
    "a node beyond the pole": (LANELETS, 'lat="48.0', 'lat="148.0', "lat must be from -84 to 84 .* got 148"),
    "a node on another continent": (LANELETS, 'lat="48.0', 'lat="8.0', "<osm> must have nodes within 10 degrees"),
    "a node without id": (LANELETS, 'node id="m0"', "node", "<node> must have the attribute id"),
    "a tag without key": (LANELETS, '<tag k="type"', "<tag", "<tag> must have the attribute k"),
    "a member without ref": (LANELETS, ' ref="m" role', " role", "<member> must have the attribute ref"),
    "a lanelet wide as a town": (
        osm(border("a", [(0, 500), (90, 500)]), border("b", [(0, 0), (90, 0)]), lanelet("A", "a", "b")), "", "",
        "<relation id='A'> is 500 m wide; accepted: up to 200 m",
    ),
    "a lanelet long as a country": (
        osm(border("a", [(0, 3), (2e5, 3)]), border("b", [(0, 0), (2e5, 0)]), lanelet("A", "a", "b")), "", "",
        "<relation id='A'> has a border longer than 100 km",
    ),
    "lanelets for people alone": (
        osm(border("a", [(0, 3), (9, 3)]), border("b", [(0, 0), (9, 0)]), lanelet("A", "a", "b", subtype="walkway")),
        "", "", "<osm> must have a <relation> of type lanelet, of subtype road",
    ),
    "lanelets cut off": (LANELETS[:-300], "", "", "cut off .*it ends within <osm>"),
    "a bomb of entities in OSM": (
        LANELETS, '<?xml version="1.0"?>', '<?xml version="1.0"?><!DOCTYPE a [<!ENTITY a "aaaa">]>', "'a' is refused",
    ),
    "a network cut off": (SUMO[:1500], "", "", "cut off .*it ends within"),
}  # fmt: skip

REPAIRED = {
    "a lane without width": (THREE_ROADS, _WIDTH, "", "lanes without width are left out"),
    "a lane below zero": (THREE_ROADS, _WIDTH, _WIDTH.replace("3.5", "-2"), "widths below zero are taken as zero"),
    "a road twice": (opendrive(*ARMS, *ARMS, JUNCTION), "", "", "roads with the id of another one are left out: 5"),
    "a road without lanes": (_LANELESS, "", "", "roads without lanes are left out"),
    "a lane twice": (THREE_ROADS, "<right>", '<right><lane id="-1" type="none"/>', "number of another one"),
    "a link to no road": (THREE_ROADS, 'elementId="2"', 'elementId="77"', "links to roads that do not exist"),
    "a link to no lane": (THREE_ROADS, '<successor id="-1"/>', '<successor id="-8"/>', "links to lanes that do not"),
    "a link from no lane": (THREE_ROADS, 'from="-1"', 'from="-4"', "links to lanes that do not exist"),
    "a link to an end": (THREE_ROADS, 'elementId="2" contactPoint="start"', 'elementId="2" contactPoint="end"',
                         "both begin or both end there|apart are passed over"),
    "no contact point": (THREE_ROADS, 'elementId="2" contactPoint="start"', 'elementId="2"', "go to the nearer end"),
    "a connection of no road": (THREE_ROADS, 'connectingRoad="11"', 'connectingRoad="55"', "roads that do not exist"),
    "a road of no junction": (opendrive(*ARMS), "", "", "junctions that do not exist are taken as outside: 2"),
    "a road far off": (THREE_ROADS, 'x="120.0"', 'x="220.0"', "more than 5 m apart are passed over"),
    "a road a bit off": (THREE_ROADS, 'x="120.0"', 'x="122.0"', "more than 1 m apart stay"),
    "another length": (THREE_ROADS, '<road id="1" length="100"', '<road id="1" length="70"', "lengths of roads that"),
    "a piece of no length": (THREE_ROADS, _LINE, _LINE + _LINE.replace("100.0", "0"), "pieces .* without length"),
    "a gap in the reference line": (THREE_ROADS, _LINE, _LINE + _LINE.replace('s="0.0" x="0.0"', 's="100" x="105"'),
                                    "reference lines with gaps"),
    "a section of no length": (THREE_ROADS, '<laneSection s="0">', '<laneSection s="0"/><laneSection s="0">',
                               "lane sections without length"),
    "no header": (THREE_ROADS.replace("header", "head"), "", "", "the file has no <header>"),
    "a version to come": (THREE_ROADS, 'revMinor="6"', 'revMinor="12"', "versions other than OpenDRIVE 1.4 to 1.8"),
    "a control of no signal": (THREE_ROADS, 'signalId="5"', 'signalId="6"', "controls of signals that do not exist"),
    "a reference to no signal": (THREE_ROADS, "<signals>", '<signals><signalReference id="8" s="1" t="0"/>',
                                 "references to signals that do not exist"),
    "an outline of one corner": (THREE_ROADS, '<cornerLocal u="-3.5" v="-1.5"/><cornerLocal u="3.5" v="-1.5"/>'
                                 '<cornerLocal u="3.5" v="1.5"/>', "", "fewer than two corners"),
    "both rules": (THREE_ROADS, '<road id="3"', '<road rule="LHT" id="3"', "roads of both rules"),
    "an edge twice": (SUMO, "<tlLogic", '<edge id="B"/><tlLogic', "edges with the id of another one"),
    "a lane of no length": (SUMO, "106,-10 106,-50", "106,-10 106,-10", "lanes without length are left out"),
    "a lane of no width": (SUMO, 'width="2" shape="0,-6', 'width="0" shape="0,-6', "lanes without width are left out"),
    "a connection of no lane": (SUMO, 'toLane="0" via=":J_1_0"', 'toLane="6" via=":J_1_0"', "lanes that do not exist"),
    "a connection over no lane": (SUMO, 'via=":J_1_0"', 'via=":X_1_0"', "lanes that connections go over"),
    "a border that is not there": (LANELETS, 'ref="m" role', 'ref="mm" role', "without one left and one right border"),
    "a border of one node": (LANELETS, "<nd ref='m1'/>", "", "without one left and one right border are left out: 2"),
    "two left borders": (LANELETS, 'ref="n" role="right"', 'ref="n" role="left"', "without one left and one right"),
    "a node that is not there": (LANELETS, "<nd ref='n1'/>", "<nd ref='nn'/>", "nodes that the file lacks are passed"),
    "a node twice": (LANELETS, 'node id="n1"', 'node id="n0"', "the id of another one are left out: 1 .node n0"),
    "a lanelet without length": (
        osm(border("a", [(0, 3), (9, 3)]), border("b", [(0, 0), (9, 0)]), border("c", [(0, 0), (0.01, 0)]),
            lanelet("A", "a", "b"), lanelet("B", "a", "c")), "", "", "lanelets without length are left out: 1 .B",
    ),
    "a lanelet without width": (LANELETS, 'ref="n" role="right"', 'ref="m" role="right"', "without width are left out"),
    "a rule without a line": (LANELETS.replace('ref="z" role="ref_line"', 'ref="zz" role="ref_line"'), 'ref="y" role',
                              'ref="yy" role', "rules without a line, or that no lanelet names"),
    "an outline of two corners": (LANELETS, "<nd ref='ha2'/><nd ref='ha3'/>", "", "outlines with fewer than three"),
    "a light without program": (SUMO, 'tl="J" linkIndex="1"', 'tl="X" linkIndex="1"', "signals without a program"),
    "a light beyond its states": (SUMO, 'linkIndex="1"', 'linkIndex="9"', "or without a place in it"),
}  # fmt: skip


def read_quickly(path: Path) -> None:
    """Read within a bounded time."""
    start = time.process_time()
    try:
        read_map(path)
    finally:
        assert time.process_time() - start < 4.0


@pytest.mark.parametrize("name", REFUSED)
def test_what_cannot_be_read_is_one_line(name: str, tmp_path: Path) -> None:
    text, old, new, told = REFUSED[name]
    assert old in text
    path = written(tmp_path, text.replace(old, new, 1))
    with pytest.raises(MapFileError, match=told) as caught:
        read_quickly(path)
    line = str(caught.value)
    assert "\n" not in line and str(path) in line and len(line) < 600


@pytest.mark.parametrize("name", REPAIRED)
def test_what_can_be_repaired_is(name: str, tmp_path: Path) -> None:
    text, old, new, told = REPAIRED[name]
    assert old in text
    path = written(tmp_path, text.replace(old, new, 1) if old else text)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        read_quickly(path)
    lines = [str(each.message) for each in caught]
    assert any(re.search(told, line) for line in lines)
    assert all("\n" not in line and str(path) in line for line in lines)
    assert {each.category for each in caught} == {MapWarning}


def test_a_missing_file_and_a_folder_are_told(tmp_path: Path) -> None:
    with pytest.raises(MapFileError, match="no file "):
        read_map(tmp_path / "none.xodr")
    with pytest.raises(MapFileError, match="cannot read"):
        read_map(tmp_path)


@pytest.mark.parametrize("kept", [30, 200])
def test_a_gzip_file_that_is_cut_off_is_told(kept: int, tmp_path: Path) -> None:
    path = tmp_path / "map.xodr.gz"
    path.write_bytes(gzip.compress(THREE_ROADS.encode())[:kept])
    with pytest.raises(MapFileError, match="the gzip file is damaged or cut off"):
        read_map(path)


def test_bombs_of_gzip_are_refused_within_bounds(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "map.xodr.gz"
    path.write_bytes(gzip.compress(b"<OpenDRIVE>" + b" " * (20 << 20)))
    monkeypatch.setattr("coopsim.data.maps.elements._MOST_BYTES", 8 << 20)
    with pytest.raises(MapFileError, match="more than 8 MB of text, which is the most accepted"):
        read_quickly(path)


def test_elements_are_counted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("coopsim.data.maps.elements._MOST_IN_ONE", 1000)
    road = "<road>" + "<a/>" * 2000 + "</road>"
    with pytest.raises(MapFileError, match="<a> of <OpenDRIVE> <road> is too large; accepted: up to 1,000 elements"):
        read_map(written(tmp_path, f"<OpenDRIVE>{road}</OpenDRIVE>"))
    monkeypatch.setattr("coopsim.data.maps.elements._MOST_ELEMENTS", 500)
    with pytest.raises(MapFileError, match="more than 500 elements"):
        read_map(written(tmp_path, "<OpenDRIVE>" + "<a/>" * 2000 + "</OpenDRIVE>"))


def test_links_in_a_circle_end(tmp_path: Path) -> None:
    """Lanes within a junction that lead to each other for ever."""
    ring = ARMS[4].replace('elementType="road" elementId="3" contactPoint="start"',
                           'elementType="road" elementId="11" contactPoint="start"')  # fmt: skip
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", MapWarning)
        read_quickly(written(tmp_path, opendrive(*ARMS[:4], ring, JUNCTION)))
    inner = SUMO.replace('<connection from=":J_3" to="B" fromLane="0" toLane="0"',
                         '<connection from=":J_3" to="B" fromLane="0" toLane="0" via=":J_0_0"')  # fmt: skip
    read_quickly(written(tmp_path, inner, "a.net.xml"))


def test_damaged_polygons_are_told(tmp_path: Path) -> None:
    path = written(tmp_path, SUMO, "a.net.xml")
    written(tmp_path, POLYGONS.replace("10,10 20,10", "10,inf 20,10", 1), "a.poly.xml")
    with pytest.raises(MapFileError, match=r"a\.poly\.xml:1: <poly id='h'> shape must be points"):
        read_map(path)
    written(tmp_path, POLYGONS.replace("30,10 40,10 40,20", "30,10 40,10"), "a.poly.xml")
    with pytest.warns(MapWarning, match="polygons with fewer than three corners are left out"):
        read_map(path)
