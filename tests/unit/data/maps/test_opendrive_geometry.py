"""Reference lines and surfaces against closed forms and fine integration."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from scipy.special import fresnel
from tiny_maps import lane, lanes, opendrive, piece, road, written

from coopsim.data.maps.reading import read_map
from coopsim.data.maps.street_map import StreetLane, StreetMap
from coopsim.errors import MapFileError

_CENTRE = lanes("", '<lane id="-1" type="driving"><width sOffset="0" a="4" b="0" c="0" d="0"/></lane>')
_OFFSET = _CENTRE.replace("<lanes>", '<lanes><laneOffset s="0" a="2" b="0" c="0" d="0"/>')
"""One lane of 4 m whose middle is the reference line."""


def read(folder: Path, *content: str) -> StreetMap:
    return read_map(written(folder, opendrive(*content)))


def read_lane(folder: Path, geometry: str, lanes_: str = _OFFSET, more: str = "") -> StreetLane:
    (found,) = read(folder, road("1", geometry, lanes_, more=more)).lanes.values()
    return found


def test_an_arc_is_a_circle(tmp_path: Path) -> None:
    line = read_lane(tmp_path, piece(0, 5.0, 1.0, math.pi / 2, 30.0, '<arc curvature="0.05"/>')).line
    assert np.allclose(np.hypot(line[:, 0] + 15.0, line[:, 1] - 1.0), 20.0, atol=1e-9)
    assert line[-1, :2] == pytest.approx([-15.0 + 20 * math.cos(1.5), 1.0 + 20 * math.sin(1.5)], abs=1e-9)


def test_a_spiral_is_that_of_fresnel(tmp_path: Path) -> None:
    length, end = 60.0, 0.04
    line = read_lane(tmp_path, piece(0, 0.0, 0.0, 0.0, length, f'<spiral curvStart="0" curvEnd="{end}"/>')).line
    scale = math.sqrt(math.pi * length / end)
    sine, cosine = fresnel(length / scale)
    assert line[-1, :2] == pytest.approx([scale * cosine, scale * sine], abs=1e-9)


def test_a_spiral_that_straightens_comes_back(tmp_path: Path) -> None:
    """Going out along a spiral and back along its mirror image ends where it began."""
    out = read_lane(tmp_path, piece(0, 0.0, 0.0, 0.3, 40.0, '<spiral curvStart="0.01" curvEnd="-0.06"/>')).line
    x, y = out[-1, :2].tolist()
    heading = 0.3 + 40 * (0.01 - 0.06) / 2 + math.pi
    back = read_lane(tmp_path, piece(0, x, y, heading, 40.0, '<spiral curvStart="0.06" curvEnd="-0.01"/>')).line
    assert back[-1, :2] == pytest.approx([0.0, 0.0], abs=1e-9)


def param_poly(kind: str, p: float) -> str:
    """Return the parabola v = 0.01 u^2 up to u = 40, with a parameter up to `p`."""
    b, c = 40 / p, 16 / p**2
    return f'<paramPoly3 pRange="{kind}" aU="0" bU="{b}" cU="0" dU="0" aV="0" bV="0" cV="{c}" dV="0"/>'


def parabola_length() -> float:
    u = np.linspace(0, 40, 400_001)
    return float(np.hypot(np.diff(u), np.diff(0.01 * u * u)).sum())


def test_cubics_are_one_curve_by_any_parameter(tmp_path: Path) -> None:
    length = parabola_length()
    shapes = (
        param_poly("normalized", 1.0),
        param_poly("arcLength", length),
        '<poly3 a="0" b="0" c="0.01" d="0"/>',
    )
    lines = [read_lane(tmp_path, piece(0, 0.0, 0.0, 0.0, length, shape)).line for shape in shapes]
    for line in lines:
        assert line[-1, :2] == pytest.approx([40.0, 16.0], abs=2e-3)
        assert np.abs(line[:, 1] - 0.01 * line[:, 0] ** 2).max() < 1e-3
        step = np.hypot(*np.diff(line[:, :2], axis=0).T)
        assert step.max() < 1.01 * np.median(step)  # s is the distance along the curve


def test_chords_keep_to_the_curve(tmp_path: Path) -> None:
    line = read_lane(tmp_path, piece(0, 0.0, 0.0, 0.0, 31.0, '<arc curvature="0.1"/>')).line
    middle = (line[1:, :2] + line[:-1, :2]) / 2
    assert np.abs(np.hypot(middle[:, 0], middle[:, 1] - 10.0) - 10.0).max() < 0.006


def test_elevation_superelevation_and_shape_add_up(tmp_path: Path) -> None:
    profile = (
        '<elevationProfile><elevation s="0" a="1" b="0.1" c="0" d="0"/></elevationProfile><lateralProfile>'
        '<superelevation s="0" a="0.1" b="0" c="0" d="0"/><shape s="0" t="-5" a="0" b="0" c="0" d="0"/>'
        '<shape s="0" t="-3" a="0" b="0.2" c="0" d="0"/><shape s="100" t="-5" a="0.5" b="0" c="0" d="0"/>'
        "</lateralProfile>"
    )
    line = read_lane(tmp_path, piece(0, 0.0, 0.0, 0.0, 100.0), _CENTRE, profile).line
    t, s = -2.0, line[:, 0]
    shape = (1 - s / 100) * 0.2 * (t + 3) + s / 100 * 0.5
    assert np.allclose(line[:, 1], t * math.cos(0.1), atol=1e-12)
    assert np.allclose(line[:, 2], 1 + 0.1 * s + t * math.sin(0.1) + shape, atol=1e-12)


def test_level_lanes_keep_the_height_of_their_inner_edge_and_crossfall_falls(tmp_path: Path) -> None:
    walk = '<lane id="-2" type="sidewalk" level="true"><width sOffset="0" a="2" b="0" c="0" d="0"/>'
    both = lanes("", lane(-1) + walk + '<height sOffset="0" inner="0.1" outer="0.2"/></lane>')
    profile = '<lateralProfile><crossfall side="both" s="0" a="0.1" b="0" c="0" d="0"/></lateralProfile>'
    streets = read(tmp_path, road("1", piece(0, 0.0, 0.0, 0.0, 20.0), both, more=profile))
    drive, walked = (streets.lanes[f"1.0.{number}"].line for number in (-1, -2))
    assert np.allclose(drive[:, 2], -1.75 * math.tan(0.1))
    assert np.allclose(walked[:, 2], -3.5 * math.tan(0.1) + 0.15)


def test_borders_are_widths_from_the_middle_lane(tmp_path: Path) -> None:
    border = '<lane id="{}" type="driving"><border sOffset="0" a="{}" b="{}" c="0" d="0"/></lane>'
    both = lanes("", border.format(-1, -3, 0) + border.format(-2, -5, -0.01))
    both = both.replace("<lanes>", '<lanes><laneOffset s="0" a="1" b="0" c="0" d="0"/>')
    streets = read(tmp_path, road("1", piece(0, 0.0, 0.0, 0.0, 100.0), both))
    assert np.allclose(streets.lanes["1.0.-1"].line[:, 1], 1 - 1.5)
    assert streets.lanes["1.0.-2"].width_m[[0, -1]] == pytest.approx([2.0, 3.0])


def test_an_offset_that_jumps_between_sections_leaves_no_gap(tmp_path: Path) -> None:
    """Where the middle lane moves by a lane, numbers shift, and lanes go straight on."""
    sections = (
        '<lanes><laneOffset s="0" a="0" b="0" c="0" d="0"/><laneOffset s="50" a="3.5" b="0" c="0" d="0"/>'
        f'<laneSection s="0"><center/><right>{lane(-1, after="-2")}</right></laneSection>'
        f'<laneSection s="50"><center/><right>{lane(-1)}{lane(-2, "-1")}</right></laneSection></lanes>'
    )
    streets = read(tmp_path, road("1", piece(0, 0.0, 0.0, 0.0, 100.0), sections))
    assert streets.links == {"1.0.-1": ("1.1.-2",)}
    first, second = streets.lanes["1.0.-1"].line, streets.lanes["1.1.-2"].line
    assert first[-1] == pytest.approx(second[0], abs=1e-9) and np.allclose(first[:, 1], -1.75)
    assert streets.lanes["1.1.-2"].left == "1.1.-1" and streets.lanes["1.1.-1"].right == "1.1.-2"


def test_the_rule_of_the_road_turns_lanes_round(tmp_path: Path) -> None:
    text = road("1", piece(0, 0.0, 0.0, 0.0, 20.0), lanes(lane(1), lane(-1)))
    right, left = read(tmp_path, text), read(tmp_path, text.replace("<road ", '<road rule="LHT" '))
    assert left.left_hand and not right.left_hand
    for number in ("1.0.1", "1.0.-1"):
        assert np.array_equal(left.lanes[number].line, right.lanes[number].line[::-1])
    assert right.lanes["1.0.-1"].line[0, 0] == 0.0  # on the right of the reference line one goes along it


def test_speeds_are_those_of_the_lane_or_else_of_the_road(tmp_path: Path) -> None:
    kind = '<type s="0" type="town"><speed max="50" unit="km/h"/></type>'
    slow = lane(-2).replace("</lane>", '<speed sOffset="0" max="20" unit="mph"/></lane>')
    text = road("1", piece(0, 0.0, 0.0, 0.0, 20.0), lanes("", lane(-1) + slow), more=kind)
    found = read(tmp_path, text).lanes
    assert found["1.0.-1"].speed_m_s == pytest.approx(50 / 3.6)
    assert found["1.0.-2"].speed_m_s == pytest.approx(20 * 0.44704)
    with pytest.raises(MapFileError, match="unit must be m/s, km/h or mph"):
        read(tmp_path, text.replace("mph", "knots"))
