"""Small maps, written by hand: a junction of three roads in OpenDRIVE, and a signalled one of SUMO with a crossing."""

from __future__ import annotations

import gzip
from pathlib import Path

_LANE = (
    '<lane id="{id}" type="driving" level="false"><link>{link}</link>'
    '<width sOffset="0" a="3.5" b="0" c="0" d="0"/></lane>'
)


def lane(number: int, before: str = "", after: str = "") -> str:
    """Return a driven lane of 3.5 m with links."""
    links = "".join(f'<{tag} id="{to}"/>' for tag, to in (("predecessor", before), ("successor", after)) if to)
    return _LANE.format(id=number, link=links)


def lanes(left: str, right: str) -> str:
    """Return one lane section."""
    sides = f"<left>{left}</left>" * bool(left) + f"<right>{right}</right>" * bool(right)
    return f'<lanes><laneSection s="0"><center><lane id="0" type="none"/></center>{sides}</laneSection></lanes>'


def road(name: str, geometry: str, lanes_: str, *, link: str = "", junction: str = "-1", more: str = "") -> str:
    """Return a road; `geometry` is the content of its plan view, `more` follows the lanes."""
    return (
        f'<road id="{name}" length="{_length(geometry):g}" junction="{junction}">\n<link>{link}</link>\n'
        f"<planView>{geometry}</planView>\n{lanes_}\n{more}</road>\n"
    )


def _length(geometry: str) -> float:
    return sum(float(part.split('"')[0]) for part in geometry.split('length="')[1:])


def piece(s: float, x: float, y: float, hdg: float, length: float, shape: str = "<line/>") -> str:
    """Return a piece of a plan view."""
    return f'<geometry s="{s!r}" x="{x!r}" y="{y!r}" hdg="{hdg!r}" length="{length!r}">{shape}</geometry>'


def opendrive(*content: str) -> str:
    """Return a file of OpenDRIVE 1.6."""
    header = '<header revMajor="1" revMinor="6"><geoReference><![CDATA[+proj=tmerc]]></geoReference>'
    return (
        f'<?xml version="1.0"?>\n<OpenDRIVE>\n{header}<offset x="1" y="2" z="3" hdg="0"/></header>\n'
        + "".join(content)
        + "</OpenDRIVE>"
    )


_TO = '<{tag} elementType="{kind}" elementId="{id}"{end}/>'


def to(tag: str, name: str, end: str = "") -> str:
    """Return a link of a road: to an end of a road or, without one, to a junction."""
    contact = f' contactPoint="{end}"' if end else ""
    return _TO.format(tag=tag, kind="road" if end else "junction", id=name, end=contact)


SIGNALS = (
    '<signals><signal id="5" name="" s="95" t="-4" zOffset="2" orientation="+" dynamic="yes" country="OpenDRIVE" '
    'type="1000001" subtype="-1"/></signals>\n'
)
OBJECTS = (
    '<objects><object id="1" type="crosswalk" s="90" t="0" hdg="1.5707963267948966" length="7" width="3"><outline>'
    '<cornerLocal u="-3.5" v="-1.5"/><cornerLocal u="3.5" v="-1.5"/><cornerLocal u="3.5" v="1.5"/>'
    '<cornerLocal u="-3.5" v="1.5"/></outline></object>\n'
    '<object id="2" type="building" s="30" t="15" length="12" width="8" height="9"/>\n'
    '<object id="3" type="tree" s="50" t="8" radius="1.5" height="6"/>\n'
    '<object id="4" type="barrier" s="10" t="-6" height="1" width="0.3"><repeat s="10" length="20" distance="0" '
    'tStart="-6" tEnd="-7" widthStart="0.3" widthEnd="0.3" heightStart="1" heightEnd="1"/></object>\n'
    '<object id="5" type="pole" s="10" t="6" radius="0.1" height="4"><repeat s="10" length="20" distance="5" '
    'tStart="6" tEnd="6"/></object>\n<object id="6" type="patch" s="1" t="1"/></objects>\n'
)
JUNCTION = (
    '<junction id="9" name=""><connection id="0" incomingRoad="1" connectingRoad="10" contactPoint="start">'
    '<laneLink from="-1" to="-1"/></connection>\n'
    '<connection id="1" incomingRoad="1" connectingRoad="11" contactPoint="start"><laneLink from="-1" to="-1"/>'
    '</connection>\n<connection id="2" incomingRoad="2" connectingRoad="10" contactPoint="end">'
    '<laneLink from="1" to="1"/></connection>\n<priority high="10" low="11"/></junction>\n'
)
QUARTER = 15.707963267948966
ARMS = (
    road("1", piece(0.0, 0.0, 0.0, 0.0, 100.0), lanes(lane(1), lane(-1)), link=to("successor", "9"),
         more=OBJECTS + SIGNALS),
    road("2", piece(0.0, 120.0, 0.0, 0.0, 100.0), lanes(lane(1), lane(-1)), link=to("predecessor", "9")),
    road("3", piece(0.0, 110.0, -10.0, -1.5707963267948966, 50.0), lanes(lane(1), lane(-1)),
         link=to("predecessor", "9")),
    road("10", piece(0.0, 100.0, 0.0, 0.0, 20.0), lanes(lane(1, "1", "1"), lane(-1, "-1", "-1")), junction="9",
         link=to("predecessor", "1", "end") + to("successor", "2", "start")),
    road("11", piece(0.0, 100.0, 0.0, 0.0, QUARTER, '<arc curvature="-0.1"/>'), lanes("", lane(-1, "-1", "-1")),
         junction="9", link=to("predecessor", "1", "end") + to("successor", "3", "start")),
)  # fmt: skip
CONTROLLER = '<controller id="7" name=""><control signalId="5" type=""/></controller>\n'
THREE_ROADS = opendrive(*ARMS, CONTROLLER, JUNCTION)
"""Three roads: from 1 straight on to 2 and right to 3, from 2 back to 1; each way over the junction 9."""

