"""Drawn towns: their descriptions, and the places made from these."""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from typing import Any

import numpy as np

from coopsim.config.checked_entry import DataEntry, plain
from coopsim.errors import InvalidValueError
from coopsim.geometry import exact
from coopsim.support.collecting import without_collecting
from coopsim.world.custom.place import read_place
from coopsim.world.furniture.furnished import furnished, leafy
from coopsim.world.scenario import Place
from coopsim.world.towns.beside.town_blocks import dress_streets
from coopsim.world.towns.first_agents import bring_near
from coopsim.world.towns.road_clearance import off_roads
from coopsim.world.towns.streets.street_plan import draw_plan
from coopsim.world.towns.streets.town_options import TownOptions
from coopsim.world.towns.streets.town_roads import lay_roads
from coopsim.world.towns.streets.town_starts import FIRST, place_starts
from coopsim.world.towns.town_population import usual_population

_ANY = TownOptions()
_KEPT = 4  # places: an environment asks for the same one again when only traffic is drawn anew
_DECIMALS = 3  # of lengths in m and angles in degrees: a description in a file gives the same bits
_POINTS = ("at", "look_at", "centre", "drones_around")
_LINES = ("via", "along", "outline")
_Gap = tuple[dict[str, Any], str, int, int | None]
"""A mapping and a key in it, the number of the first point that belongs there, and of the first after a list of them.
"""


def describe_town(seed: int, options: TownOptions = _ANY) -> dict[str, Any]:
    """Draw a town.

    Args:
        seed: decides everything, together with the options.
        options: how the town shall be.

    Returns:
        The description of a place, as under the key `place` of a scenario file: see `coopsim.world.custom.place`. It is
        the caller's own, to be changed at will.
    """
    description = draw_place(seed, options).description
    assert description is not None, "it was made from one"
    return dict(plain(description))


@lru_cache(_KEPT)
def draw_place(seed: int, options: TownOptions = _ANY) -> Place:
    """Draw a town, and make a place of it.

    Args:
        seed: see `describe_town`.
        options: see `describe_town`.
    """
    with without_collecting():
        return _drawn(seed, options)


def _drawn(seed: int, options: TownOptions) -> Place:
    # It is plain data already, which `place_from` would copy.
    entry = DataEntry(leafy(describe_streets(seed, options)), "place", InvalidValueError)
    bare = read_place(entry, f"town-{seed}")
    layout, description = furnished(bare.make_layout(), bare.description or {}, seed)
    return Place(bare.name, lambda: layout, usual_population(layout), description)


def describe_streets(seed: int, options: TownOptions = _ANY) -> dict[str, Any]:
    """Draw a town without furniture; the arguments and the result are those of `describe_town`."""
    plan = draw_plan(seed, options)
    roads = lay_roads(plan)
    usual, spots = place_starts(plan, roads)
    beside = dress_streets(plan, seed, options.openness)
    starts, masts = bring_near(usual, spots, off_roads(beside["rsus"], roads.nodes, roads.roads))
    description = {
        "nodes": roads.nodes,
        "roads": roads.roads,
        **beside,
        "starts": starts,
        "cars_first": FIRST,
        "rsus": masts,
    }
    return turned(description, plan.turn_rad)


def turned(description: Mapping[str, Any], angle_rad: float) -> dict[str, Any]:
    """Return a description turned about the origin, counter-clockwise; lengths and angles are rounded.

    Args:
        description: of a place, or a part of one.
        angle_rad: by which it is turned.
    """
    points, gaps = list[Any](), list[_Gap]()
    copied: dict[str, Any] = _copied(description, float(np.degrees(angle_rad)), points, gaps)
    x, y = np.array(points, dtype=np.float64).reshape(-1, 2).T
    cos, sin = exact.cos(angle_rad), exact.sin(angle_rad)
    # Adding 0.0 makes a zero of a negative one, which a file would keep.
    moved = np.round(np.column_stack([cos * x - sin * y, sin * x + cos * y]), _DECIMALS) + 0.0
    rows = moved.tolist()
    for place, key, first, end in gaps:
        place[key] = rows[first] if end is None else rows[first:end]
    return copied


def _copied(content: Any, angle_deg: float, points: list[Any], gaps: list[_Gap]) -> Any:
    """Return a copy with turned headings; its points are collected, and where they are to be put once turned."""
    if isinstance(content, list) and content and isinstance(content[0], Mapping):
        return [_copied(part, angle_deg, points, gaps) for part in content]
    if not isinstance(content, Mapping):
        return float(content) if isinstance(content, float) else content  # numpy's numbers as Python's
    copy: dict[str, Any] = {}
    for key, part in content.items():
        copy[key] = None
        if key in _POINTS:
            gaps.append((copy, key, len(points), None))
            points.append(part)
        elif key in _LINES:
            gaps.append((copy, key, len(points), len(points) + len(part)))
            points += part
        elif key == "heading_deg":
            copy[key] = round((float(part) + angle_deg + 180.0) % 360.0 - 180.0, _DECIMALS) + 0.0
        elif key == "nodes":
            copy[key] = dict.fromkeys(part)
            gaps += [(copy[key], name, len(points) + k, None) for k, name in enumerate(part)]
            points += part.values()
        else:
            copy[key] = _copied(part, angle_deg, points, gaps)
    return copy
