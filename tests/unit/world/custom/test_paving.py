"""Ground beside lanes: every kind has its surface and its outline on the map, and no two lie at one height."""

from typing import Any

import numpy as np
import pytest

from coopsim.errors import InvalidValueError
from coopsim.world.custom.place import place_from
from coopsim.world.places.description import SURFACES
from coopsim.world.places.layout import Layout

SQUARE = [[20.0, 10.0], [20.0, 14.0], [24.0, 14.0], [24.0, 10.0]]  # clockwise


def layout_with(paved: list[Any]) -> Layout:
    nodes = {"a": [0.0, -2.0], "b": [60.0, -2.0], "c": [60.0, 2.0], "d": [0.0, 2.0]}
    roads = [{"from": start, "to": end} for start, end in (("a", "b"), ("c", "d"))]
    loops = [{"from": start, "to": end, "turn": "around"} for start, end in (("b", "c"), ("d", "a"))]
    return place_from({"nodes": nodes, "roads": roads + loops, "paved": paved}, "own").make_layout()


def test_every_kind_is_a_surface_at_a_height_of_its_own() -> None:
    plain, layout = layout_with([]), layout_with([{"outline": SQUARE, "kind": kind} for kind in SURFACES])
    heights = {part.name: np.unique(part.vertices[:, 2]).tolist() for part in layout.static}
    assert set(heights) == {"ground", "road", "pavement", "grass", "yard", "parking"}
    assert all(len(each) == 1 for each in heights.values()) and len({each[0] for each in heights.values()}) == 6
    assert heights["ground"] < heights["grass"] < heights["yard"] < heights["pavement"] < heights["road"]
    for part in layout.static:
        assert part.closed is False
        a, b, c = (part.vertices[part.faces[:, k]] for k in range(3))
        assert (np.cross(b - a, c - a)[:, 2] > 0).all()  # seen from above, though the outline is clockwise
    for field in SURFACES.values():
        more = len(getattr(layout.road_map, field)) - len(getattr(plain.road_map, field))
        assert more == 1
        np.testing.assert_array_equal(sorted(getattr(layout.road_map, field)[-1].tolist()), sorted(SQUARE))


@pytest.mark.parametrize(
    ("item", "message"),
    [
        (
            {"outline": SQUARE, "kind": "lawn"},
            r"paved\[0\].kind: unknown kind 'lawn'. .*Accepted: grass, parking",
        ),
        ({"outline": SQUARE}, r"paved\[0\]: kind is missing in paved"),
        (
            {"outline": [SQUARE[0], SQUARE[2], SQUARE[1], SQUARE[3]], "kind": "yard"},
            r"paved\[0\].outline: outline must be convex: write another shape as several",
        ),
        ({"outline": SQUARE[:2], "kind": "yard"}, r"outline must be at least 3 points"),
    ],
)
def test_what_is_wrong_is_said(item: dict[str, Any], message: str) -> None:
    with pytest.raises(InvalidValueError, match=message):
        layout_with([item])
