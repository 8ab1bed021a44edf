"""Lanelets: what they are for, their middle and width, and how they hang together by their borders."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from coopsim.data.maps.lanelet2.borders import middle_of, turned
from coopsim.data.maps.osm.content import Content, Item, Places, Tags, quantity
from coopsim.data.maps.street_map import DRIVEN, LaneKind, length_of
from coopsim.geometry.se3 import Floats

_KINDS: dict[str, LaneKind] = {
    **dict.fromkeys(("", "lane", "road", "highway", "play_street", "exit"), "drive"),
    **dict.fromkeys(("emergency_lane", "road_shoulder"), "shoulder"),
    **dict.fromkeys(("walkway", "shared_walkway", "crosswalk", "stairs", "pedestrian_lane"), "walk"),
    "bus_lane": "bus",
    "bicycle_lane": "cycle",
    "rail": "rail",
}
_USERS: tuple[tuple[str, LaneKind], ...] = (
    ("vehicle", "drive"), ("vehicle:car", "drive"), ("vehicle:bus", "bus"), ("vehicle:taxi", "bus"),
    ("vehicle:truck", "bus"), ("pedestrian", "walk"), ("bicycle", "cycle"), ("vehicle:emergency", "shoulder"),
)  # fmt: skip
"""What a lanelet with tags `participant:` is for: the first that may use it."""
SPEEDS = {"": 1 / 3.6, **dict.fromkeys(("km/h", "kmh", "kph"), 1 / 3.6), "mph": 0.44704, "m/s": 1.0, "mps": 1.0}
_LONGEST_M, _WIDEST_M, _THINNEST_M, _LEAST_M = 100_000.0, 200.0, 0.3, 0.1
Ends = tuple[int, int]


@dataclass(slots=True, eq=False)
class Lanelet:
    """A lanelet in the direction of travel.

    Attributes:
        item: its relation.
        kind: its use.
        line, width_m: its middle (K, 3) and width (K,) m.
        borders: ways of its left and right border.
        start, end: nodes of its left and right border there.
        speed_m_s: limit; None: the file has none.
    """

    item: Item
    kind: LaneKind
    line: Floats
    width_m: Floats
    borders: tuple[Item, Item]
    start: Ends
    end: Ends
    speed_m_s: float | None

    @property
    def name(self) -> str:
        """Id in the file."""
        return self.item.id

    @property
    def is_driven(self) -> bool:
        """True where vehicles drive on it, one way."""
        return self.kind in DRIVEN


def kind_of(tags: Tags) -> LaneKind:
    """Return what a lanelet is for; one that vehicles use in both directions is `shared`."""
    users = [key.removeprefix("participant:") for key, value in tags.items()
             if key.startswith("participant:") and value == "yes"]  # fmt: skip
    kind = _KINDS.get(tags.get("subtype", ""), "other")
    if users:
        kind = next((kind for user, kind in _USERS if user in users), "other")
    return "shared" if kind in DRIVEN and tags.get("one_way") == "no" else kind


def read_lanelets(content: Content, places: Places) -> dict[str, Lanelet]:
    """Return the lanelets of a file by id; those without two borders are left out, with a note."""
    found = (_lanelet(each, content, places) for each in lanelets_of(content))
    return {each.name: each for each in found if each is not None}


def lanelets_of(content: Content) -> list[Item]:
    """Return the relations that are lanelets."""
    return [each for each in content.relations.values() if each.tags.get("type") == "lanelet"]


def borders_of(item: Item, content: Content) -> tuple[Item, Item] | None:
    """Return the left and right border of a lanelet; None where it has not one of each."""
    sides = [[content.ways[name] for name in item.of_role(role) if name in content.ways] for role in ("left", "right")]
    if any(len(side) != 1 for side in sides):
        return None
    left, right = sides[0][0], sides[1][0]
    return (left, right) if min(len(content.known(left)), len(content.known(right))) > 1 else None


def has_y_south(content: Content, places: Places) -> bool:
    """Return whether y points south, as in CARLA: every middle line has its left border on its right."""
    backward = []
    for item in lanelets_of(content):
        borders, middles = borders_of(item, content), item.of_role("centerline")
        if borders is not None and middles and middles[0] in content.ways:
            left, right = (places.line(border) for border in borders)
            middle = places.line(content.ways[middles[0]])
            if len(middle) > 1:
                left = left[::-1] if turned(left, right)[0] else left
                ends = np.abs(left[[0, -1]] - middle[0]).sum(axis=1)
                backward.append(bool(ends[1] < ends[0]))
    return bool(backward) and all(backward)


def _lanelet(item: Item, content: Content, places: Places) -> Lanelet | None:
    borders = borders_of(item, content)
    if borders is None:
        content.notes.repair("lanelets without one left and one right border are left out", item.id)
        return None
    rows: list[NDArray[np.int64]] = [np.array(content.known(each)) for each in borders]
    lines = [places.metres[each] for each in rows]
    if max(map(length_of, lines)) > _LONGEST_M:
        raise item.element.error(f"has a border longer than {_LONGEST_M / 1e3:g} km; accepted: shorter ones")
    for side, is_turned in enumerate(turned(*lines)):
        if is_turned:
            rows[side], lines[side] = rows[side][::-1], lines[side][::-1]
    if min(map(length_of, lines)) < _LEAST_M:
        content.notes.repair("lanelets without length are left out", item.id)
        return None
    line, width_m = middle_of(lines[0], lines[1])
    content.notes.take_points(len(line), item.element)
    if width_m.max() > _WIDEST_M:
        raise item.element.error(f"is {width_m.max():.3g} m wide; accepted: up to {_WIDEST_M:g} m")
    if width_m.max() < _THINNEST_M:
        content.notes.repair("lanelets without width are left out", item.id)
        return None
    start, end = ((int(rows[0][k]), int(rows[1][k])) for k in (0, -1))
    speed = quantity(item.tags.get("speed_limit", ""), SPEEDS)
    return Lanelet(item, kind_of(item.tags), line, width_m, borders, start, end, speed)


class Neighbours:
    """Followers of lanelets, lanelets side by side, and the side that vehicles keep to."""

    def __init__(self, lanelets: dict[str, Lanelet]) -> None:
        driven = [each for each in lanelets.values() if each.is_driven]
        by_start: dict[Ends, list[str]] = {}
        for each in driven:
            by_start.setdefault(each.start, []).append(each.name)
        self.after = {each.name: tuple(by_start.get(each.end, ())) for each in driven}
        self.before: dict[str, list[str]] = {}
        for name, after in self.after.items():
            for other in after:
                self.before.setdefault(other, []).append(name)
        self.left, self.right = dict[str, str](), dict[str, str]()
        self.left_hand = self._pair(driven)

    def is_near(self, one: str, other: str) -> bool:
        """Return whether a lanelet leads to another or follows it, or both part or join."""
        starts, ends = {one, *self.before.get(one, ())}, {one, *self.after[one]}
        near = {after for each in starts for after in self.after[each]} | starts | ends
        return other in near or other in {before for each in ends for before in self.before.get(each, ())}

    def _pair(self, driven: list[Lanelet]) -> bool:
        """Find lanelets of one direction side by side; return whether opposite ones lie on the right."""
        sides = [{(each.borders[k].id, each.start[k]): each for each in driven} for k in (0, 1)]
        ends = [{(each.borders[k].id, each.end[k]) for each in driven} for k in (0, 1)]
        opposite = Counter[bool]()
        for each in driven:
            border = each.borders[1]
            other = sides[0].get((border.id, each.start[1]))
            if other is not None and _may_change(border.tags):
                self.right[each.name], self.left[other.name] = other.name, each.name
            opposite[False] += (each.borders[0].id, each.start[0]) in ends[0]
            opposite[True] += (border.id, each.start[1]) in ends[1]
        return opposite[True] > opposite[False]


def _may_change(tags: Tags) -> bool:
    return tags.get("lane_change", "yes" if tags.get("subtype") == "dashed" else "no") == "yes"
