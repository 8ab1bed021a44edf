"""Furniture in files: what is read, what is refused, and that a furnished place is the same when it is read back."""

from typing import Any

import pytest

from coopsim.errors import InvalidValueError
from coopsim.world.custom.place import place_from
from coopsim.world.furniture.furnish import furnished, leafy

STREET: dict[str, Any] = {
    "nodes": {"a": [-100, -2], "b": [100, -2], "c": [100, 2], "d": [-100, 2]},
    "roads": [
        {"from": "a", "to": "b"},
        {"from": "b", "to": "c", "turn": "around"},
        {"from": "c", "to": "d"},
        {"from": "d", "to": "a", "turn": "around"},
    ],
    "walks": {"nodes": {"e": [-60, -6.5], "f": [60, -6.5]}, "ways": [["e", "f"]]},
}


def parts_of(*entries: dict[str, Any]) -> list[str]:
    place = place_from({**STREET, "furniture": list(entries)}, "street")
    lines, *parts = place.make_layout().furnishing
    assert lines.name == "marking"  # full detail has painted lines, too
    return [part.name for part in parts]


def test_furniture_is_read() -> None:
    bench = {"kind": "bench", "at": [0, -9], "heading_deg": 90}
    hedge = {"kind": "hedge", "along": [[10, -9], [22, -9]], "height_m": 2}
    assert parts_of(bench, hedge) == ["bench"] * 2 + ["hedge"] * 3
    assert parts_of() == []


@pytest.mark.parametrize(
    ("entry", "message"),
    [
        ({"kind": "bnch", "at": [0, -9], "heading_deg": 0}, "bench"),
        ({"at": [0, -9], "heading_deg": 0}, "kind is missing"),
        ({"kind": "bench", "at": [0, -9]}, "heading_deg is missing"),
        ({"kind": "bench", "along": [[0, -9], [5, -9]]}, "along"),
        ({"kind": "fence", "at": [0, -9], "heading_deg": 0}, "at"),
        ({"kind": "fence", "along": [[0, -9]]}, "at least 2 points"),
        ({"kind": "fence", "along": [[0, -9], [0, -9]]}, "each another place"),
        ({"kind": "lamp", "at": [0, -9], "heading_deg": 0, "height_m": 40}, r"height_m must be in \[3, 15\]"),
        ({"kind": "tree", "at": [0, -9], "heading_deg": 0, "height_m": 4, "stem_m": 5}, "less than height_m"),
        ({"kind": "bench", "at": [0, -3], "heading_deg": 90}, "furniture must be at least 2 m"),
        ({"kind": "bench", "at": [0, -4.2], "heading_deg": 90}, "it would stand in the way"),
        ({"kind": "fence", "along": [[0, -9], [0, 9]]}, "it would stand in the way"),
    ],
)
def test_mistakes_are_refused(entry: dict[str, Any], message: str) -> None:
    with pytest.raises(InvalidValueError, match=message) as caught:
        parts_of({"kind": "bin", "at": [0, -9], "heading_deg": 0}, entry)
    assert "furniture" in str(caught.value)


def test_a_furnished_place_is_the_same_when_read_back() -> None:
    trees = [{"at": [-20, 12]}, {"at": [20, 14], "height_m": 12, "crown_m": 6.3}]
    given = place_from({**STREET, "trees": trees}, "street").description
    assert given is not None
    bare = leafy(given)
    layout, description = furnished(place_from(bare, "street").make_layout(), bare, 4)
    assert len(description.furniture or ()) > 20 and not description.trees
    assert [part.name for part in layout.static].count("trunk") == 0
    again = place_from(description, "street").make_layout()
    assert len(again.furnishing) == len(layout.furnishing)
    for one, other in zip(layout.furnishing, again.furnishing, strict=True):
        assert one.name == other.name and one.color == other.color
        assert one.vertices.tobytes() == other.vertices.tobytes()
