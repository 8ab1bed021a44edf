"""Objects of OpenDRIVE: crosswalks, parking spaces, and what stands beside roads, single or repeated along them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from coopsim.data.maps.elements import Element
from coopsim.data.maps.notes import Notes
from coopsim.data.maps.opendrive.roads import Road
from coopsim.data.maps.rectangles import along_rectangle, circle
from coopsim.data.maps.street_map import SolidKind, StreetArea, StreetCrossing, StreetSolid
from coopsim.geometry import exact
from coopsim.geometry.se3 import Floats

_SOLIDS: dict[str, SolidKind] = {
    "building": "building",
    **dict.fromkeys(("barrier", "railing", "soundBarrier", "wall", "fence", "guardRail"), "wall"),
    **dict.fromkeys(("tree", "vegetation", "bush"), "tree"),
    **dict.fromkeys(("pole", "streetLamp", "rail-pole", "streetlamp"), "pole"),
}
_STRIP_M, _MOST_COPIES = 2.0, 10_000
_THIN_M = 0.1
_LOOSE = ("bridge", "tunnel", "objectReference")


@dataclass(slots=True)
class Objects:
    """Objects of all roads."""

    notes: Notes
    crossings: list[StreetCrossing] = field(default_factory=list)
    areas: list[StreetArea] = field(default_factory=list)
    solids: list[StreetSolid] = field(default_factory=list)

    def read(self, element: Element, road: Road) -> None:
        """Read the `<objects>` of a road."""
        for objects in element.all("objects"):
            for each in objects.all(*_LOOSE):
                self.notes.left_out[f"elements {each.tag}"] += 1
            for each in objects.all("object"):
                self._add(each, road)

    def _add(self, element: Element, road: Road) -> None:
        kind = "parkingSpace" if element.all("parkingSpace") else element.get("type") or element.get("name")
        if kind not in _SOLIDS and kind not in ("crosswalk", "parkingSpace"):
            self.notes.left_out[f"objects of type {kind or 'none'}"] += 1
            return
        for index, body in enumerate(_bodies(element, road, self.notes)):
            self.notes.take_points(len(body.line), element)
            name = f"{road.id}.{element.get('id')}" + (f".{index}" if index else "")
            if kind == "crosswalk":
                line, width_m = along_rectangle(body.line, road.surface.heading_at(element.number("s")))
                self.crossings.append(StreetCrossing(name, line, width_m, (road.id,)))
            elif kind == "parkingSpace":
                self.areas.append(StreetArea(name, "park", body.line[:, :2]))
            else:
                self.solids.append(StreetSolid(name, _SOLIDS[kind], body.line, body.height_m, body.thickness_m))


@dataclass(frozen=True, slots=True, eq=False)
class _Body:
    """An outline (K, 3), or a line with a thickness; its height, m."""

    line: Floats
    height_m: float | None
    thickness_m: float | None = None


def _bodies(element: Element, road: Road, notes: Notes) -> Iterator[_Body]:
    """Yield the bodies of an object: those of its repeats, else its own."""
    repeats = element.all("repeat")
    outlines = [each for each in element.at_path("outlines", "outline") + element.all("outline")
                if each.get("outer", "true") != "false"]  # fmt: skip
    outline = outlines[0] if outlines else None
    sizes = _Sizes.of(element)
    for repeat in repeats:
        yield from _repeated(repeat, element, sizes, outline, road, notes)
    if not repeats:
        body = _body(element, road, sizes, outline, element.number("s"), element.number("t"), notes)
        if body is not None:
            yield body


@dataclass(frozen=True, slots=True)
class _Sizes:
    """Sizes of an object, m, 0 where it has none; and its height over the road."""

    length: float
    width: float
    radius: float
    height: float
    z: float

    @classmethod
    def of(cls, element: Element) -> _Sizes:
        length, width, radius, height = (
            max(element.number(name, 0.0), 0.0) for name in ("length", "width", "radius", "height")
        )
        return cls(length, width, radius, height, element.number("zOffset", 0.0))


def _body(
    element: Element, road: Road, sizes: _Sizes, outline: Element | None, s: float, t: float, notes: Notes
) -> _Body | None:
    """Return the body of an object at (s, t); None, with a note, where it has no size."""
    heights = [sizes.height] if sizes.height else []
    thickness = None
    if outline is not None:
        corners = outline.all("cornerLocal", "cornerRoad")
        heights += [each.number("height", 0.0) for each in corners]
        if len(corners) < 2:
            notes.repair("outlines of objects with fewer than two corners are left out", f"line {outline.line}")
            return None
        if corners[0].tag == "cornerRoad":
            rows = np.array([[each.number(name) for name in ("s", "t")] for each in corners])
            line = road.surface.at(rows[:, 0], rows[:, 1])
            line[:, 2] += [each.number("dz", 0.0) for each in corners]
        else:
            local = np.array([[each.number("u", 0.0), each.number("v", 0.0), each.number("z", 0.0)]
                              for each in corners])  # fmt: skip
            line = _placed(local, element, road, s, t, sizes.z)
        if outline.get("closed", "true") == "false" or len(line) < 3:
            thickness = sizes.width or _THIN_M
    elif sizes.radius:
        line = _placed(circle(sizes.radius), element, road, s, t, sizes.z)
    elif sizes.length and sizes.width:
        half = np.array([[1, 1, 0], [-1, 1, 0], [-1, -1, 0], [1, -1, 0]]) / 2
        line = _placed(half * [sizes.length, sizes.width, 0.0], element, road, s, t, sizes.z)
    else:
        notes.left_out[f"objects of type {element.get('type')} without a size"] += 1
        return None
    height = max(heights, default=0.0)
    return _Body(line, height if height > 0.0 else None, thickness)


def _placed(local: Floats, element: Element, road: Road, s: float, t: float, z: float) -> Floats:
    """Return points (K, 3) of an object's own frame in the world."""
    origin = road.surface.at(np.array([s]), np.array([t]))[0]
    heading = road.surface.heading_at(s) + element.number("hdg", 0.0)
    cos, sin = exact.cos(heading), exact.sin(heading)
    u, v, up = local.T
    return np.column_stack([origin[0] + u * cos - v * sin, origin[1] + u * sin + v * cos, origin[2] + z + up])


