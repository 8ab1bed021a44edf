"""Narrow bends of long lanes of maps are roads of their own."""

from __future__ import annotations

from dataclasses import replace

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


def test_a_bend_near_the_end_of_a_lane_is_its_last_part() -> None:
    lane = corner("a", 8.0, 100.0)
    short = replace(lane, line=lane.line[:-1], width_m=lane.width_m[:-1])
    roads = roads_of(short)
    assert sorted(roads) == ["a< a~|", "a~| a>"]
    assert roads["a~| a>"] == pytest.approx(4 * np.pi + 8.0, abs=2.0)


def test_a_bend_too_long_to_wait_before_is_parts_of_one() -> None:
    angle = np.linspace(0.0, 2.5 * np.pi, 60)
    line = np.column_stack([10.0 * np.cos(angle), 10.0 * np.sin(angle), np.zeros(60)])
    roads = roads_of(StreetLane("a", "a", "drive", line, np.full(60, 4.0)))
    assert len(roads) == 2 and max(roads.values()) < 40.0 and sum(roads.values()) == pytest.approx(25 * np.pi, abs=0.5)


@pytest.mark.parametrize(
    "lane",
    [corner("a", 30.0, 100.0), corner("a", 8.0, 8.0), corner("a", 8.0, 100.0, right="b")],
    ids=["wide", "short", "with a neighbour"],
)
def test_other_bends_are_not_parted(lane: StreetLane) -> None:
    assert list(roads_of(lane)) == ["a< a>"]
