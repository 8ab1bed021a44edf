"""Narrow bends of long lanes of maps are roads of their own."""

from __future__ import annotations

import numpy as np
import pytest

from coopsim.data.maps.place.describe import describe_place
from coopsim.data.maps.street_map import StreetLane, StreetMap


def corner(name: str, radius_m: float, length_m: float, *, back: bool = False, **more: object) -> StreetLane:
    """Return a lane that goes east, turns left around (0, 20), and goes north."""
    angle = np.linspace(-np.pi / 2, 0.0, 12)
    bend = np.column_stack([radius_m * np.cos(angle), 20.0 + radius_m * np.sin(angle)])
    line = np.vstack([[-length_m, 20.0 - radius_m], bend, [radius_m, 20.0 + length_m]])
    line = np.column_stack([line, np.zeros(len(line))])[:: -1 if back else 1]
    return StreetLane(name, name, "drive", line, np.full(len(line), 4.0), **more)  # type: ignore[arg-type]


def roads_of(*lanes: StreetLane) -> dict[str, float]:
    """Return the length of each road, m, by its nodes."""
    streets = StreetMap(
        source="x", format="x", lanes={each.id: each for each in lanes}, links={}, ways={}, junctions={}
    )
    described = describe_place(streets, 0)
    found = {}
    for road in described.roads:
        points = np.array([described.nodes[road.start], *road.via, described.nodes[road.end]])
        found[f"{road.start} {road.end}"] = float(np.hypot(*np.diff(points, axis=0).T).sum())
    return found


def test_vehicles_wait_before_narrow_bends_of_long_lanes() -> None:
    roads = roads_of(corner("a", 8.0, 100.0), corner("b", 12.0, 100.0, back=True))
    assert sorted(roads) == ["a< a~|", "a~| a~~|", "a~~| a>", "b< b~|", "b~| b~~|", "b~~| b>"]
    assert roads["a~| a~~|"] == pytest.approx(0.5 * np.pi * 8 + 16.0, abs=2.0), "the bend, and what is near"
    assert sum(length_m for road, length_m in roads.items() if "a" in road) == pytest.approx(200 + 4 * np.pi, abs=0.5)


@pytest.mark.parametrize(
    "lane",
    [corner("a", 30.0, 100.0), corner("a", 8.0, 8.0), corner("a", 8.0, 100.0, right="b")],
    ids=["wide", "short", "with a neighbour"],
)
def test_other_bends_are_not_parted(lane: StreetLane) -> None:
    assert list(roads_of(lane)) == ["a< a>"]
