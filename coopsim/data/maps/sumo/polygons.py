"""Polygons of SUMO (`.poly.xml`): houses, walls and ground for parked vehicles, from what polyconvert writes."""

from __future__ import annotations

import dataclasses
from collections import Counter
from pathlib import Path

import numpy as np

from coopsim.data.maps.elements import Element, read_elements
from coopsim.data.maps.notes import Notes
from coopsim.data.maps.street_map import StreetArea, StreetMap, StreetSolid
from coopsim.geometry.se3 import Floats

_PARKING, _WALL_M = "amenity.parking", 0.25


def polygons_beside(path: Path) -> Path | None:
    """Return the file of polygons that lies beside a network: `x.poly.xml`, plain or in gzip, of `x.net.xml`."""
    stem = path.name.removesuffix(".gz").removesuffix(".xml").removesuffix(".net")
    files = [path.with_name(f"{stem}.poly.xml{packed}") for packed in ("", ".gz")]
    return next((file for file in files if file.is_file()), None)


def with_polygons(streets: StreetMap, path: Path) -> StreetMap:
    """Return a map with the polygons of a file."""
    notes, solids, areas = Notes(), list[StreetSolid](), list[StreetArea]()
    for element in read_elements(path):
        if element.tag == "poi":
            notes.left_out["elements poi"] += 1
        elif element.tag == "poly":
            _add(element, solids, areas, notes)
    left_out = Counter(streets.left_out) + notes.left_out
    return dataclasses.replace(
        streets,
        solids=(*streets.solids, *solids),
        areas=(*streets.areas, *areas),
        repaired=(*streets.repaired, *notes.repaired),
        left_out=dict(sorted(left_out.items())),
    )


def _add(element: Element, solids: list[StreetSolid], areas: list[StreetArea], notes: Notes) -> None:
    name, kind = element.need("id"), element.get("type")
    group = kind.partition(".")[0]
    if element.get("geo") in ("true", "1"):
        notes.left_out["polygons in degrees"] += 1
        return
    if (group not in ("building", "barrier") and kind != _PARKING) or kind == "building.roof":
        notes.left_out[f"polygons of type {group or 'none'}"] += 1
        return
    line = element.shape()
    notes.take_points(len(line), element)
    if group == "barrier":
        if len(line) >= 2:
            solids.append(StreetSolid(name, "wall", line, _height(element), _WALL_M))
        return
    corners = _open(line)
    if len(corners) < 3:
        notes.repair("polygons with fewer than three corners are left out", f"poly {name}")
    elif kind == _PARKING:
        areas.append(StreetArea(name, "park", corners[:, :2]))
    else:
        solids.append(StreetSolid(name, "building", corners, _height(element)))


def _open(line: Floats) -> Floats:
    """Return an outline without its first corner at the end."""
    return line[:-1] if len(line) > 1 and np.array_equal(line[0], line[-1]) else line


def _height(element: Element) -> float | None:
    heights = [each.number("value") for each in element.all("param") if each.get("key") == "height"]
    return heights[0] if heights and heights[0] > 0.0 else None