def _repeated(
    repeat: Element, element: Element, sizes: _Sizes, outline: Element | None, road: Road, notes: Notes
) -> Iterator[_Body]:
    """Yield copies of an object along a road; with a distance of 0, one wall along it."""
    start, length, distance = repeat.number("s"), max(repeat.number("length"), 0.0), repeat.number("distance")
    length = min(length, max(road.surface.plan.length_m - start, 0.0))
    ends = {
        name: (repeat.number(f"{name}Start", usual), repeat.number(f"{name}End", usual))
        for name, usual in (("t", element.number("t", 0.0)), ("width", sizes.width), ("height", sizes.height),
                            ("zOffset", sizes.z), ("length", sizes.length), ("radius", sizes.radius))
    }  # fmt: skip
    count = length / distance + 1 if distance > 0.0 else length / _STRIP_M + 2
    if count > _MOST_COPIES:
        raise repeat.error(f"asks for {count:.3g} copies or steps; accepted: up to {_MOST_COPIES:,}")
    notes.take_points(count, repeat)
    if distance <= 0.0 or (outline is None and not max(*ends["length"], *ends["radius"])):
        share = np.linspace(0.0, 1.0, int(count))
        line = road.surface.at(start + share * length, _between(ends["t"], share))
        line[:, 2] += _between(ends["zOffset"], share)
        height, width = max(ends["height"]), max(ends["width"])
        yield _Body(line, height if height > 0.0 else None, width if width > 0.0 else _THIN_M)
        return
    for k in range(int(count + 1e-9)):
        along = k * distance
        share = np.array([along / length if length else 0.0])
        t, width, height, z, long, radius = (float(_between(each, share)[0]) for each in ends.values())
        copy = _Sizes(long, width, radius, height, z)
        body = _body(element, road, copy, outline, start + along, t, notes)
        if body is not None:
            yield body


def _between(ends: tuple[float, float], share: Floats) -> Floats:
    return ends[0] + share * (ends[1] - ends[0])
