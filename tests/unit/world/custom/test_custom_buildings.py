"""Buildings and walls of files: closed meshes of the size said, with boxes that hide as they do."""

from typing import Any

import numpy as np
import pytest

from coopsim.errors import InvalidValueError, UnknownNameError
from coopsim.geometry.boxes import Boxes3D
from coopsim.sensors.scene import is_closed
from coopsim.world.custom.place import place_from
from coopsim.world.custom.scenery import COLORS
from coopsim.world.places.layout import Layout
from coopsim.world.snapshot import StaticPart

ROADS: dict[str, Any] = {
    "nodes": {"a": [0.0, -2.0], "b": [60.0, -2.0], "c": [60.0, 2.0], "d": [0.0, 2.0]},
    "roads": [
        {"from": "a", "to": "b"},
        {"from": "b", "to": "c", "turn": "around"},
        {"from": "c", "to": "d"},
        {"from": "d", "to": "a", "turn": "around"},
    ],
}
TURNED = [[10.0, 20.0], [30.0, 30.0], [25.0, 40.0], [5.0, 30.0]]
"""A rectangle of 22.36 x 11.18 m, turned by 26.6 degrees."""


def layout_with(**keys: Any) -> Layout:
    return place_from({**ROADS, **keys}, "own").make_layout()


def parts_of(layout: Layout, name: str) -> list[StaticPart]:
    return [part for part in layout.static if part.name == name]


def test_a_turned_building_has_a_turned_box_around_it() -> None:
    layout = layout_with(buildings=[{"outline": TURNED, "height_m": 8}, {"outline": TURNED[::-1], "height_m": 8}])
    for part in parts_of(layout, "building"):
        assert part.closed and is_closed(part.vertices, part.faces)
        assert part.boxes is not None
        np.testing.assert_allclose(sorted(part.boxes[0, 3:6]), [8.0, np.sqrt(125.0), np.sqrt(500.0)])
        corners = Boxes3D.from_array(part.boxes).corners[0]
        for corner in part.vertices:
            assert np.linalg.norm(corners - corner, axis=1).min() < 1e-9
    assert len(layout.road_map.buildings) == 2


def test_windows_are_bands_outside_the_walls_on_every_storey() -> None:
    layout = layout_with(buildings=[{"outline": TURNED, "height_m": 9.5, "windows": True, "color": "sage"}])
    (glass,) = parts_of(layout, "window")
    (block,) = parts_of(layout, "building")
    assert block.color == COLORS["sage"]
    assert glass.reflectivity < 0.1 and glass.closed is False and glass.boxes is not None and len(glass.boxes) == 0
    heights = np.unique(glass.vertices[:, 2].round(6))
    np.testing.assert_allclose(heights, [1.0, 2.4, 4.1, 5.5, 7.2, 8.6])
    assert len(glass.faces) == 2 * 4 * 3  # sides, storeys
    a, b, c = (glass.vertices[glass.faces[:, k]] for k in range(3))
    normal = np.cross(b - a, c - a)
    outward = (a + b + c) / 3 - block.vertices.mean(axis=0)
    assert ((normal * outward)[:, :2].sum(axis=1) > 0).all()


def test_a_low_shed_has_no_windows() -> None:
    assert not parts_of(layout_with(buildings=[{"outline": TURNED, "height_m": 2.4, "windows": True}]), "window")


@pytest.mark.parametrize("first", range(4))
def test_a_gable_is_closed_and_its_ridge_is_along_the_longer_sides(first: int) -> None:
    outline = TURNED[first:] + TURNED[:first]
    (roof,) = parts_of(layout_with(buildings=[{"outline": outline, "height_m": 6, "roof": "gable"}]), "roof")
    assert roof.closed and is_closed(roof.vertices, roof.faces)
    ridge = roof.vertices[roof.vertices[:, 2] > 6.0]
    assert len(ridge) == 2 and np.linalg.norm(ridge[1] - ridge[0]) == pytest.approx(np.sqrt(500.0))
    assert ridge[0, 2] == pytest.approx(6.0 + 0.35 * np.sqrt(125.0))


def test_a_wall_follows_its_line() -> None:
    layout = layout_with(walls=[{"along": [[0.0, 9.0], [20.0, 9.0], [20.0, 30.0]], "height_m": 1.8}])
    (wall,) = parts_of(layout, "wall")
    assert wall.closed and is_closed(wall.vertices, wall.faces) and len(wall.faces) == 24
    np.testing.assert_allclose(wall.vertices.min(axis=0), [-0.125, 8.875, 0.0])
    np.testing.assert_allclose(wall.vertices.max(axis=0), [20.125, 30.125, 1.8])
    assert wall.boxes is not None and sorted(wall.boxes[0, 3:6].round(6)) == [0.25, 1.8, 20.25]
    assert len(layout.road_map.walls) == 2


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ({"buildings": [{"outline": TURNED, "height_m": 5, "windows": 1}]}, "windows must be True or False, got 1"),
        ({"buildings": [{"outline": TURNED, "height_m": 5, "roof": "round"}]}, "unknown roof 'round'"),
        ({"buildings": [{"outline": TURNED, "height_m": 5, "color": "pink"}]}, "unknown color 'pink'"),
        (
            {"buildings": [{"outline": TURNED[:3], "height_m": 5, "roof": "gable"}]},
            r"roof must be flat on an outline of 3 corners, got 'gable'",
        ),
        ({"buildings": [{"outline": [*TURNED, [10.0, 20.0]], "height_m": 5}]}, "outline must have every corner once"),
        ({"walls": [{"along": [[0.0, 9.0]], "height_m": 1}]}, r"walls\[0\].along: along must be at least 2 points"),
        ({"walls": [{"along": [[0.0, 9.0], [0.0, 9.0]], "height_m": 1}]}, "each another place than the one before"),
        ({"walls": [{"along": [[0.0, 9.0], [9.0, 9.0]], "height_m": 0}]}, r"height_m must be in \[0.2, 20\], got 0"),
        (
            {"walls": [{"along": [[0.0, 9.0], [9.0, 9.0]], "height_m": 1, "thickness_m": 3}]},
            r"thickness_m must be in \[0.05, 2\], got 3",
        ),
        (
            {"walls": [{"along": [[20.0, 9.0], [20.0, 3.0]], "height_m": 1}]},
            r"walls\[0\].along: the side of the wall must be at least 2 m from .* got 0.88 m from .* in roads\[2\]",
        ),
    ],
)
def test_what_is_wrong_is_said(keys: dict[str, Any], message: str) -> None:
    with pytest.raises((InvalidValueError, UnknownNameError), match=message):
        layout_with(**keys)