SUMO = """<?xml version="1.0"?>
<net version="1.16">
<location netOffset="-1000.00,-2000.00" convBoundary="0,0,1,1" origBoundary="0,0,1,1" projParameter="+proj=utm"/>
<edge id=":J_0" function="internal"><lane id=":J_0_0" index="0" speed="8" length="10" shape="100,-2 105,-2"/></edge>
<edge id=":J_3" function="internal"><lane id=":J_3_0" index="0" speed="8" length="10" shape="105,-2 110,-2"/></edge>
<edge id=":J_1" function="internal"><lane id=":J_1_0" index="0" speed="5" length="9" shape="100,-2 104,-4 106,-10"/></edge>
<edge id=":J_c0" function="crossing" crossingEdges="A"><lane id=":J_c0_0" index="0" allow="pedestrian" speed="1" length="8" width="4" shape="98,-6 98,2"/></edge>
<edge id=":J_w0" function="walkingarea"><lane id=":J_w0_0" index="0" allow="pedestrian" speed="1" length="3" width="2" shape="96,2 100,2 100,5 96,5"/></edge>
<edge id="A" from="W" to="J" priority="1"><lane id="A_0" index="0" allow="pedestrian" speed="1" length="100" width="2" shape="0,-6 100,-6"/>
<lane id="A_1" index="1" disallow="pedestrian" speed="13.9" length="100" shape="0,-2 100,-2"/><lane id="A_2" index="2" allow="bus" speed="13.9" length="100" shape="0,1 100,1"/></edge>
<edge id="B" from="J" to="E" priority="1"><lane id="B_0" index="0" speed="13.9" length="100" shape="110,-2 150,-2,1.5 210,-2"/></edge>
<edge id="C" from="J" to="S" priority="1"><lane id="C_0" index="0" speed="13.9" length="40" shape="106,-10 106,-50"/></edge>
<tlLogic id="J" type="static" programID="0" offset="3"><phase duration="20" state="Ggr"/><phase duration="5" state="rrG"/></tlLogic>
<junction id="J" type="traffic_light" x="105" y="0" incLanes="A_1" intLanes=":J_3_0 :J_1_0 :J_c0_0" shape="100,-8 110,-8 110,3 100,3">
<request index="0" response="000" foes="110" cont="0"/><request index="1" response="001" foes="001" cont="0"/></junction>
<junction id="E" type="dead_end" x="210" y="0" incLanes="B_0" intLanes="" shape="210,0 210,-4"/>
<connection from="A" to="B" fromLane="1" toLane="0" via=":J_0_0" tl="J" linkIndex="0" dir="s" state="o"/>
<connection from="A" to="C" fromLane="1" toLane="0" via=":J_1_0" tl="J" linkIndex="1" dir="r" state="o"/>
<connection from=":J_0" to="B" fromLane="0" toLane="0" via=":J_3_0" dir="s" state="m"/>
<connection from=":J_3" to="B" fromLane="0" toLane="0" dir="s" state="M"/>
<connection from=":J_1" to="C" fromLane="0" toLane="0" dir="r" state="M"/>
<connection from=":J_w0" to=":J_c0" fromLane="0" toLane="0" tl="J" linkIndex="2" dir="s" state="M"/>
</net>"""  # noqa: E501
"""Edge A to B straight on, in two parts, and to C on the right; a crossing with a light."""

POLYGONS = """<additional><poly id="h" type="building.yes" shape="10,10 20,10 20,20 10,20 10,10"><param key="height" value="7"/>
</poly><poly id="p" type="amenity.parking" shape="30,10 40,10 40,20"/><poly id="f" type="landuse.forest" shape="0,0 1,1 2,0"/>
<poi id="x" type="shop" x="1" y="1"/></additional>"""  # noqa: E501


def written(folder: Path, text: str, name: str = "map.xodr") -> Path:
    """Write a map into a file, in gzip where its name says so."""
    path = folder / name
    path.write_bytes(gzip.compress(text.encode()) if name.endswith(".gz") else text.encode())
    return path
